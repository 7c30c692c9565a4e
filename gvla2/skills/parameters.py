"""The parameters theta of a motion: defaults from the gripper's and the object's geometry, SI units.

They are targets. A motion stops short if it must: the fingertips stay 4 mm above the table whatever ``grasp_depth``
says, and a press ends above what the button stands on (:func:`limited`). None is tuned to a task. Memory changes them
by :func:`gvla2.planning.effects.apply_effects`: it stores those that scale with a side of the object as shares of that
side, and all others in SI units.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import TYPE_CHECKING

from gvla2.planning.calls import OPTION_RANGES, SkillOptions
from gvla2.planning.skill import TABLE_GAP, Parameter

if TYPE_CHECKING:
    from gvla2.planning.arm import Hand
    from gvla2.planning.effects import Scale
    from gvla2.planning.scene import Scene, SceneObject

PALM_GAP = 0.005
"""Least gap between the palm and what is between the fingers, metres."""

PRESS_GAP = 0.0012
"""Least height of the fingertips above what a button stands on, metres: hardly more than the 1 mm that the checks
require on straight motions, since a button may travel nearly its whole height."""

PRESS_DEPTH = 0.010
"""Usual depth of a press, metres: few buttons travel further."""

LEAST_SIDE = 0.002
"""Shorter perceived sides are unreliable, metres."""

_TABLE: Mapping[str, tuple[str, str, float, float]] = {
    "standoff": ("m", "gap between hand and object before the last, straight part", 0.0, 0.2),
    "approach_tilt": ("rad", "lean of the approach from straight down", 0.0, 1.57),
    "grasp_depth": ("m", "from the top (or front) of the object to the tool", 0.0, 0.3),
    "grasp_fraction": ("", "where along its longer side it is grasped, 0 to 1", 0.0, 1.0),
    "lift_height": ("m", "how far it is lifted", *OPTION_RANGES["lift_height"][:2]),
    "transit_clearance": ("m", "gap between what is carried and the highest object", 0.0, 0.3),
    "place_height": ("m", "gap under the object when the hand opens", 0.0, 0.1),
    "turn": ("rad", "by how much a cap is turned, against the clock from above", -6.28, 6.28),
    "insert_depth": ("m", "how far the hole goes over a post before release", 0.0, 0.2),
    "push_height": ("m", "gap between fingertips and table while pushing", 0.0, 0.2),
    "push_overshoot": ("m", "how far beyond the goal it is pushed", -0.1, 0.1),
    "press_depth": ("m", "how far below a button's top the fingertips go", 0.0, 0.03),
    "press_seconds": ("s", "how long a button is held down", 0.0, 5.0),
    "lip_depth": ("m", "how far inside a lid's free edge it is grasped", 0.0, 0.03),
    "open_angle": ("rad", "how far a lid is swung open, from closed", 0.2, 3.0),
    "lever_turn": ("rad", "how far the lever of a door is turned down", 0.0, 1.57),
    "hook_depth": ("m", "how far below a lid's free edge the fingers hook", 0.0, 0.05),
    "let_go_angle": ("rad", "opening from which a lid falls shut by itself", 0.0, 2.0),
    "pull_distance": ("m", "how far it is pulled (or drawn beyond being free)", 0.0, 0.4),
    "unlatch_lift": ("m", "how far a handle is lifted, held, before it is pulled", 0.0, 0.04),
    "end_distance": ("m", "how far from its free end it is held", 0.0, 0.1),
    "speed": ("m/s", "of the tool in the open", *OPTION_RANGES["speed"][:2]),
    "contact_speed": ("m/s", "of the tool where it touches", *OPTION_RANGES["contact_speed"][:2]),
}  # fmt: skip
PARAMETERS: Mapping[str, Parameter] = MappingProxyType(
    {n: Parameter(n, *about) for n, about in _TABLE.items()}
)
"""All parameters of the standard skills, by name."""


def deepest(hand: Hand) -> float:
    """Greatest depth of the tool below the top of what is grasped, metres: the palm stays above it."""
    return hand.finger_length - hand.tip_beyond_tcp - PALM_GAP


def defaults(
    skill: str, names: Sequence[str], theme: SceneObject, hand: Hand, options: SkillOptions
) -> dict[str, float]:
    """The parameters ``names`` of a standard skill, without memory.

    An object is grasped at half height, where it does not tip, or less deep if the palm would touch its top. The
    standoff is a finger's length: the last, straight part then starts with the fingers above the object. A push is low,
    so that friction does not tip the object, but with the palm above its top.
    """
    height, deep = theme.top - theme.bottom, deepest(hand)
    over_top = height - hand.finger_length + PALM_GAP
    joint = theme.joint
    rest, back = (joint.reach - joint.position, -joint.position) if joint is not None else (0.0, 0.0)
    slides = joint is not None and joint.slides
    values = {
        "standoff": hand.finger_length,
        "approach_tilt": 0.0,
        "grasp_depth": min(0.5 * height, deep),
        "grasp_fraction": 0.5,
        "lift_height": options.lift_height,
        # Above the highest object: the motion planner's margin, errors of perceived heights and some swing.
        "transit_clearance": 0.05,
        # Twice the depth camera's error, so that the object is not pressed into its support and does not bounce.
        "place_height": 0.005,
        # 165 degrees, counterclockwise seen from above, as right-handed threads open; the wrist makes nearly two such.
        # A knob goes to its farther end.
        "turn": 2.88 if joint is None or slides else max(rest, back, key=abs),
        "insert_depth": min(2.0 * height, 0.7 * deep),  # the object slides the rest of the way by its weight
        "push_height": max(2 * TABLE_GAP, min(over_top, 0.5 * height)),
        "push_overshoot": 0.0,
        "press_depth": PRESS_DEPTH,
        "press_seconds": 0.0,  # few buttons must be held down
        "lip_depth": 0.006,  # half of the finger pads, so that the tips end before the wall under the lip
        "open_angle": 1.82,  # a quarter of a radian past the vertical, where its weight holds the lid
        "lever_turn": 1.2,  # to the stop of most
        "hook_depth": 0.012,  # a pad's length
        "let_go_angle": 1.0,  # from here a lid falls shut by its weight
        "pull_distance": rest if slides else 0.15,  # a hand fits into the open drawer, and few are shorter
        "unlatch_lift": 0.0,  # few drawers have a catch
        "end_distance": hand.finger_breadth,
        "speed": options.speed,
        "contact_speed": options.contact_speed,
    }
    match skill:
        case "twist":  # the pads touch a cap's whole side; the lift clears what it closed
            values |= {"grasp_depth": min(0.8 * height, deep), "lift_height": 0.12}
        case "insert":  # as low as the table allows
            values |= {"grasp_depth": height}
        case "push":
            # The palm is deeper than the fingers, and passes 15 mm behind the object on the way down.
            values |= {"standoff": max(0.0, 0.5 * (hand.palm_depth - hand.finger_breadth)) + 0.015}
        case "pull":
            values |= {"grasp_depth": 0.006}
        case "draw":  # beyond what holds it
            values |= {"pull_distance": 0.02, "transit_clearance": 0.03, "place_height": 0.004}
    return {name: values[name] for name in names}


def scales(
    scaled: Mapping[str, str], theta: Mapping[str, float], lengths: Mapping[str, float]
) -> dict[str, Scale]:
    """The side of the object that each parameter scales with, and that side's length."""
    return {
        name: (side, lengths[side])
        for name, side in scaled.items()
        if name in theta and lengths.get(side, 0.0) >= LEAST_SIDE
    }


def limited(theta: dict[str, float], theme: SceneObject, scene: Scene) -> tuple[dict[str, float], list[str]]:
    """Theta limited to what the scene allows, and a sentence for each change.

    The fingers are wider than a button: deeper than its height they would touch what it stands on, its whole or
    whatever is under it.
    """
    if "press_depth" not in theta:
        return theta, []
    below = [o.top for o in scene.objects if o.id == theme.parent and o.top < theme.top]
    height = theme.top - max([theme.bottom, *below])
    room = max(0.0, height - PRESS_GAP)
    if theta["press_depth"] <= room:
        return theta, []
    note = (
        f"press_depth: {theta['press_depth']:.4g} -> {room:.4g}, since {theme.label} stands out by "
        f"{1e3 * height:.1f} mm"
    )
    return {**theta, "press_depth": room}, [note]
