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
        from gvla2.planning.colours import nearest_colours
        from gvla2.planning.scene import Scene

        scene = self._robot.true_scene()
        inside = [
            o for o in scene.objects if ((o.centre >= workspace.low) & (o.centre <= workspace.high))[:2].all()
        ]
        inside.sort(key=lambda o: tuple(o.centre.round(3)))
        ids = {obj.id: f"o{k + 1}" for k, obj in enumerate(inside)}
        objects = tuple(
            replace(
                o,
                id=ids[o.id],
                parent=ids.get(o.parent, ""),
                colour=o.colour or nearest_colours(o.rgb, 1)[0][0],
            )
            for o in inside
        )
        return Scene(objects, scene.table_height, workspace, "oracle", (NOTE,))


@hookimpl
def gvla2_perceivers() -> list[Component[Perceiver]]:
    """``perceiver=oracle``."""
    return [Component("oracle", ComponentConfig, OraclePerceiver, needs=("robot",))]
