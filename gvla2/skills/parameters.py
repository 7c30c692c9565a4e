"""The parameters theta of a motion: defaults from the gripper's and the object's geometry, SI units.

They are targets. A motion stops short if it must: the fingertips stay 4 mm above the table whatever ``grasp_depth``
says, and a press ends above what the button stands on (:func:`limited`). None is tuned to a task; each function derives
its own. Memory changes them by :func:`gvla2.planning.effects.apply_effects`: it stores those that scale with a side of
the object as shares of that side, and all others in SI units. Meanings and units are in :mod:`gvla2.skills.table`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from gvla2.planning.skill import TABLE_GAP

if TYPE_CHECKING:
    from collections.abc import Mapping

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

LEAN_OVER = 0.25
"""A lid this far past the vertical stays open, radians: its weight holds it."""

LEAST_SIDE = 0.002
"""Shorter perceived sides are unreliable, metres."""


def deepest(hand: Hand) -> float:
    """Greatest depth of the tool below the top of what is grasped, metres: the palm stays above it."""
    return hand.finger_length - hand.tip_beyond_tcp - PALM_GAP


def of_pick(theme: SceneObject, hand: Hand, options: SkillOptions) -> dict[str, float]:
    """Grasp, and the options' lift height."""
    return {**_grasp(theme, hand), "lift_height": options.lift_height, **speeds(options)}


def of_place(theme: SceneObject, hand: Hand, options: SkillOptions) -> dict[str, float]:
    """Grasp, carry over everything, put down."""
    return {**_grasp(theme, hand), **_carry(), **speeds(options)}


def speeds(options: SkillOptions) -> dict[str, float]:
    """Speeds of the tool in free space and in contact."""
    return {"speed": options.speed, "contact_speed": options.contact_speed}


def _grasp(theme: SceneObject, hand: Hand) -> dict[str, float]:
    """Grasp at half height, where a squeezed object does not tip; less deep if the palm would touch its top.

    The standoff is a finger's length: the last, straight part then starts with the fingers above the object, and
    sideways errors of the planned part cannot knock it over.
    """
    return {
        "standoff": hand.finger_length,
        "approach_tilt": 0.0,
        "grasp_depth": min(0.5 * (theme.top - theme.bottom), deepest(hand)),
        "grasp_fraction": 0.5,
    }


def _carry() -> dict[str, float]:
    """5 cm above the highest object: the motion planner's margin, errors of perceived heights and some swing.

    5 mm above the support: twice the depth camera's error, so that the object is not pressed into the support, and too
    little for it to bounce.
    """
    return {"transit_clearance": 0.05, "place_height": 0.005}


def of_twist(theme: SceneObject, hand: Hand, options: SkillOptions) -> dict[str, float]:
    """Fingertips at 80 % of the cap's height, so that the pads touch its whole side, and a turn of 165 degrees.

    A cap comes loose within half a turn; the wrist can make nearly two, but the hand must also get there and away. It
    turns counterclockwise seen from above, as right-handed threads open. The lift clears what the cap closed.
    """
    return {
        **_grasp(theme, hand),
        "grasp_depth": min(0.8 * (theme.top - theme.bottom), deepest(hand)),
        **_carry(),
        "turn": 2.88,
        "lift_height": 0.12,
        **speeds(options),
    }


def of_insert(theme: SceneObject, hand: Hand, options: SkillOptions) -> dict[str, float]:
    """Grasp as low as the table allows; release with the hole two thicknesses down the post, so that the object slides
    the rest of the way by its weight without jamming on the post's end.
    """
    height = theme.top - theme.bottom
    return {
        **_grasp(theme, hand),
        **_carry(),
        "grasp_depth": height,
        "insert_depth": min(2.0 * height, 0.7 * deepest(hand)),
        **speeds(options),
    }


def of_push(theme: SceneObject, hand: Hand, options: SkillOptions) -> dict[str, float]:
    """Push low, so that friction under the object does not tip it, but with the palm above its top.

    The palm is deeper than the fingers. On the way down behind the object it must pass 15 mm away; while pushing, it
    must pass over the top, with the fingers as low as that allows and never above half height.
    """
    height = theme.top - theme.bottom
    over_top = height - hand.finger_length + PALM_GAP
    return {
        "standoff": max(0.0, 0.5 * (hand.palm_depth - hand.finger_breadth)) + 0.015,
        "push_height": max(2 * TABLE_GAP, min(over_top, 0.5 * height)),
        "push_overshoot": 0.0,
        **speeds(options),
    }


def of_press(theme: SceneObject, hand: Hand, options: SkillOptions) -> dict[str, float]:
    """10 mm below the top: buttons travel a centimetre at most. Few must be held down.

    A button does not yield beyond its stop; the arm's compliance takes up the rest.
    """
    del theme
    return {
        "standoff": hand.finger_length,
        "press_depth": PRESS_DEPTH,
        "press_seconds": 0.0,
        **speeds(options),
    }


def of_open(theme: SceneObject, hand: Hand, options: SkillOptions) -> dict[str, float]:
    """Grasp the lip with half of the finger pads, so that the tips end before the wall under it; swing past the
    vertical.
    """
    return {
        "standoff": hand.finger_length,
        "lip_depth": 0.006,
        "open_angle": 1.57 + LEAN_OVER,
        **speeds(options),
    }


def of_close(theme: SceneObject, hand: Hand, options: SkillOptions) -> dict[str, float]:
    """Hook a pad's length below the edge; a lid open by a radian falls shut by its weight."""
    return {"standoff": hand.finger_length, "hook_depth": 0.012, "let_go_angle": 1.0, **speeds(options)}


def of_pull(theme: SceneObject, hand: Hand, options: SkillOptions) -> dict[str, float]:
    """15 cm: a hand fits into the open drawer, and few are shorter. Few have a catch."""
    return {
        "standoff": hand.finger_length,
        "grasp_depth": 0.006,
        "unlatch_lift": 0.0,
        "pull_distance": 0.15,
        **speeds(options),
    }


def of_draw(theme: SceneObject, hand: Hand, options: SkillOptions) -> dict[str, float]:
    """Grasp a finger's breadth from the free end, at half height; draw out 2 cm beyond what holds it."""
    return {
        "standoff": hand.finger_length,
        "grasp_depth": min(0.5 * (theme.top - theme.bottom), deepest(hand)),
        "end_distance": hand.finger_breadth,
        "pull_distance": 0.02,
        "transit_clearance": 0.03,
        "place_height": 0.004,
        **speeds(options),
    }


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
