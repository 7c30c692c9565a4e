"""Five criteria, one verdict."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from gvla2.episode.evidence import RobotEvidence
from gvla2.memory.contracts import Evidence, Verdict
from gvla2_plugins.geometric.case import Case, Score
from gvla2_plugins.geometric.completion import completion

if TYPE_CHECKING:
    from gvla2_plugins.geometric import GeometricConfig

NAME = "geometric"
DISTURBED = 0.03
"""Metres that a bystander must have moved to count as disturbed: perception errs by less."""


class GeometricVerifier:
    """Judges what the robot itself could see and feel: scenes before and after, and the execution's report.

    The criteria are the paper's: task_completion, spatial_consistency, collision_safety, execution_validity,
    generalizability; R is their mean, with one gate. Completion below .5 caps R at .2 + completion, so that a tidy
    motion that missed its goal is not a success (and a clear miss is a failure, R <= .35). Unknown stays unknown: a
    criterion without evidence is left out, and without completion the verdict is ``uncertain`` with R = .5 and
    confidence 0. The same applies when nothing was executed, or the user interrupted.
    """

    def __init__(self, config: GeometricConfig) -> None:
        self._config = config

    def verify(self, evidence: Evidence) -> Verdict:
        """A verdict; ``unavailable`` for evidence that is not a robot's."""
        if not isinstance(evidence, RobotEvidence):
            return Verdict.unavailable(f"'{NAME}' judges only robots' episodes.", NAME)
        if (reason := _not_executed(evidence)) is not None:
            return Verdict("uncertain", 0.5, 0.0, {}, (reason,), NAME)
        case = Case(evidence, self._config)
        findings = {
            "task_completion": completion(case),
            "spatial_consistency": _spatial_consistency(case),
            "collision_safety": _collision_safety(case),
            "execution_validity": _execution_validity(case),
            "generalizability": _generalizability(case),
        }
        criteria = {name: f.score for name, f in findings.items() if f.score is not None}
        reasons = tuple(f.reason for f in findings.values() if f.reason)
        done = findings["task_completion"].score
        if done is None or any(w.abort == "interrupted" for w in evidence.report.waypoints):
            return Verdict("uncertain", 0.5, 0.0, criteria, reasons, NAME)
        return _gated(criteria, done, reasons)


def _gated(criteria: dict[str, float], done: float, reasons: tuple[str, ...]) -> Verdict:
    mean = Verdict.from_criteria(criteria, reasons, NAME)
    cap = 1.0 if done >= 0.5 else 0.2 + done
    if mean.quality <= cap:
        return mean
    # Verdict's own thresholds, applied to the capped quality.
    capped = Verdict.from_criteria({"capped": cap}, reasons, NAME)
    return Verdict(capped.outcome, capped.quality, capped.confidence, criteria, reasons, NAME)


def _not_executed(evidence: RobotEvidence) -> str | None:
    plan = evidence.plan
    if plan.abstention is not None:
        return (
            f"Nothing was executed: the planner abstained ({plan.abstention.kind}). {plan.abstention.message}"
        )
    if plan.trajectory is None:
        return "Nothing was executed: there was no trajectory."
    if not evidence.report.waypoints:
        why = " ".join(evidence.checks.reasons) or "the robot got no command to move"
        return f"Nothing was executed: {why}"
    first = evidence.report.waypoints[0]
    if first.abort == "not_started":
        return f"Nothing was executed: {first.message or 'the motion did not start'}"
    return None


def _spatial_consistency(case: Case) -> Score:
    """Bystanders are where they were; those not seen again do not count."""
    if case.evidence.after is None:
        return Score(None, "")
    actors = set(case.evidence.plan.roles.values())
    involved = actors | {o.parent for o in case.before.objects if o.id in actors}
    bystanders = [o for o in case.before.obstacles() if not {o.id, o.parent} & (involved - {""})]
    disturbed = [
        o.label
        for o in bystanders
        if (later := case.later(o)) is not None and np.linalg.norm(later.centre - o.centre) > DISTURBED
    ]
    if disturbed:
        return Score(max(0.0, 1 - 0.5 * len(disturbed)), f"Moved in passing: {', '.join(disturbed)}.")
    return Score(1.0, "")


def _collision_safety(case: Case) -> Score:
    """The robot touched nothing where its plan allowed no contact."""
    planned, touched = case.planned, []
    for report in case.evidence.report.waypoints:
        if report.abort == "collision":
            return Score(0.0, f"Stopped in a collision at '{report.stage}'.")
        waypoint = planned[report.index] if report.index < len(planned) else None
        expected = report.held or (waypoint is not None and (waypoint.carries or waypoint.allowed_contacts))
        if report.contacts and not expected:
            touched.append(f"{', '.join(report.contacts)} at '{report.stage}'")
    if touched:
        return Score(max(0.0, 1 - 0.4 * len(touched)), f"Unplanned contact: {'; '.join(touched)}.")
    return Score(1.0, "")


def _execution_validity(case: Case) -> Score:
    """The motion ran to its end, near its waypoints."""
    planned, reports = case.planned, case.evidence.report.waypoints
    done = [r for r in reports if not r.abort]
    if (stopped := case.evidence.report.abort) is not None:
        share = len(done) / max(len(planned), 1)
        return Score(0.5 * share, f"Stopped at '{stopped.stage}' ({stopped.abort}): {stopped.message}")
    if len(done) < len(planned):
        return Score(
            0.5 * len(done) / len(planned), f"Only {len(done)} of {len(planned)} waypoints were reported."
        )
    near = [
        r.error <= 2 * planned[r.index].tolerance if r.index < len(planned) else r.error <= 0.02 for r in done
    ]
    share = sum(near) / len(near)
    return Score(0.5 + 0.5 * share, "" if share == 1 else f"{len(near) - sum(near)} waypoints were missed.")


def _generalizability(case: Case) -> Score:
    """How little was luck: confident perception of the handled objects and no fallback planner."""
    handled = [o.confidence for o in case.before.objects if o.id in set(case.evidence.plan.roles.values())]
    score = min(handled, default=0.5)
    score -= 0.2 * bool(case.evidence.plan.fallback)
    return Score(float(np.clip(score, 0.0, 1.0)), "")
