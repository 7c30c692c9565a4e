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
from gvla2.planning.effects import Ban, Bound, Effect, as_shares, look_of
from gvla2.planning.scene import SceneObject
from gvla2.planning.skill import EMPTY, Outcome, Reached, Signal, Skill
from gvla2.planning.trajectory import Waypoint
from gvla2.robot.report import ExecutionReport, WaypointReport
from gvla2.skills.table import STANDARD

CLEARANCE_MARGIN = 0.03
"""Metres added to the clearance at which something was touched."""
DEPTH_MARGIN = 0.005
"""Minimum increase of the grasp depth after a slip, metres; a tenth of the object's height if that is more."""


def diagnose(record: EpisodeRecord, skills: Mapping[str, Skill] = STANDARD) -> list[Signal]:
    """The signals of an executed episode (none if it was not executed); ``skills`` add their own diagnoses.

    Bounds on parameters that go with the object's size are shares of it, as the plan's ``scales`` say; each effect
    names the look of what was handled.
    """
    if record.plan is None or record.scene is None or record.report is None or not record.report.waypoints:
        return []
    plan, report = record.plan, record.report
    theme = theme_of(record)
    found = [_slip(plan, report, theme), _touch(plan, report), _unreachable(plan, report)]
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
    report, after, given = record.report, record.after_scene, record.planned
    if skill is None or skill.diagnose is None or theme is None or report is None or after is None:
        return None
    stopped = report.abort.abort if report.abort is not None else ""
    if stopped and not (skill.held_back and stopped in ("slipped", "tracking")):
        return None
    reached = tuple(
        Reached(r.index, r.stage, r.gripper_width, r.status == "guarded", r.error) for r in report.waypoints
    )
    later = correspond(given.scene, after).get
    return skill.diagnose(
        Outcome(given.plan, given.scene, theme, later, reached, stopped == "slipped", after)
    )


def _followed(plan: Plan, report: ExecutionReport) -> list[tuple[WaypointReport, Waypoint, bool]]:
    """Each executed waypoint with its plan, and whether the hand opens there."""
    waypoints = plan.trajectory.waypoints if plan.trajectory else ()
    before = (1.0, *(w.gripper for w in waypoints))
    done = ((r, waypoints[r.index]) for r in report.waypoints if r.index < len(waypoints))
    return [(r, w, w.gripper > before[r.index] + 1e-6) for r, w in done]


def _slip(plan: Plan, report: ExecutionReport, theme: SceneObject | None) -> Signal | None:
    """Held, then lost before the command to open; by the fingers' gap, if the robot cannot feel a grasp."""
    held = gap = False
    for done, waypoint, opens in _followed(plan, report):
        if opens:
            held = gap = False
            continue
        lost = (held and done.held is False) or (gap and done.gripper_width <= EMPTY)
        if waypoint.carries and ((done.abort == "slipped" and held) or lost):
            # The depth learned for one object says nothing about another in the same plan.
            others = {i for role, i in plan.roles.items() if role.startswith("theme_")}
            own = waypoint.carries not in others - {theme.id if theme else ""}
            deeper = _deeper(plan, theme) if own else None
            return Signal("slip", "the object slipped out of the fingers", deeper)
        if done.abort == "slipped":
            return Signal("missed_grasp", "the fingers closed on nothing")
        held = held or done.held is True
        gap = gap or (bool(waypoint.carries) and done.gripper_width > EMPTY)
    return None


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
    for done, waypoint, _ in _followed(plan, report):
        if waypoint.allowed_contacts or waypoint.guard:  # contact was meant
            continue
        # Fingers touch what they carry; then only the executor's own report counts.
        if done.abort == "collision" or (done.contacts and not waypoint.carries and not done.held):
            name = next((n for n in ("transit_clearance", "lift_height") if n in plan.parameters), None)
            raised = None
            if name is not None:
                raised = Bound(name, plan.parameters[name] + CLEARANCE_MARGIN, ">=", skill=plan.skill)
            return Signal("contact", f"the robot touched something during '{done.stage}'", raised)
    return None


def _unreachable(plan: Plan, report: ExecutionReport) -> Signal | None:
    """The arm could not get there; the approach is forbidden only if the plan had found another that works.

    It is the most specific name of the approach taken that some other viable candidate does not need.
    """
    stopped = report.abort
    if stopped is None or stopped.abort not in ("unreachable", "no_path"):
        return None
    taken, *others = [c.approaches for c in plan.candidates if not c.rejected] or [()]
    name = next((a for a in reversed(taken) if any(a not in other for other in others)), "")
    forbid = Ban(name, skill=plan.skill) if name else None
    return Signal("unreachable", f"the arm found no way at '{stopped.stage}'", forbid)
