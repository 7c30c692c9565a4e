"""Taking hold of a hollow thing by its wall: one finger inside, one outside."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from gvla2.geometry.transform import rigid
from gvla2.planning.arm import Arm
from gvla2.planning.trajectory import Waypoint, grasp_rotation
from gvla2.robot.task import Solution, WorldState
from gvla2_plugins.tabletop.demonstrations.moves import DOWN, UP, around, pick

DEPTH, LIFT = 0.02, 0.15


def by_the_rim(thing: str, diameter: float, height: float, wall: float) -> Solution:
    """Lift an open cylinder, its origin in the middle of its underside, by the wall."""

    def solve(world: WorldState, arm: Arm) -> Iterator[list[Waypoint]]:
        pose = world.pose(thing)
        best = (-1.0, pose[:3, 3], pose[:3, 0])
        for outward in around(UP, pose[:3, 0], 16):
            point = pose[:3, 3] + outward * (diameter - wall) / 2 + UP * (height - DEPTH)
            for closing in (outward, -outward):
                margins = [
                    -1.0 if found is None else found.limit_margin
                    for z in (0.0, LIFT)
                    for found in [arm.inverse(rigid(grasp_rotation(DOWN, closing), point + z * UP))]
                ]
                best = max(best, (min(margins), point, closing), key=lambda choice: choice[0])
        _, point, closing = best
        yield pick(thing, np.asarray(point), np.asarray(closing), LIFT)

    return solve
