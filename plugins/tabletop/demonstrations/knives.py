"""A knife out of its block: grasped from aside, drawn along its slot, turned level with the hand, laid down."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from gvla2.geometry.transform import FloatArray, rigid
from gvla2.planning.arm import Arm
from gvla2.planning.trajectory import Waypoint, grasp_rotation
from gvla2.robot.task import Solution, WorldState
from gvla2_plugins.tabletop.demonstrations.moves import DOWN, UP, around, best_path, through

STANDOFF, ABOVE, ON_GRIP = 0.07, 0.10, 0.010
"""Metres: before the grip, over the board; how far above the grip's middle the hand takes it."""

_HALF_GRIP_DEPTH = 0.0115

Paths = list[tuple[list[FloatArray], list[FloatArray]]]


def knife_paths(knife: FloatArray, board: FloatArray, scale: float, thickness: float, blade: float) -> Paths:
    """Ways to do it, each as tool poses (4, 4) out of the block and poses down to the board.

    The hand comes from either side of the grip, flat, and lays the knife along any of eight directions.
    """
    ways: Paths = []
    axis, middle = knife[:3, 2], knife[:3, 3] + scale * ON_GRIP * knife[:3, 2]
    for approach in (knife[:3, 0], -knife[:3, 0]):
        for sign in (1.0, -1.0):
            turned = grasp_rotation(approach, sign * knife[:3, 1])
            grasp = rigid(turned, middle)
            out = rigid(turned, middle + axis * (scale * blade + 0.03))
            # The blade lies along -axis in the hand: about the hand's x, one way or the other.
            blade_in_hand = turned.T @ -axis
            for along in around(UP, board[:3, 0], 8):
                # Pointing down, the hand is turned so that the blade points `along`.
                laid = _pointing_down(along, blade_in_hand[0] > 0)
                grip_at = board[:3, 3] - along * scale * blade / 3
                down = rigid(laid, grip_at + UP * (thickness + scale * _HALF_GRIP_DEPTH + 0.003))
                before = rigid(turned, middle - STANDOFF * approach)
                ways.append(([before, grasp, out], [_raised(down, ABOVE), down]))
    return ways


def draw_knife(board: FloatArray, scale: float, thickness: float, blade: float) -> Solution:
    """Draw the body ``knife`` out of the body ``block`` and lay it on the body ``board``."""

    def solve(world: WorldState, arm: Arm) -> Iterator[list[Waypoint]]:
        ways = knife_paths(world.pose("knife"), board, scale, thickness, blade)
        outs = [out for out, _ in ways[::8]]
        chosen = best_path(arm, outs)
        before, grasp, out = outs[chosen]
        lays = [lay for _, lay in ways[8 * chosen : 8 * chosen + 8]]
        above, down = lays[best_path(arm, lays)]
        near = {"knife", "block", "table"}
        yield [
            *through("approach", [before], 0.6, free=True),
            *through("reach", [grasp], 0.6, speed=0.1, contacts=near),
            *through("grasp", [grasp], 0.0, contacts=near),
            *through("draw", [out], 0.0, speed=0.1, contacts=near, carries="knife"),
            *through("carry", [above], 0.0, free=True, carries="knife"),
            *through("lower", [down], 0.0, speed=0.1, contacts={"board", "knife"}, carries="knife"),
            *through("release", [down], 0.6, contacts={"board", "knife"}),
            *through("leave", [above], 0.6, contacts={"board", "knife"}),
        ]

    return solve


def _pointing_down(blade: FloatArray, along_x: bool) -> FloatArray:
    """(3, 3) of a hand that points down and whose x axis is ``blade``, or its opposite."""
    x = blade if along_x else -blade
    return np.asarray(grasp_rotation(DOWN, np.cross(DOWN, x)))


def _raised(pose: FloatArray, height: float) -> FloatArray:
    return rigid(translation=UP * height) @ pose
