"""The parameters theta of a motion: defaults from the gripper's and the object's geometry, SI units.

They are targets. A motion stops short if it must: the fingertips stay 4 mm above the table whatever ``grasp_depth``
says, and a press ends above what the button stands on (:func:`limited`). None is tuned to a task. Memory changes them
by :func:`gvla2.planning.effects.apply_effects`: it stores those that scale with a side of the object as shares of that
side, and all others in SI units. Meanings and units are in :mod:`gvla2.skills.table`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from gvla2.planning.skill import TABLE_GAP

if TYPE_CHECKING:
    from gvla2.planning.arm import Hand
    from gvla2.planning.calls import SkillOptions
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

USUAL: Mapping[str, float] = {
    "approach_tilt": 0.0,
    "grasp_fraction": 0.5,
    # Above the highest object: the motion planner's margin, errors of perceived heights and some swing.
    "transit_clearance": 0.05,
    # Above the support: twice the depth camera's error, so that the object is not pressed into it and does not bounce.
    "place_height": 0.005,
    # 165 degrees, counterclockwise seen from above, as right-handed threads open; the wrist can make nearly two such.
    "turn": 2.88,
    "push_overshoot": 0.0,
    "press_depth": PRESS_DEPTH,
    "press_seconds": 0.0,  # few buttons must be held down
    "lip_depth": 0.006,  # half of the finger pads, so that the tips end before the wall under the lip
    "open_angle": 1.82,  # a quarter of a radian past the vertical, where its weight holds the lid
    "hook_depth": 0.012,  # a pad's length
    "let_go_angle": 1.0,  # from here a lid falls shut by its weight
    "pull_distance": 0.15,  # a hand fits into the open drawer, and few are shorter
    "unlatch_lift": 0.0,  # few drawers have a catch
}
"""Values that geometry does not determine."""


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
    by_geometry = {
        "standoff": hand.finger_length,
        "grasp_depth": min(0.5 * height, deep),
        "insert_depth": min(2.0 * height, 0.7 * deep),  # the object slides the rest of the way by its weight
        "push_height": max(2 * TABLE_GAP, min(over_top, 0.5 * height)),
        "end_distance": hand.finger_breadth,
        "lift_height": options.lift_height,
        "speed": options.speed,
        "contact_speed": options.contact_speed,
    }
    own: Mapping[str, Mapping[str, float]] = {
        # The pads touch a cap's whole side; the lift clears what it closed.
        "twist": {"grasp_depth": min(0.8 * height, deep), "lift_height": 0.12},
        "insert": {"grasp_depth": height},  # as low as the table allows
        # The palm is deeper than the fingers, and passes 15 mm behind the object on the way down.
        "push": {"standoff": max(0.0, 0.5 * (hand.palm_depth - hand.finger_breadth)) + 0.015},
        "pull": {"grasp_depth": 0.006},
        # Beyond what holds it.
        "draw": {"pull_distance": 0.02, "transit_clearance": 0.03, "place_height": 0.004},
    }
    values = {**USUAL, **by_geometry, **own.get(skill, {}), **_by_joint(theme)}
    return {name: values[name] for name in names}


def _by_joint(theme: SceneObject) -> dict[str, float]:
    """What a known joint determines: a drawer comes all the way, a knob goes to its farther end."""
    if theme.joint is None:
        return {}
    rest, back = theme.joint.reach - theme.joint.position, -theme.joint.position
    return {"pull_distance": rest} if theme.joint.slides else {"turn": rest if rest > -back else back}


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
