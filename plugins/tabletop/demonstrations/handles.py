"""A handle pulled straight: grasp the bar, back away."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from gvla2.geometry.transform import FloatArray
from gvla2.planning.arm import Arm
from gvla2.planning.trajectory import Waypoint
from gvla2.robot.task import Solution, WorldState
from gvla2_plugins.tabletop.demonstrations.moves import best_path, through


def pull_handle(thing: str, near: Sequence[str], ways: Sequence[Sequence[FloatArray]]) -> Solution:
    """One of several ways of tool poses (4, 4): before the handle, at it, pulled."""

    def solve(world: WorldState, arm: Arm) -> Iterator[list[Waypoint]]:
        before, grasp, pulled = ways[best_path(arm, ways)]
        contacts = {thing, *near, "table"}
        yield [
            *through("approach", [before], 0.6, free=True),
            *through("reach", [grasp], 0.6, speed=0.1, contacts=contacts),
            *through("grasp", [grasp], 0.0, contacts=contacts),
            *through("pull", [pulled], 0.0, speed=0.1, contacts=contacts, tolerance=0.02),
            *through("release", [pulled], 0.6, contacts=contacts),
        ]

    return solve
