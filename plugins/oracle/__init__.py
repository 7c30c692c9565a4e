"""The oracle perceiver: the simulator's ground truth in place of perception, to locate the cause of failures."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from gvla2 import Component, ComponentConfig, hookimpl
from gvla2.errors import ConfigurationError

if TYPE_CHECKING:
    from gvla2.geometry.views import Observation
    from gvla2.planning.contracts import Perceiver
    from gvla2.planning.scene import Box, Scene

NOTE = "This scene is the simulator's ground truth (perceiver=oracle), not perceived: do not use its results."


class OraclePerceiver:
    """Gives the true scene of a simulator, including unseen objects; for debugging, and every result says so.

    Ids are o1, o2, ... by x, then y, so that no body's name leaks. Raises :class:`ConfigurationError` for a ``robot``
    without ground truth.
    """

    def __init__(self, config: ComponentConfig, robot: object = None) -> None:
        from gvla2.robot.backend import Truthful

        if not isinstance(robot, Truthful):
            raise ConfigurationError(
                "perceiver=oracle needs a simulated robot that exposes its true scene, such as robot=sapien_panda. "
                "With any other, choose another perceiver, such as perceiver=classical."
            )
        self._robot = robot

    def perceive(self, observation: Observation, instruction: str, workspace: Box) -> Scene:
        """The true scene; neither images nor words are used."""
        from gvla2.perception.objects import colour_word, numbered, over_workspace

        scene = self._robot.true_scene()
        inside = over_workspace(scene.objects, workspace)
        coloured = [replace(obj, colour=obj.colour or colour_word(obj.rgb)[0]) for obj in inside]
        return replace(
            scene, objects=numbered(coloured), workspace=workspace, perceiver="oracle", notes=(NOTE,)
        )


@hookimpl
def gvla2_perceivers() -> list[Component[Perceiver]]:
    """``perceiver=oracle``."""
    return [Component("oracle", ComponentConfig, OraclePerceiver, needs=("robot",))]
