"""Grasp from above, carry, set down: blocks and whatever stands and is narrow enough."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from gvla2.geometry.transform import FloatArray
from gvla2.planning.arm import Arm
from gvla2.planning.trajectory import Waypoint
from gvla2.robot.task import Solution, WorldState
from gvla2_plugins.tabletop.demonstrations.moves import DOWN, UP, around, best_closing, both, pick, stop

LIFT, DROP = 0.15, 0.004


def put_on(
    thing: str,
    goal: str,
    size: FloatArray,
    *,
    depth: float | None = None,
    lift: float = LIFT,
    rise: float = 0.0,
    base: bool = False,
    offset: FloatArray | None = None,
    contacts: Sequence[str] = (),
) -> Solution:
    """Put a box-like ``thing`` (full sides (3,) of ``size``, upright) on the origin of the body ``goal``.

    ``depth`` of the tool below the thing's top, half its height at most; ``rise`` of its underside above the
    goal's origin; ``base``: the thing's own origin is in its underside, not its middle; ``offset`` (3,) from the
    goal's origin, in its frame.
    """

    def solve(world: WorldState, arm: Arm) -> Iterator[list[Waypoint]]:
        pose, target = world.pose(thing), world.pose(goal)
        top = pose[:3, 3] + UP * size[2] * (1.0 if base else 0.5)
        grasp = top - UP * min(0.5 * size[2], depth or 0.03)
        place = target[:3, 3] + (0.0 if offset is None else target[:3, :3] @ offset)
        release = place + UP * (rise + DROP + size[2] + (grasp - top)[2])
        narrow = min(0.076, float(np.min(size[:2])) + 0.01)
        sides = [pose[:3, i] for i in (0, 1) if size[i] < narrow]
        above = release + UP * (lift - DROP)
        closing = best_closing(arm, [grasp, grasp + UP * lift], both(*sides))
        # How the thing is turned when it is set down does not matter; how far the wrist can go does.
        turned = best_closing(arm, [above, release], around(UP, closing, 8))
        touched = {thing, goal, "table", *contacts}
        yield [
            *pick(thing, grasp, closing, lift, contacts=touched),
            stop("carry", above, 0.0, DOWN, turned, free=True, carries=thing, contacts=touched),
            stop("lower", release, 0.0, speed=0.1, carries=thing, contacts=touched),
            stop("release", release, 1.0, contacts=touched),
            stop("leave", above, 1.0, contacts=touched),
        ]

    return solve


def hold_up(thing: str, size: FloatArray, lift: float) -> Solution:
    """Grasp a box-like ``thing`` (full sides (3,), origin in its middle) from above and hold it up."""

    def solve(world: WorldState, arm: Arm) -> Iterator[list[Waypoint]]:
        pose = world.pose(thing)
        grasp = pose[:3, 3] + UP * max(0.0, 0.5 * size[2] - 0.03)
        sides = both(*(pose[:3, i] for i in (0, 1) if size[i] < 0.076))
        yield pick(thing, grasp, best_closing(arm, [grasp, grasp + UP * lift], sides), lift)

    return solve
