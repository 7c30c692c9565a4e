"""Asking an untrusted planner: within a time limit, and checking that its answer is a well-formed plan."""

from __future__ import annotations

import math
from collections.abc import Mapping

from gvla2.errors import PlannerTimeoutError, PlanningError
from gvla2.planning.calls import SkillCall, SkillOptions
from gvla2.planning.contracts import Abstention, Candidate, Plan, Planner, PlanRequest
from gvla2.planning.deadline import DeadlineError, within
from gvla2.planning.effects import SIDES
from gvla2.planning.programs import Program
from gvla2.planning.trajectory import MAX_WAYPOINTS, Guard, Orientation, Trajectory, Waypoint

ABSURD = 10 * MAX_WAYPOINTS
"""Longer trajectories are not checked waypoint by waypoint; up to here the checks say what is too many."""

_TEXTS = ("stage", "motion", "carries", "frame")
_NUMBERS = ("gripper", "speed", "tolerance", "dwell")


def ask(planner: Planner, request: PlanRequest, name: str, seconds: float = 0.0) -> Plan:
    """The planner's plan, with valid types, finite numbers and a checkable number of waypoints.

    Raises :class:`PlannerTimeoutError` when ``name`` does not answer within ``seconds`` (0 waits for ever), and
    :class:`PlanningError` for an answer that is not a plan. Whether the plan is good is for the checks to say.
    """
    try:
        plan = within(seconds, lambda: planner.plan(request))
    except DeadlineError:
        raise PlannerTimeoutError(
            f"The planner '{name}' gave no answer within {seconds:g} s; planner_timeout=SECONDS waits longer."
        ) from None
    if problem := _problem(plan):
        raise PlanningError(f"The planner '{name}' returned {problem}.")
    return plan


def _problem(plan: object) -> str:
    """What is wrong with an answer, worded to follow "returned"; "" if nothing."""
    if not isinstance(plan, Plan):
        return f"{type(plan).__name__}, not a Plan"
    if not isinstance(plan.skill, str) or not _texts(plan.notes) or not isinstance(plan.fallback, str):
        return "a plan whose skill, notes or fallback are not text"
    if not isinstance(plan.roles, Mapping) or not _texts([*plan.roles, *plan.roles.values()]):
        return f"roles that do not map text to text: {plan.roles!r:.80}"
    if not isinstance(plan.parameters, Mapping) or not all(_finite(v) for v in plan.parameters.values()):
        return f"parameters that do not map names to finite numbers: {plan.parameters!r:.200}"
    if not isinstance(plan.scales, Mapping) or not all(_side(v) for v in plan.scales.values()):
        return f"scales that do not map names to a side and its length: {plan.scales!r:.200}"
    if not all(isinstance(c, Candidate) for c in plan.candidates):
        return "candidates that are not of type Candidate"
    if problem := _program_problem(plan):
        return problem
    refusal: object = plan.abstention
    if refusal is not None:
        return "" if isinstance(refusal, Abstention) else f"an abstention of type {type(refusal).__name__}"
    if not isinstance(plan.trajectory, Trajectory):
        return "neither a trajectory nor an abstention with its reason"
    return _trajectory_problem(plan.trajectory)


def _program_problem(plan: Plan) -> str:
    """What is wrong with the plan's program and transcript."""
    if not _all_of(SkillCall, plan.calls) or not _all_of(SkillCall, plan.remaining):
        return "calls or remaining that are not a tuple of SkillCall"
    options: object = plan.options
    program: object = plan.program
    if not isinstance(options, SkillOptions):
        return f"options of type {type(options).__name__}, not SkillOptions"
    if program is not None and not isinstance(program, Program):
        return f"a program of type {type(program).__name__}, not Program"
    if not _all_of(Mapping, plan.transcript):
        return "a transcript that is not a tuple of mappings"
    return ""


def _all_of(kind: type, values: object) -> bool:
    return isinstance(values, tuple) and all(isinstance(value, kind) for value in values)


def _side(value: object) -> bool:
    """Whether it is a :data:`~gvla2.planning.effects.Scale`."""
    if not isinstance(value, tuple) or len(value) != 2 or value[0] not in SIDES:
        return False
    return _finite(value[1]) and value[1] > 0.0


def _trajectory_problem(trajectory: Trajectory) -> str:
    waypoints = trajectory.waypoints
    if not isinstance(waypoints, tuple) or not all(isinstance(w, Waypoint) for w in waypoints):
        return "a trajectory that is not a tuple of waypoints"
    if not waypoints:
        return "a trajectory without waypoints; give the reason in an abstention"
    if len(waypoints) > ABSURD:
        return f"a trajectory of {len(waypoints)} waypoints; at most {MAX_WAYPOINTS} can be carried out"
    for index, waypoint in enumerate(waypoints):
        if problem := _waypoint_problem(waypoint):
            return f"waypoint {index} ('{waypoint.stage!s:.40}') with {problem}"
    return ""


def _waypoint_problem(w: Waypoint) -> str:
    odd = [name for name in _TEXTS if not isinstance(getattr(w, name), str)]
    if odd:
        return f"a {odd[0]} that is not text: {getattr(w, odd[0])!r:.60}"
    odd = [name for name in _NUMBERS if not _finite(getattr(w, name))]
    if odd:
        return f"a {odd[0]} that is not a finite number: {getattr(w, odd[0])!r:.60}"
    if not _three(w.xyz):
        return f"an xyz that is not a tuple of three finite numbers: {w.xyz!r:.80}"
    if not isinstance(w.allowed_contacts, frozenset) or not _texts(w.allowed_contacts):
        return f"allowed_contacts that are not a frozenset of ids: {w.allowed_contacts!r:.80}"
    turned: object = w.orientation
    if not isinstance(turned, Orientation) or not isinstance(turned.policy, str):
        return f"an invalid orientation: {turned!r:.80}"
    if not _three(turned.vector) or not _three(turned.closing) or not _finite(turned.angle):
        return f"an orientation without finite numbers: {turned!r:.160}"
    guard: object = w.guard
    if guard is not None and not (isinstance(guard, Guard) and _finite(guard.force) and _finite(guard.stall)):
        return f"an invalid guard: {guard!r:.80}"
    return ""


def _finite(value: object) -> bool:
    """Whether it is a finite number: NumPy's scalars count, True does not."""
    if isinstance(value, bool) or not hasattr(value, "__float__") or getattr(value, "shape", ()) != ():
        return False
    return math.isfinite(float(value))


def _three(value: object) -> bool:
    """Whether it is a triple of numbers, not an array: waypoints are compared, which arrays do not support."""
    return isinstance(value, tuple | list) and len(value) == 3 and all(_finite(v) for v in value)


def _texts(values: object) -> bool:
    return isinstance(values, tuple | list | frozenset) and all(isinstance(v, str) for v in values)
