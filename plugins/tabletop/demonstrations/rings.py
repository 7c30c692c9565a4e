"""A ring over a pillar, with 2.5 mm of clearance: grasp, measure its pose in the hand, correct, let it slide down."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from gvla2.geometry.transform import FloatArray, invert_rigid, rigid
from gvla2.planning.arm import Arm
from gvla2.planning.trajectory import Waypoint, grasp_rotation
from gvla2.robot.task import Solution, WorldState
from gvla2_plugins.tabletop.demonstrations.moves import DOWN, UP, best_path, through

TIP_ROOM = 0.0015
"""The fingertips' end stays so far above the table, metres."""

PALM_ROOM = 0.006
LIFT = 0.18


def slip_over(pillar: str, height: float, side: float, thickness: float, others: Sequence[str]) -> Solution:
    """Put the square body ``ring`` (outer ``side``, metres) over the body ``pillar`` of that ``height``."""

    def solve(world: WorldState, arm: Arm) -> Iterator[list[Waypoint]]:
        ring, post = world.pose("ring"), world.pose(pillar)
        near = {"ring", "table", *others}
        top = post[:3, 3] + UP * height / 2
        palm = arm.hand.finger_length - arm.hand.tip_beyond_tcp
        ways = []
        for hand_closing in (sign * ring[:3, i] for i in (0, 1) for sign in (1.0, -1.0)):
            lowest = ring[:3, 3] - UP * (thickness / 2 - TIP_ROOM - arm.hand.tip_beyond_tcp)
            grasp = rigid(grasp_rotation(DOWN, hand_closing), lowest)
            for over_closing in (sign * post[:3, i] for i in (0, 1) for sign in (1.0, -1.0)):
                over = rigid(grasp_rotation(DOWN, over_closing), top + UP * (palm + PALM_ROOM))
                ways.append((grasp, over))
        grasp, over = ways[best_path(arm, [[_raised(g, 0.06), g, _raised(g, LIFT)] for g, _ in ways])]
        reachable = [o for g, o in ways if g is grasp]
        over = reachable[best_path(arm, [[_raised(o, 0.05), o] for o in reachable])]
        yield [
            *through("approach", [_raised(grasp, 0.06)], 1.0, free=True, contacts=near),
            *through("reach", [grasp], 1.0, speed=0.08, contacts=near),
            *through("grasp", [grasp], 0.0, contacts=near),
            *through("lift", [_raised(grasp, LIFT)], 0.0, contacts=near, carries="ring"),
            *through("carry", [_raised(over, 0.05)], 0.0, free=True, contacts=near, carries="ring"),
        ]
        # How the ring lies in the hand now: bring its middle, not the hand's, over the pillar.
        hand = _raised(over, 0.05)
        tool_from_ring = invert_rigid(hand) @ world.pose("ring")
        over = _centred(over, tool_from_ring, top)
        yield [
            *through("align", [_raised(over, 0.05)], 0.0, speed=0.05, contacts=near, tolerance=0.003),
            *through("insert", [over], 0.0, speed=0.05, contacts=near),
            *through("release", [over], 0.8, contacts=near),
            *through("leave", [_raised(over, 0.06)], 0.8, contacts=near),
        ]

    return solve


def _centred(over: FloatArray, tool_from_ring: FloatArray, axis: FloatArray) -> FloatArray:
    """The tool pose (4, 4) moved sideways until the ring's middle is on the vertical through ``axis`` (3,)."""
    off = (over @ tool_from_ring)[:3, 3] - axis
    return rigid(translation=(-float(off[0]), -float(off[1]), 0.0)) @ over


def _raised(pose: FloatArray, height: float) -> FloatArray:
    return rigid(translation=(0.0, 0.0, height)) @ np.asarray(pose)
