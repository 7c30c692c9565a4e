"""Closed fingers that push or press: a block over the table, a button into its lamp."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from gvla2.geometry.transform import FloatArray, transform_points
from gvla2.planning.arm import Arm
from gvla2.planning.trajectory import Waypoint
from gvla2.robot.task import Solution, WorldState
from gvla2_plugins.tabletop.demonstrations.moves import DOWN, UP, around, best_closing, stop


def press(button: str, beside: str, top: float, travel: float) -> Solution:
    """Press the body ``button``, whose upper face is ``top`` over its origin, down by ``travel``; metres."""

    def solve(world: WorldState, arm: Arm) -> Iterator[list[Waypoint]]:
        pose = world.pose(button)
        face = transform_points(pose, (0.0, 0.0, top)) + UP * arm.hand.tip_beyond_tcp
        down = face - UP * travel
        closing = best_closing(arm, [face + 0.06 * UP, down], around(UP, pose[:3, 0], 8))
        near = {button, beside, "table"}
        yield [
            stop("approach", face + 0.06 * UP, 0.0, DOWN, closing, free=True, contacts=near),
            stop("press", down, 0.0, speed=0.05, contacts=near),
            stop("leave", face + 0.06 * UP, 0.0, contacts=near),
        ]

    return solve


def push_to(thing: str, goal: str, size: float) -> Solution:
    """Push the cube ``thing`` of that ``size`` over the table until its middle is on the origin of ``goal``.

    Two pushes: the second corrects the first one's drift from friction.
    """

    def solve(world: WorldState, arm: Arm) -> Iterator[list[Waypoint]]:
        for share in (0.6, 1.0):
            block, target = world.pose(thing), world.pose(goal)[:3, 3]
            way = (target - block[:3, 3]) * (1.0, 1.0, 0.0)
            ahead = way / np.linalg.norm(way)
            behind = _half_width(block, ahead, size) + 0.5 * arm.hand.finger_breadth
            height = UP * (block[2, 3] - 0.2 * size)
            flat = np.array([1.0, 1.0, 0.0])
            start = block[:3, 3] * flat - ahead * (behind + 0.025) + height
            end = (block[:3, 3] + share * way) * flat - ahead * behind + height
            across = np.cross(UP, ahead)
            closing = best_closing(arm, [start + 0.08 * UP, start, end], [across, -across])
            near = {thing, "table"}
            yield [
                stop("approach", start + 0.08 * UP, 0.0, DOWN, closing, free=True),
                stop("lower", start, 0.0, contacts=near),
                stop("push", end, 0.0, speed=0.1, contacts=near),
                stop("back", end - 0.04 * ahead, 0.0, contacts=near),
                stop("leave", end - 0.04 * ahead + 0.1 * UP, 0.0, contacts=near),
            ]

    return solve


def _half_width(block: FloatArray, ahead: FloatArray, size: float) -> float:
    """From the middle of a square to its edge, against the direction ``ahead`` (3,), metres."""
    return 0.5 * size / float(np.max(np.abs(block[:3, :2].T @ ahead)))
