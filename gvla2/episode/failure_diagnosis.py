"""Diagnosis of failed episodes from measured signals: the basis for constraints.

A failure without a diagnosed signal yields text only, since a bound would be a guess.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from gvla2.episode.evidence import correspond
from gvla2.episode.record import EpisodeRecord
from gvla2.planning.contracts import Plan
from gvla2.planning.effects import BEFORE, Ban, Bound, Effect, Order, as_shares, look_of
from gvla2.planning.scene import SceneObject
from gvla2.planning.skill import EMPTY, Outcome, Reached, Signal, Skill
from gvla2.planning.trajectory import Waypoint
from gvla2.robot.report import ExecutionReport, WaypointReport
from gvla2.skills.table import STANDARD

CLEARANCE_MARGIN = 0.03
"""Metres added to the clearance at which something was touched."""
DEPTH_MARGIN = 0.005
"""Minimum increase of the grasp depth after a slip, metres; a tenth of the object's height if that is more."""
DROP = 0.03
"""Metres lower that count as putting down rather than as play of the stop; and sideways, as the same place."""


def diagnose(record: EpisodeRecord, skills: Mapping[str, Skill] = STANDARD) -> list[Signal]:
    """The signals of an executed episode (none if it was not executed); ``skills`` add their own diagnoses.

    Bounds on parameters that go with the object's size are shares of it, as the plan's ``scales`` say; each effect
    names the look of what was handled.
    """
    if record.plan is None or record.scene is None or record.report is None or not record.report.waypoints:
        return []
    plan, report = record.plan, record.report
    theme = theme_of(record)
    found = [
        _slip(plan, report, theme),
        _touch(plan, report),
        _opened_early(plan, report),
        _unreachable(plan, report),
    ]
    short = _fell_short(record, skills.get(plan.skill), theme)
    if short is not None:
        if report.completed and any(s is not None and s.kind in ("slip", "missed_grasp") for s in found):
            short = None  # a lost object could not be moved further
        else:
            found = [s for s in found if s is None or s.kind != "slip"]  # the mechanism held it back
    found.append(short)
    look = look_of(theme, record.scene)
    return [
        signal
        if signal.effect is None
        else replace(signal, effect=replace(as_shares(signal.effect, plan.scales), object=look))
        for signal in found
        if signal is not None
    ]


def theme_of(record: EpisodeRecord) -> SceneObject | None:
    """The object that the plan handled, as perceived before; None if the plan does not say."""
    if record.plan is None or record.scene is None:
        return None
    known = {o.id: o for o in record.scene.objects}
    roles = record.plan.roles
    return next((known[roles[r]] for r in ("part", "theme") if roles.get(r) in known), None)


def approach_of(plan: Plan) -> str:
    """From where the hand reached its first grasp, or lowest point: "top", "side" or "below"; "" when unclear."""
    waypoints = plan.trajectory.waypoints if plan.trajectory else ()
    turned = [w for w in waypoints if w.orientation.policy in ("grasp", "axis")]
    if not turned:
        return ""
    closing = next((w for w in turned if w.gripper < 0.5), turned[0])
    down = -closing.orientation.vector[2] / (float(np.linalg.norm(closing.orientation.vector)) or 1.0)
    return "top" if down > 0.7 else "below" if down < -0.7 else "side"


def _fell_short(record: EpisodeRecord, skill: Skill | None, theme: SceneObject | None) -> Signal | None:
    """The skill's own diagnosis of how far objects were moved; None if it has none or finds none.

    It is asked about motions that ran to their end, or that the object may have blocked: it was lost, or the hand made
    no progress.
    """
    plan, report, before, after = record.plan, record.report, record.scene, record.after_scene
    if skill is None or skill.diagnose is None or theme is None:
        return None
    if plan is None or report is None or before is None or after is None:
        return None
    stopped = report.abort.abort if report.abort is not None else ""
    if stopped and not (skill.held_back and stopped in ("slipped", "tracking")):
        return None
    reached = tuple(
        Reached(r.index, r.stage, r.gripper_width, r.status == "guarded", r.error) for r in report.waypoints
    )
    later = correspond(before, after).of
    return skill.diagnose(Outcome(plan, before, theme, later, reached, stopped == "slipped", after))


def _planned(plan: Plan, report: WaypointReport) -> Waypoint | None:
    waypoints = plan.trajectory.waypoints if plan.trajectory else ()
    return waypoints[report.index] if report.index < len(waypoints) else None


def _slip(plan: Plan, report: ExecutionReport, theme: SceneObject | None) -> Signal | None:
    """Held, then lost before the command to open; by the fingers' gap, if the robot cannot feel a grasp."""
    held = gap = False
    for done in report.waypoints:
        waypoint = _planned(plan, done)
        if waypoint is not None and _lets_go(plan, done):
            held = gap = False
            continue
        carrying = waypoint is not None and bool(waypoint.carries)
        lost = (held and done.held is False) or (gap and done.gripper_width <= EMPTY)
        if carrying and ((done.abort == "slipped" and held) or lost):
            # The depth learned for one object says nothing about another in the same plan.
            others = {i for role, i in plan.roles.items() if role.startswith("theme_")}
            own = waypoint is not None and waypoint.carries not in others - {theme.id if theme else ""}
            return Signal(
                "slip", "the object slipped out of the fingers", _deeper(plan, theme) if own else None
            )
        if done.abort == "slipped":
            return Signal("missed_grasp", "the fingers closed on nothing")
        held = held or done.held is True
        gap = gap or (carrying and done.gripper_width > EMPTY)
    return None


def _lets_go(plan: Plan, report: WaypointReport) -> bool:
    """Whether the hand opens at this waypoint."""
    waypoints = plan.trajectory.waypoints if plan.trajectory else ()
    before = waypoints[report.index - 1].gripper if report.index else 1.0
    return waypoints[report.index].gripper > before + 1e-6


def _deeper(plan: Plan, theme: SceneObject | None) -> Effect | None:
    """Grasp deeper by a tenth of the object's height, but no deeper than its height; a lip is held deeper."""
    if "lip_depth" in plan.parameters:
        return Bound("lip_depth", plan.parameters["lip_depth"] + DEPTH_MARGIN, skill=plan.skill)
    depth = plan.parameters.get("grasp_depth")
    if depth is None or theme is None:
        return None
    height = dict(plan.scales.values()).get("height", float(theme.extents[2]))
    deeper = depth + max(DEPTH_MARGIN, 0.1 * height)
    # Deeper than the object is high, the fingers would meet the table.
    return Bound("grasp_depth", max(depth, min(deeper, height)), skill=plan.skill)


def _touch(plan: Plan, report: ExecutionReport) -> Signal | None:
    """Contact or a collision on the way where none was allowed."""
    for done in report.waypoints:
        waypoint = _planned(plan, done)
        if waypoint is None or waypoint.allowed_contacts or waypoint.guard:  # contact was meant
            continue
        # Fingers touch what they carry; then only the executor's own report counts.
        if done.abort == "collision" or (done.contacts and not waypoint.carries and not done.held):
            name = next((n for n in ("transit_clearance", "lift_height") if n in plan.parameters), None)
            raised = None
            if name is not None:
                raised = Bound(name, plan.parameters[name] + CLEARANCE_MARGIN, ">=", skill=plan.skill)
            return Signal("contact", f"the robot touched something during '{done.stage}'", raised)
    return None


def _opened_early(plan: Plan, report: ExecutionReport) -> Signal | None:
    """The hand released its object high up, and then went down empty over the same place.

    Measured: a grasp was felt before and none after, and a later stage of the plan is where the object should have been
    put down. That stage then comes before the one that opened the hand.
    """
    held = False
    for done in report.waypoints:
        waypoint = _planned(plan, done)
        if waypoint is None:
            return None
        if held and waypoint.carries and _lets_go(plan, done):
            return _lowered_after(plan, report, done)
        held = done.held is True
    return None


def _lowered_after(plan: Plan, report: ExecutionReport, opened: WaypointReport) -> Signal | None:
    for done in report.waypoints:
        waypoint = _planned(plan, done)
        if done.index <= opened.index or waypoint is None:
            continue
        if waypoint.carries or waypoint.gripper < 0.5 or done.held:
            return None  # the hand has started something else
        aside = float(np.linalg.norm(np.subtract(done.reached[:2], opened.reached[:2])))
        lower = opened.reached[2] - done.reached[2]
        if lower > DROP and aside < DROP and waypoint.stage and waypoint.stage != opened.stage:
            order = Order(f"{waypoint.stage}{BEFORE}{opened.stage}", skill=plan.skill)
            return Signal("opened_early", "the hand let go before it had put the object down", order)
    return None


def _unreachable(plan: Plan, report: ExecutionReport) -> Signal | None:
    """The arm could not get there; the approach is forbidden only if the plan had found another that works."""
    stopped = report.abort
    if stopped is None or stopped.abort not in ("unreachable", "no_path"):
        return None
    name = _replaceable(plan)
    forbid = Ban(name, skill=plan.skill) if name else None
    return Signal("unreachable", f"the arm found no way at '{stopped.stage}'", forbid)


def _replaceable(plan: Plan) -> str:
    """The most specific name of the approach taken that some other viable candidate does not need; "" for none.

    Candidates without named approaches cannot be distinguished: then any other one will do.
    """
    viable = [c for c in plan.candidates if not c.rejected]
    if len(viable) < 2:
        return ""
    taken, others = viable[0].approaches, viable[1:]
    if taken:
        return next((a for a in reversed(taken) if any(a not in c.approaches for c in others)), "")
    approach = approach_of(plan)
    return f"approach:{approach}" if approach else ""
