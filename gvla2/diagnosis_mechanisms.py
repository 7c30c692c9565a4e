"""What went wrong with lids, drawers, caps and rings: how far they came, by the scenes before and after.

Each rule asks that the motion ran to its end with what it was to hold in the hand, so that the distance missed is the
parameter's fault and not that of a slip or of an abort, which :mod:`gvla2.diagnosis` tells. Two slips are told here:
of a cap that is still in its place though it was held while it was turned, and of a drawer that came most of the way.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gvla2.correspondence import correspond
from gvla2.planning.contracts import Plan
from gvla2.planning.effects import Effect
from gvla2.planning.lids import FLAT, hinged, opening_angle
from gvla2.planning.scene import Scene, SceneObject
from gvla2.robot.report import ExecutionReport

EMPTY = 0.001
"""Fingers that are no further apart hold nothing, metres."""
STAYS_OPEN = 1.45
"""A lid that is found open by less did not stay open, radians."""
SWING_MARGIN = 0.2
"""Radians to swing a lid further by, or to take it further over before it is let go."""
TURN_MARGIN = 0.35
"""Radians to turn a cap further by: 20 degrees."""
HOOK_MARGIN = 0.005
"""Metres to hook deeper by."""
PULL_TOLERANCE, PULL_MARGIN = 0.02, 0.05
"""Metres short that are no error of a pull; the most that one failure adds to it."""
IN_PLACE = 0.02
"""What is found this near to where it was has not moved, metres."""


@dataclass(frozen=True)
class Signal:
    """One diagnosed cause: a stable ``kind``, words that hold for any such episode, and an effect where one follows."""

    kind: str
    words: str
    effect: Effect | None = None


def fell_short(
    plan: Plan, report: ExecutionReport, before: Scene, after: Scene | None, theme: SceneObject | None
) -> Signal | None:
    """How a mechanism was moved too little, or a drawer too far; None for other skills, and where it cannot be told."""
    rule = {"open": _open, "close": _close, "pull": _pull, "twist": _twist, "insert": _insert}.get(plan.skill)
    if rule is None or after is None or theme is None or not (report.completed or _held_back(plan, report)):
        return None
    return rule(plan, report, before, after, theme)


def _held_back(plan: Plan, report: ExecutionReport) -> bool:
    """Whether the hand lost what a mechanism may have held back: a cap that is not loose, a drawer at its end."""
    return plan.skill in ("twist", "pull") and report.abort is not None and report.abort.abort == "slipped"


def _raised(plan: Plan, name: str, by: float, op: str = ">=") -> Effect | None:
    """The bound that asks for ``by`` more (or less) of a parameter than was used."""
    used = plan.parameters.get(name)
    if used is None:
        return None
    return Effect("bound", name, used + by, "<=" if op == "<=" else ">=", skill=plan.skill)


def _gripped(plan: Plan, report: ExecutionReport) -> bool:
    """Whether the fingers had something between them on all the way that the plan has them carry it."""
    waypoints = plan.trajectory.waypoints if plan.trajectory else ()
    on_the_way = [
        r for r in report.waypoints
        if r.index < len(waypoints) and waypoints[r.index].carries and waypoints[r.index].gripper < 0.1
    ]  # fmt: skip
    return bool(on_the_way) and all(r.gripper_width > EMPTY for r in on_the_way)


def _open(
    plan: Plan, report: ExecutionReport, before: Scene, after: Scene, theme: SceneObject
) -> Signal | None:
    lid, body = hinged(theme, before.objects)
    found = correspond(before, after)
    later = found.of(lid.id) if lid is not None else None
    if later is None or opening_angle(later, (found.of(body.id) if body else None) or body) >= STAYS_OPEN:
        return None
    if not _gripped(plan, report):
        return Signal(
            "missed_grasp", "the fingers closed before the lip", _raised(plan, "lip_depth", HOOK_MARGIN)
        )
    bound = _raised(plan, "open_angle", SWING_MARGIN)
    return Signal("undershoot", "the lid was not swung so far that it stays open", bound)


def _close(
    plan: Plan, report: ExecutionReport, before: Scene, after: Scene, theme: SceneObject
) -> Signal | None:
    lid, body = hinged(theme, before.objects)
    found = correspond(before, after)
    later = found.of(lid.id) if lid is not None else None
    if lid is None or later is None:
        return None
    was = opening_angle(lid, body)
    angle = opening_angle(later, (found.of(body.id) if body else None) or body)
    if angle < FLAT:
        return None
    if was - angle < SWING_MARGIN:
        bound = _raised(plan, "hook_depth", HOOK_MARGIN)
        return Signal("missed_grasp", "the fingers passed the lid without taking it along", bound)
    bound = _raised(plan, "let_go_angle", -SWING_MARGIN, "<=")
    return Signal("undershoot", "the lid was let go before it falls shut by itself", bound)


def _pull(
    plan: Plan, report: ExecutionReport, before: Scene, after: Scene, theme: SceneObject
) -> Signal | None:
    waypoints = plan.trajectory.waypoints if plan.trajectory else ()
    carried = [i for i, w in enumerate(waypoints) if w.carries and i > 0]
    asked = plan.parameters.get("pull_distance")
    if not carried or asked is None:
        return None
    way = np.subtract(waypoints[carried[-1]].xyz, waypoints[carried[0] - 1].xyz)
    length = float(np.linalg.norm(way))
    later = correspond(before, after).of(theme.id)
    if later is None or length < IN_PLACE:
        return None
    came = float((later.centre - theme.centre) @ way) / length
    missing = length - came
    if missing <= PULL_TOLERANCE:
        return None
    if _held_back(plan, report):
        if came < 0.5 * length:
            return None  # it slipped for another reason
        bound = _raised(plan, "pull_distance", -missing, "<=")
        return Signal("overshoot", "it was pulled on when it had come as far as it goes", bound)
    if not _gripped(plan, report):
        return Signal("slip", "the handle slipped out of the fingers", _raised(plan, "grasp_depth", 0.005))
    bound = _raised(plan, "pull_distance", min(missing, PULL_MARGIN))
    return Signal("undershoot", "it was not pulled as far as it was to come", bound)


def _twist(
    plan: Plan, report: ExecutionReport, before: Scene, after: Scene, theme: SceneObject
) -> Signal | None:
    later = correspond(before, after).of(theme.id)
    turning = [r for r in report.waypoints if r.stage == "turn"]
    if later is None or not turning or any(r.gripper_width <= EMPTY for r in turning):
        return None
    if float(np.linalg.norm(later.centre - theme.centre)) > IN_PLACE:
        return None
    bound = _raised(plan, "turn", TURN_MARGIN)
    return Signal("undershoot", "the cap was not turned until it came loose", bound)


def _insert(
    plan: Plan, report: ExecutionReport, before: Scene, after: Scene, theme: SceneObject
) -> Signal | None:
    post = next((o for o in before.objects if o.id == plan.roles.get("goal")), None)
    later = correspond(before, after).of(theme.id)
    if later is None or post is None:
        return None
    beside = float(np.linalg.norm((later.centre - post.centre)[:2]))
    if beside > 0.5 * float(post.extents[:2].max()) or later.bottom - post.bottom <= IN_PLACE:
        return None
    bound = _raised(plan, "insert_depth", max(0.005, theme.top - theme.bottom))
    return Signal("undershoot", "the ring was let go before it was well over the post's end", bound)
