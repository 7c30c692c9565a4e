"""True bodies as scene objects, named like perceived ones."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gvla2.errors import ConfigurationError
from gvla2.geometry.views import Observation
from gvla2.planning.colours import nearest_colours
from gvla2.planning.scene import Box, Scene
from gvla2.robot.backend import RobotBackend, Truthful

NOTE = "This scene is the simulator's ground truth (perceiver=oracle), not perceived: do not use its results."


class OraclePerceiver:
    """Implements :class:`gvla2.planning.contracts.Perceiver` by asking the robot's simulator.

    Ids are o1, o2, ... by x, then y, so that no body's name leaks; the scene and one of its notes say "oracle". Raises
    :class:`ConfigurationError` for a robot without ground truth.
    """

    def __init__(self, robot: RobotBackend | None) -> None:
        truthful: object = robot
        if not isinstance(truthful, Truthful):
            raise ConfigurationError(
                "perceiver=oracle needs a simulated robot that exposes its true scene, such as robot=sapien_panda. "
                "With any other, choose another perceiver, such as perceiver=classical."
            )
        self._robot = truthful

    def perceive(self, observation: Observation, instruction: str, workspace: Box) -> Scene:
        """The true scene; neither images nor words are used."""
        del observation, instruction
        scene = self._robot.true_scene()
        inside = [o for o in scene.objects if _over(workspace, o.centre)]
        ordered = sorted(inside, key=lambda o: tuple(np.round(o.centre, 3)))
        ids = {obj.id: f"o{k + 1}" for k, obj in enumerate(ordered)}
        objects = tuple(
            replace(
                o,
                id=ids[o.id],
                parent=ids.get(o.parent, ""),
                colour=o.colour or nearest_colours(o.rgb, 1)[0][0],
            )
            for o in ordered
        )
        return Scene(objects, scene.table_height, workspace, "oracle", (NOTE,))


def _over(workspace: Box, point: np.ndarray) -> bool:
    return bool(((point >= workspace.low) & (point <= workspace.high))[:2].all())
