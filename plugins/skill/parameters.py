"""The numbers theta that shape a motion: defaults from the gripper's and the object's geometry, SI units.

| name | meaning |
|---|---|
| ``standoff`` | gap between the hand and the object before the approach's last, straight part |
| ``approach_tilt`` | lean of the approach from straight down, radians, the fingertips pointing away from the robot |
| ``grasp_depth`` | from the object's top down to the tool centre point |
| ``grasp_fraction`` | where along the object's longer side the hand grasps: 0 one end, 0.5 the middle, 1 the other |
| ``lift_height`` | how far it is lifted |
| ``transit_clearance`` | gap between what is carried and the highest thing on the table |
| ``place_height`` | gap under the object when the hand opens |
| ``turn`` | by how much a cap is turned, radians against the clock seen from above |
| ``insert_depth`` | how far the hole goes down over a post before the hand opens |
| ``push_height`` | gap between the fingertips' end and the table while pushing |
| ``push_overshoot`` | how far beyond the goal the object is pushed |
| ``press_depth`` | how far below the button's top the fingertips go |
| ``speed``, ``contact_speed`` | of the tool in the open, and where it touches, m/s |

They are what is asked for. The motion stops short where it must: the fingertips stay 4 mm above the table whatever
``grasp_depth`` says, and a press ends before what the button stands on (:func:`limited`). None is tuned to a task;
the derivations stand at each function. Memory changes them by :func:`gvla2.planning.effects.apply_effects`; what it
learns of those in :data:`SCALED` it keeps as shares of the object's height, of all others in SI units.
"""

from __future__ import annotations

from collections.abc import Mapping

from gvla2.planning.arm import Hand
from gvla2.planning.effects import Scale
from gvla2.planning.scene import Scene, SceneObject
from gvla2_plugins.skill import SkillConfig
from gvla2_plugins.skill.parameters_work import WORKING, work_defaults

TABLE_GAP = 0.004
"""The fingertips' end stays this far above the table, metres: about twice what depth cameras err by."""

PALM_GAP = 0.005
"""The palm stays this far above what the fingers reach around, metres."""

PRESS_GAP = 0.0012
"""The fingertips' end stays this far above what a button stands on, metres: hardly more than the 1 mm that the checks
want on straight moves, since a button may travel nearly all of its height."""


SCALED: Mapping[str, str] = {
    "grasp_depth": "height",
    "insert_depth": "height",
    "push_height": "height",
    "press_depth": "height",
}
"""Parameters that go with a side of the handled object: an object twice as tall is grasped twice as deep."""

OF_THE_HAND = ("pull",)
"""Skills in which the depth of a grasp is a matter of the finger pads alone: a bar is held, of whatever size."""

LEAST_SIDE = 0.002
"""Perceived sides that are shorter tell nothing, metres."""


def defaults(skill: str, theme: SceneObject, hand: Hand, config: SkillConfig) -> dict[str, float]:
    """Theta of a skill before memory speaks."""
    speeds = {"speed": config.speed, "contact_speed": config.contact_speed}
    if skill in WORKING:
        return {**work_defaults(skill, theme, hand), **speeds}
    match skill:
        case "pick":
            return {**_grasp(theme, hand), "lift_height": config.lift_height, **speeds}
        case "place":
            return {**_grasp(theme, hand), **_carry(), **speeds}
        case "twist":
            return {**_twist(theme, hand), **_carry(), **speeds}
        case "insert":
            return {**_insert(theme, hand), **speeds}
        case "push":
            return {**_push(theme, hand), **speeds}
    return {**_press(hand), **speeds}


def _grasp(theme: SceneObject, hand: Hand) -> dict[str, float]:
    """Grasp at half height, where a squeezed object does not tip; less deep when the palm would touch its top.

    The standoff is a finger's length: the last, straight part then starts with the whole fingers above the object,
    and sideways errors of the planned part cannot knock it over.
    """
    reach = hand.finger_length - hand.tip_beyond_tcp - PALM_GAP
    height = theme.top - theme.bottom
    return {
        "standoff": hand.finger_length,
        "approach_tilt": 0.0,
        "grasp_depth": min(0.5 * height, reach),
        "grasp_fraction": 0.5,
    }


def _carry() -> dict[str, float]:
    """5 cm above the highest thing: the motion planner's margin, the perceived heights' errors and some swing.

    5 mm above the support: twice the depth cameras' error, so that nothing is pressed into the support, and too
    little for the object to bounce.
    """
    return {"transit_clearance": 0.05, "place_height": 0.005}


def _twist(theme: SceneObject, hand: Hand) -> dict[str, float]:
    """Fingertips just below a cap's underside, where their pads meet all of its side, and a turn of 165 degrees.

    A cap comes loose within half a turn; the wrist makes nearly two, but the hand must also get there and away. Seen
    from above it turns against the clock, as right-handed threads open. Lifted by its own breadth and a finger's length
    it is clear of what it closed.
    """
    reach = hand.finger_length - hand.tip_beyond_tcp - PALM_GAP
    return {
        **_grasp(theme, hand),
        "grasp_depth": min(0.8 * (theme.top - theme.bottom), reach),
        "turn": 2.88,
        "lift_height": 0.12,
    }


def _insert(theme: SceneObject, hand: Hand) -> dict[str, float]:
    """As low as the table lets the hand; let go where the hole is two thicknesses down the post, so that what slides
    the rest of the way by its weight cannot cant on the post's end.
    """
    reach = hand.finger_length - hand.tip_beyond_tcp - PALM_GAP
    height = theme.top - theme.bottom
    return {
        **_grasp(theme, hand),
        **_carry(),
        "grasp_depth": height,
        "insert_depth": min(2.0 * height, 0.7 * reach),
    }


def _push(theme: SceneObject, hand: Hand) -> dict[str, float]:
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
    }


def _press(hand: Hand) -> dict[str, float]:
    """Buttons travel a centimetre at most: 10 mm below the top presses any of them home, where they are high enough.

    Beyond its stop a button does not yield; the arm's compliance takes up the rest.
    """
    return {"standoff": hand.finger_length, "press_depth": 0.010}


def scales(skill: str, theta: Mapping[str, float], lengths: Mapping[str, float]) -> dict[str, Scale]:
    """The side of the object that each parameter goes with, and its length; those of the hand go with none."""
    return {
        name: (side, lengths[side])
        for name, side in SCALED.items()
        if name in theta and skill not in OF_THE_HAND and lengths[side] >= LEAST_SIDE
    }


def limited(theta: dict[str, float], theme: SceneObject, scene: Scene) -> tuple[dict[str, float], list[str]]:
    """Theta as far as the scene allows it, whoever asked for it, and one sentence a change.

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
