"""The numbers theta that shape a motion: defaults from the gripper's and the object's geometry, SI units.

They are what is asked for. The motion stops short where it must: the fingertips stay 4 mm above the table whatever
``grasp_depth`` says, and a press ends before what the button stands on (:func:`limited`). None is tuned to a task;
the derivations stand at each function. Memory changes them by :func:`gvla2.planning.effects.apply_effects`; what it
learns of those that go with a side of the object it keeps as shares of that side, of all others in SI units. What each
means, and its unit, stands in :mod:`gvla2.skills.table`.
"""

from __future__ import annotations

from collections.abc import Mapping

from gvla2.planning.arm import Hand
from gvla2.planning.calls import SkillOptions
from gvla2.planning.effects import Scale
from gvla2.planning.scene import Scene, SceneObject

TABLE_GAP = 0.004
"""The fingertips' end stays this far above the table, metres: about twice what depth cameras err by."""

PALM_GAP = 0.005
"""The palm stays this far above what the fingers reach around, metres."""

PRESS_GAP = 0.0012
"""The fingertips' end stays this far above what a button stands on, metres: hardly more than the 1 mm that the checks
want on straight moves, since a button may travel nearly all of its height."""

PRESS_DEPTH = 0.010
"""How deep a button is pressed as a rule, metres: few travel further."""

LEAN_OVER = 0.25
"""A lid that is this far past the vertical stays open or falls open, radians: its weight carries it on."""

LEAST_SIDE = 0.002
"""Perceived sides that are shorter tell nothing, metres."""


def deepest(hand: Hand) -> float:
    """The greatest depth of the tool below the top of what the fingers reach around, metres; the palm stays clear."""
    return hand.finger_length - hand.tip_beyond_tcp - PALM_GAP


def of_pick(theme: SceneObject, hand: Hand, options: SkillOptions) -> dict[str, float]:
    """Grasped, and lifted as high as the options say."""
    return {**_grasp(theme, hand), "lift_height": options.lift_height, **speeds(options)}


def of_place(theme: SceneObject, hand: Hand, options: SkillOptions) -> dict[str, float]:
    """Grasped, carried over everything, put down."""
    return {**_grasp(theme, hand), **_carry(), **speeds(options)}


def speeds(options: SkillOptions) -> dict[str, float]:
    """Of the tool in the open, and where it touches."""
    return {"speed": options.speed, "contact_speed": options.contact_speed}


def _grasp(theme: SceneObject, hand: Hand) -> dict[str, float]:
    """Grasp at half height, where a squeezed object does not tip; less deep when the palm would touch its top.

    The standoff is a finger's length: the last, straight part then starts with the whole fingers above the object,
    and sideways errors of the planned part cannot knock it over.
    """
    return {
        "standoff": hand.finger_length,
        "approach_tilt": 0.0,
        "grasp_depth": min(0.5 * (theme.top - theme.bottom), deepest(hand)),
        "grasp_fraction": 0.5,
    }


def _carry() -> dict[str, float]:
    """5 cm above the highest thing: the motion planner's margin, the perceived heights' errors and some swing.

    5 mm above the support: twice the depth cameras' error, so that nothing is pressed into the support, and too
    little for the object to bounce.
    """
    return {"transit_clearance": 0.05, "place_height": 0.005}


def of_twist(theme: SceneObject, hand: Hand, options: SkillOptions) -> dict[str, float]:
    """Fingertips just below a cap's underside, where their pads meet all of its side, and a turn of 165 degrees.

    A cap comes loose within half a turn; the wrist makes nearly two, but the hand must also get there and away. Seen
    from above it turns against the clock, as right-handed threads open. Lifted by its own breadth and a finger's length
    it is clear of what it closed.
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
    """As low as the table lets the hand; let go where the hole is two thicknesses down the post, so that what slides
    the rest of the way by its weight cannot cant on the post's end.
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

    The palm is deeper than the fingers. Coming down behind the object it must pass by, 15 mm away; while
    pushing, the fingers go as low as lets it pass over the top, never above half height.
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
    """Buttons travel a centimetre at most: 10 mm below the top presses any of them home, where they are high enough.

    Beyond its stop a button does not yield; the arm's compliance takes up the rest. Few have to be held down.
    """
    del theme
    return {
        "standoff": hand.finger_length,
        "press_depth": PRESS_DEPTH,
        "press_seconds": 0.0,
        **speeds(options),
    }


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
    """The side of the object that each parameter goes with, as the skill says, and its length."""
    return {
        name: (side, lengths[side])
        for name, side in scaled.items()
        if name in theta and lengths.get(side, 0.0) >= LEAST_SIDE
    }


def limited(theta: dict[str, float], theme: SceneObject, scene: Scene) -> tuple[dict[str, float], list[str]]:
    """Theta limited to what the scene allows, and a sentence for each change.

    The fingers are wider than a button: pressed lower than its height they would meet what it stands on, which is
    the thing that it is a part of, or whatever its own lower side rests on.
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
