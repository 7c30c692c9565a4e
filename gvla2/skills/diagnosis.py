"""Failure diagnosis of the standard skills, from the scenes before and after: too far, or not far enough.

The rules require that the motion ended with the object in the hand, so that a parameter is at fault and not a slip or
an abort. Two slips are diagnosed: a cap that is still in place though it was held while turning, and a drawer that came
most of the way.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from gvla2.planning.skill import EMPTY, Outcome, Signal
from gvla2.skills.mechanisms import hinged, opening_angle, shines
from gvla2.skills.parameters import PRESS_DEPTH

STAYS_OPEN = 1.45
"""A lid open by less afterwards did not stay open, radians."""
SWING_MARGIN = 0.2
"""Change of the angle to which a lid is swung open, or at which it is released, radians."""
TURN_MARGIN = 0.785
"""Change of a cap's turn, radians: 45 degrees, one step of the wrist."""
HALF_TURN = np.pi
"""Largest turn in the other direction, radians: any wrist can do it, from one of a square cap's faces."""
FORCED = 0.002
"""Fingers whose gap changes by more while they turn slid around what they held, metres."""
PRESS_MARGIN = 0.003
"""Change of the depth of a press, metres."""
PRESS_SHORT, GAVE_WAY = 0.0003, 0.002
"""A press, or a lifted handle in compliant fingers, that ends this far short of its target met a stop, metres."""
PRESS_LONGER, LONG_PRESS = 1.5, 3.0
"""Change of the time that a button is held down, and the time that is enough for any button, seconds."""
CATCH_MARGIN = 0.008
"""Change of the lift of a handle before it is pulled, metres."""
HOOK_MARGIN = 0.005
"""Change of the depth of a hook, metres."""
PULL_TOLERANCE, PULL_MARGIN = 0.02, 0.05
"""Tolerance of a pull, and the largest change of its distance after one failure, metres."""
PUSH_TOLERANCE = 0.01
"""Tolerance of a push, metres from the goal's centre."""
IN_PLACE = 0.02
"""An object found this close to its earlier place has not moved, metres."""
HELD_FAST = 0.01
"""A pulled object that moved by less did not move at all, metres."""


def of_open(outcome: Outcome) -> Signal | None:
    """A lid that did not stay open, or that the fingers missed."""
    lid, body = hinged(outcome.theme, outcome.before.objects)
    later = outcome.later(lid.id) if lid is not None else None
    if (
        later is None
        or opening_angle(later, (outcome.later(body.id) if body else None) or body) >= STAYS_OPEN
    ):
        return None
    if not outcome.gripped():
        deeper = outcome.changed("lip_depth", HOOK_MARGIN)
        return Signal("missed_grasp", "the fingers closed before the lip", deeper)
    further = outcome.changed("open_angle", SWING_MARGIN)
    return Signal("undershoot", "the lid was not swung so far that it stays open", further)


def of_pull(outcome: Outcome) -> Signal | None:
    """A drawer that moved less than the hand, or that was pulled beyond its end."""
    waypoints = outcome.waypoints
    carried = [i for i, w in enumerate(waypoints) if w.carries and i > 0]
    if not carried or "pull_distance" not in outcome.plan.parameters:
        return None
    way = np.subtract(waypoints[carried[-1]].xyz, waypoints[carried[0] - 1].xyz)
    length = float(np.linalg.norm(way))
    later = outcome.later(outcome.theme.id)
    if later is None or length < IN_PLACE:
        return None
    came = float((later.centre - outcome.theme.centre) @ way) / length
    missing = length - came
    if missing <= PULL_TOLERANCE:
        return None
    if came < HELD_FAST and outcome.held_back():
        if outcome.stopped("unlatch", GAVE_WAY):
            less = outcome.changed("unlatch_lift", -CATCH_MARGIN, "<=")
            return Signal("overshoot", "the handle was lifted to its stop, where its catch holds again", less)
        more = outcome.changed("unlatch_lift", CATCH_MARGIN)
        return Signal("held_fast", "a catch held it though the handle was in the hand", more)
    if outcome.slipped:
        if came < 0.5 * length:
            return None  # it slipped for another reason
        less = outcome.changed("pull_distance", -missing, "<=")
        return Signal("overshoot", "it was pulled on when it had come as far as it goes", less)
    if not outcome.gripped():
        deeper = outcome.changed("grasp_depth", 0.005)
        return Signal("slip", "the handle slipped out of the fingers", deeper)
    further = outcome.changed("pull_distance", min(missing, PULL_MARGIN))
    return Signal("undershoot", "it was not pulled as far as it was to come", further)


def of_twist(outcome: Outcome) -> Signal | None:
    """A cap that was held while it was turned, and is still in place.

    If the fingers' gap changed, they slid around its corners while it stood still: its thread turns the other way.
    """
    turning = [r for r in outcome.reached if r.stage == "turn"]
    if outcome.theme.joint is not None or not turning or any(r.gripper_width <= EMPTY for r in turning):
        return None  # a knob stays in place
    if not _in_place(outcome):
        return None
    turn = outcome.plan.parameters.get("turn", 0.0)
    closed = next((r.gripper_width for r in outcome.reached if r.stage == "close"), None)
    if closed is not None and max(abs(r.gripper_width - closed) for r in turning) > FORCED:
        other = -float(np.copysign(min(abs(turn), HALF_TURN), turn))  # which way is known, not how far
        back = outcome.changed("turn", other - turn, "<=" if turn > 0 else ">=")
        return Signal("stalled", "the cap did not turn with the fingers, it opens the other way", back)
    further = outcome.changed("turn", float(np.copysign(TURN_MARGIN, turn)), ">=" if turn >= 0 else "<=")
    return Signal("undershoot", "the cap was not turned until it came loose", further)


def _in_place(outcome: Outcome) -> bool:
    """Whether the theme is where it was, or, if it was not seen again, something else of its height is there."""
    later, was = outcome.later(outcome.theme.id), outcome.theme
    if later is not None:
        return float(np.linalg.norm(later.centre - was.centre)) <= IN_PLACE
    there = outcome.after.obstacles() if outcome.after is not None else ()
    high = [o for o in there if o.bottom < was.top and o.top > was.centre[2]]
    return any(float(np.linalg.norm((o.centre - was.centre)[:2])) <= IN_PLACE for o in high)


def of_press(outcome: Outcome) -> Signal | None:
    """A lamp that stayed dark after its button was pressed, to its stop or not.

    A stop deeper than a usual press cannot be why usual presses fail: such a button must be held down. If it was held
    long enough for any button, it was pressed too deep after all.
    """
    if outcome.after is None or shines(outcome.theme, outcome.before, outcome.after) is not False:
        return None
    if outcome.stopped("press", PRESS_SHORT):
        held = outcome.plan.parameters.get("press_seconds", LONG_PRESS)
        if held < LONG_PRESS and outcome.went("press", "press_depth") > PRESS_DEPTH + PRESS_SHORT:
            longer = outcome.changed("press_seconds", PRESS_LONGER)
            return Signal("undershoot", "the button was let go before its lamp was lit", longer)
        less = outcome.changed("press_depth", -PRESS_MARGIN, "<=")
        return Signal("overshoot", "the button was pressed to its stop and the lamp is dark", less)
    deeper = outcome.changed("press_depth", PRESS_MARGIN)
    return Signal("undershoot", "the button was not pressed until its lamp was lit", deeper)


def of_push(outcome: Outcome) -> Signal | None:
    """An object that was pushed past the goal, or not up to it: the error along the push corrects the overshoot."""
    goal, later = outcome.goal, outcome.later(outcome.theme.id)
    if goal is None or later is None:
        return None
    way = (goal.centre - outcome.theme.centre)[:2]
    length = float(np.linalg.norm(way))
    if length < 1e-6:
        return None
    along = float((later.centre - goal.centre)[:2] @ way) / length
    if abs(along) <= PUSH_TOLERANCE:
        return None
    bound = outcome.changed("push_overshoot", -along, "<=" if along > 0 else ">=")
    if along > 0:
        return Signal("overshoot", "the object was pushed past the goal", bound)
    return Signal("undershoot", "the object was not pushed as far as the goal", bound)


DIAGNOSE: Mapping[str, Callable[[Outcome], Signal | None]] = {
    "open": of_open,
    "pull": of_pull,
    "twist": of_twist,
    "press": of_press,
    "push": of_push,
}
"""What went wrong with a standard skill, by its name; picking and placing are diagnosed by the episode's report."""
