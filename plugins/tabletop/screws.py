"""The scripted solution of lids and caps: grasped from above, turned, lifted, put down if required."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from gvla2.geometry.transform import FloatArray, rigid
from gvla2.planning.arm import Arm
from gvla2.planning.trajectory import Waypoint, grasp_rotation
from gvla2.robot.task import Solution, WorldState
from gvla2_plugins.tabletop.moves import DOWN, UP, around, best_path, raised, through

STEP = np.deg2rad(45.0)


def unscrew(
    lid: str,
    jar: str,
    turns: Sequence[float],
    depth: float,
    lift: float,
    *,
    square: bool,
    put: tuple[str, float] | None = None,
) -> Solution:
    """Turn ``lid`` by one of ``turns`` (radians about up) in one go, and lift it by ``lift``; metres.

    ``depth`` of the tool below the lid's middle; ``square`` lids are grasped on their faces only. ``put`` names the
    body on whose origin the lid, of that height, is put down afterwards.
    """

    def path(pose: FloatArray, closing: FloatArray, turn: float) -> list[FloatArray]:
        grasp = rigid(grasp_rotation(DOWN, closing), pose[:3, 3] - depth * UP)
        count = int(np.ceil(abs(turn) / STEP))
        turned = [
            rigid(Rotation.from_rotvec(UP * turn * i / count).as_matrix() @ grasp[:3, :3], grasp[:3, 3])
            for i in range(1, count + 1)
        ]
        return [raised(grasp, 0.08), grasp, *turned, raised(turned[-1], lift)]

    def solve(world: WorldState, arm: Arm) -> Iterator[list[Waypoint]]:
        pose = world.pose(lid)
        closings = around(UP, pose[:3, 0], 4 if square else 12)
        paths = [path(pose, closing, turn) for closing in closings for turn in turns]
        above, grasp, *turned, lifted = paths[best_path(arm, paths)]
        near = {lid, jar, "table"}
        yield [
            *through("approach", [above], 1.0, free=True, contacts=near),
            *through("reach", [grasp], 1.0, speed=0.1, contacts=near),
            *through("grasp", [grasp], 0.0, contacts=near),
            *through("turn", turned, 0.0, contacts=near),
            *through("lift", [lifted], 0.0, contacts=near, carries=lid),
        ]
        if put is not None:
            goal, height = put
            down = lifted.copy()
            down[:3, 3] = world.pose(goal)[:3, 3] + UP * (height / 2 - depth + 0.004)
            yield [
                *through("carry", [raised(down, 0.12)], 0.0, free=True, contacts=near, carries=lid),
                *through("lower", [down], 0.0, speed=0.1, contacts=near, carries=lid),
                *through("release", [down], 1.0, contacts=near),
                *through("leave", [raised(down, 0.08)], 1.0, contacts=near),
            ]

    return solve
