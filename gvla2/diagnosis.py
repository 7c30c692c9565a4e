"""What went wrong in an episode, from signals that were measured: the ground on which constraints stand.

A failure without a diagnosed signal teaches words alone; guessing a bound would be superstition.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gvla2.correspondence import correspond
from gvla2.planning.contracts import Plan
from gvla2.planning.effects import Effect
from gvla2.planning.scene import Scene, SceneObject
from gvla2.planning.trajectory import Waypoint
from gvla2.record.contents import EpisodeRecord
from gvla2.robot.report import ExecutionReport, WaypointReport

CLEARANCE_MARGIN = 0.03
"""Metres to stay clear by, beyond the clearance at which something was touched."""
DEPTH_MARGIN = 0.005
"""Metres to grasp deeper at least after a slip; a tenth of the object's height where that is more."""
PUSH_TOLERANCE = 0.01
"""Metres off the goal's centre that are no error of the push."""


@dataclass(frozen=True)
class Signal:
    """One diagnosed cause: a stable ``kind``, words that hold for any such episode, and an effect where one follows."""

    kind: str
    words: str
    effect: Effect | None = None


def diagnose(record: EpisodeRecord) -> list[Signal]:
    """The signals of an executed episode, none for one that was not executed."""
    if record.plan is None or record.scene is None or record.report is None or not record.report.waypoints:
        return []
    plan, report = record.plan, record.report
    theme = theme_of(record)
    found = [
        _slip(plan, report, theme),
        _touch(plan, report),
        _misplaced_push(plan, record.scene, record.after_scene, theme),
        _unreachable(plan, report),
    ]
    return [signal for signal in found if signal is not None]


def theme_of(record: EpisodeRecord) -> SceneObject | None:
    """What the plan handled, as it was perceived before; None where the plan does not say."""
    if record.plan is None or record.scene is None:
        return None
    known = {o.id: o for o in record.scene.objects}
    roles = record.plan.roles
    return next((known[roles[r]] for r in ("part", "theme") if roles.get(r) in known), None)


def approach_of(plan: Plan) -> str:
    """From where the hand came to its first grasp, or lowest point: "top", "side" or "below"; "" when unclear."""
    waypoints = plan.trajectory.waypoints if plan.trajectory else ()
    turned = [w for w in waypoints if w.orientation.policy in ("grasp", "axis")]
    if not turned:
        return ""
    closing = next((w for w in turned if w.gripper < 0.5), turned[0])
    down = -closing.orientation.vector[2] / (float(np.linalg.norm(closing.orientation.vector)) or 1.0)
    return "top" if down > 0.7 else "below" if down < -0.7 else "side"


def _planned(plan: Plan, report: WaypointReport) -> Waypoint | None:
    waypoints = plan.trajectory.waypoints if plan.trajectory else ()
    return waypoints[report.index] if report.index < len(waypoints) else None


def _slip(plan: Plan, report: ExecutionReport, theme: SceneObject | None) -> Signal | None:
    """Held first and lost before the hand was told to open."""
    held = False
    for done in report.waypoints:
        waypoint = _planned(plan, done)
        carrying = waypoint is not None and bool(waypoint.carries)
        if carrying and held and (done.abort == "slipped" or done.held is False):
            return Signal("slip", "the object slipped out of the fingers", _deeper(plan, theme))
        if done.abort == "slipped":
            return Signal("missed_grasp", "the fingers closed on nothing")
        held = held or done.held is True
    return None


def _deeper(plan: Plan, theme: SceneObject | None) -> Effect | None:
    depth = plan.parameters.get("grasp_depth")
    if depth is None or theme is None:
        return None
    deeper = depth + max(DEPTH_MARGIN, 0.1 * float(theme.extents[2]))
    # Deeper than the object is high, the fingers would meet the table.
    value = max(depth, min(deeper, float(theme.extents[2])))
    return Effect("bound", "grasp_depth", value, ">=", skill=plan.skill)


def _touch(plan: Plan, report: ExecutionReport) -> Signal | None:
    """Contact, or a collision, on the way where none was allowed."""
    for done in report.waypoints:
        waypoint = _planned(plan, done)
        if waypoint is None or waypoint.allowed_contacts:
            continue
        # Fingers that carry touch what they carry; only the executor's own word counts then.
        if done.abort == "collision" or (done.contacts and not waypoint.carries and not done.held):
            name = next((n for n in ("transit_clearance", "lift_height") if n in plan.parameters), None)
            effect = name and Effect(
                "bound", name, plan.parameters[name] + CLEARANCE_MARGIN, ">=", skill=plan.skill
            )
            return Signal("contact", f"the robot touched something during '{done.stage}'", effect or None)
    return None


def _misplaced_push(
    plan: Plan, before: Scene, after: Scene | None, theme: SceneObject | None
) -> Signal | None:
    """Pushed past the goal, or not up to it: the error along the push corrects the overshoot."""
    goal = next((o for o in before.objects if o.id == plan.roles.get("goal")), None)
    if plan.skill != "push" or after is None or theme is None or goal is None:
        return None
    later = correspond(before, after).of(theme.id)
    way = (goal.centre - theme.centre)[:2]
    length = float(np.linalg.norm(way))
    if later is None or length < 1e-6:
        return None
    along = float((later.centre - goal.centre)[:2] @ way) / length
    if abs(along) <= PUSH_TOLERANCE:
        return None
    used = plan.parameters.get("push_overshoot")
    if along > 0:
        bound = None if used is None else Effect("bound", "push_overshoot", used - along, "<=", skill="push")
        return Signal("overshoot", "the object was pushed past the goal", bound)
    bound = None if used is None else Effect("bound", "push_overshoot", used - along, ">=", skill="push")
    return Signal("undershoot", "the object was not pushed as far as the goal", bound)


def _unreachable(plan: Plan, report: ExecutionReport) -> Signal | None:
    """The arm could not get there; the approach is forbidden only where the plan had weighed another that works."""
    stopped = report.abort
    if stopped is None or stopped.abort not in ("unreachable", "no_path"):
        return None
    approach, viable = approach_of(plan), [c for c in plan.candidates if not c.rejected]
    forbid = approach and len(viable) > 1 and Effect("forbid", f"approach:{approach}", skill=plan.skill)
    return Signal("unreachable", f"the arm found no way at '{stopped.stage}'", forbid or None)
