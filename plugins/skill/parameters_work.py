"""Theta of the skills that work a mechanism: lids, drawers, things drawn out sideways; SI units.

| name | meaning |
|---|---|
| ``standoff`` | gap between the hand and what it takes hold of before the last, straight part |
| ``lip_depth`` | how far inside a lid's free edge the tool centre point grasps |
| ``open_angle`` | how far a lid is swung open, radians from closed |
| ``hook_depth`` | how far below a lid's free edge the tool centre point hooks behind it |
| ``let_go_angle`` | the opening from which a lid falls shut by itself, radians |
| ``pull_distance`` | how far a handle is drawn, or a thing beyond what it was stuck in |
| ``grasp_depth`` | from the outermost face of what is held down to the tool centre point |
"""

from __future__ import annotations

from gvla2.planning.arm import Hand
from gvla2.planning.scene import SceneObject

WORKING = ("open", "close", "pull", "draw")
"""Skills whose theta is given here."""

LEAN_OVER = 0.25
"""A lid that is this far past the vertical stays open or falls open, radians: its weight carries it on."""


def work_defaults(skill: str, theme: SceneObject, hand: Hand) -> dict[str, float]:
    """Theta of a working skill before memory speaks, without the speeds."""
    match skill:
        case "open":
            return _open(hand)
        case "close":
            return _close(hand)
        case "draw":
            return _draw(theme, hand)
    return _pull(theme, hand)


def _open(hand: Hand) -> dict[str, float]:
    """Grasp the lip with half of the finger pads, so that the tips end before the wall that the lip stands out over;
    swing past the vertical.
    """
    return {"standoff": hand.finger_length, "lip_depth": 0.006, "open_angle": 1.57 + LEAN_OVER}


def _close(hand: Hand) -> dict[str, float]:
    """Hook a pad's length below the edge; from a radian on a lid's weight is well past the hinge."""
    return {"standoff": hand.finger_length, "hook_depth": 0.012, "let_go_angle": 1.0}


def _pull(theme: SceneObject, hand: Hand) -> dict[str, float]:
    """15 cm: a drawer is open when a hand gets into it, and few are less deep."""
    return {"standoff": hand.finger_length, "grasp_depth": 0.006, "pull_distance": 0.15}


def _draw(theme: SceneObject, hand: Hand) -> dict[str, float]:
    """Held two fingers' breadths from its free end at most, at half its height; drawn out 2 cm beyond being free."""
    height = theme.top - theme.bottom
    return {
        "standoff": hand.finger_length,
        "grasp_depth": min(0.5 * height, hand.finger_length - hand.tip_beyond_tcp - 0.005),
        "end_distance": hand.finger_breadth,
        "pull_distance": 0.02,
        "transit_clearance": 0.03,
        "place_height": 0.004,
    }
