"""Straight pulls: up out of a stand, out of a tower, a drawer by its handle."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from gvla2.geometry.transform import transform_points
from gvla2.planning.arm import Arm
from gvla2.planning.trajectory import Waypoint
from gvla2.robot.task import Solution, WorldState
from gvla2_plugins.tabletop.demonstrations.moves import UP, around, best_closing, pick


def pull_up(thing: str, height: float, lift: float, contacts: Sequence[str] = ()) -> Solution:
    """Grasp an upright ``thing`` from above at ``height`` over its origin and lift it by ``lift``; metres."""

    def solve(world: WorldState, arm: Arm) -> Iterator[list[Waypoint]]:
        pose = world.pose(thing)
        grasp = transform_points(pose, (0.0, 0.0, height))
        closing = best_closing(arm, [grasp, grasp + UP * lift], around(UP, pose[:3, 0], 8))
        yield pick(thing, grasp, closing, lift, contacts=contacts, standoff=0.08)

    return solve
