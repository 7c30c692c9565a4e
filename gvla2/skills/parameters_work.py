"""Theta of the skills that work a mechanism: lids, drawers, things drawn out sideways; SI units."""

from __future__ import annotations

from gvla2.planning.arm import Hand
from gvla2.planning.calls import SkillOptions
from gvla2.planning.scene import SceneObject
from gvla2.skills.parameters import speeds

LEAN_OVER = 0.25
"""A lid that is this far past the vertical stays open or falls open, radians: its weight carries it on."""


def of_open(theme: SceneObject, hand: Hand, options: SkillOptions) -> dict[str, float]:
    """Grasp the lip with half of the finger pads, so that the tips end before the wall that the lip stands out over;
    swing past the vertical.
    """
    return {
        "standoff": hand.finger_length,
        "lip_depth": 0.006,
        "open_angle": 1.57 + LEAN_OVER,
        **speeds(options),
    }


def of_close(theme: SceneObject, hand: Hand, options: SkillOptions) -> dict[str, float]:
    """Hook a pad's length below the edge; from a radian on a lid's weight is well past the hinge."""
    return {"standoff": hand.finger_length, "hook_depth": 0.012, "let_go_angle": 1.0, **speeds(options)}


def of_pull(theme: SceneObject, hand: Hand, options: SkillOptions) -> dict[str, float]:
    """15 cm: a drawer is open when a hand gets into it, and few are less deep. Few have a catch to be lifted."""
    return {
        "standoff": hand.finger_length,
        "grasp_depth": 0.006,
        "unlatch_lift": 0.0,
        "pull_distance": 0.15,
        **speeds(options),
    }


def of_draw(theme: SceneObject, hand: Hand, options: SkillOptions) -> dict[str, float]:
    """Held two fingers' breadths from its free end at most, at half its height; drawn out 2 cm beyond being free."""
    height = theme.top - theme.bottom
    return {
        "standoff": hand.finger_length,
        "grasp_depth": min(0.5 * height, hand.finger_length - hand.tip_beyond_tcp - 0.005),
        "end_distance": hand.finger_breadth,
        "pull_distance": 0.02,
        "transit_clearance": 0.03,
        "place_height": 0.004,
        **speeds(options),
    }
