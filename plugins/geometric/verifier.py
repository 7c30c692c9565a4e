"""Five criteria, one verdict."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from gvla2.episode.evidence import RobotEvidence
from gvla2.memory.contracts import Evidence, Verdict
from gvla2_plugins.geometric.case import Case, Score
from gvla2_plugins.geometric.rules import completion

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
            return Verdict("uncertain", 0.5, 0.0, {}, (f"Nothing was executed: {reason}",), NAME)
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
        mean = Verdict.from_criteria(criteria, reasons, NAME)
        if done >= 0.5 or mean.quality <= 0.2 + done:
            return mean
        return replace(Verdict.from_criteria({"capped": 0.2 + done}, reasons, NAME), criteria=criteria)


def _not_executed(evidence: RobotEvidence) -> str | None:
    plan, reports = evidence.plan, evidence.report.waypoints
    if plan.abstention is not None:
        return f"the planner declined ({plan.abstention.kind}). {plan.abstention.message}"
    if plan.trajectory is None:
        return "there was no trajectory."
    if not reports:
        return " ".join(evidence.checks.reasons) or "the robot got no command to move"
    return reports[0].message or "the motion did not start" if reports[0].abort == "not_started" else None


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
        here = planned[report.index : report.index + 1]
        expected = report.held or any(w.carries or w.allowed_contacts for w in here)
        if report.contacts and not expected:
            touched.append(f"{', '.join(report.contacts)} at '{report.stage}'")
    if touched:
        return Score(max(0.0, 1 - 0.4 * len(touched)), f"Unplanned contact: {'; '.join(touched)}.")
    return Score(1.0, "")


def _execution_validity(case: Case) -> Score:
    """The motion ran to its end, near its waypoints."""
    planned, reports = case.planned, case.evidence.report.waypoints
    done = [r for r in reports if not r.abort]
    stopped = case.evidence.report.abort
    if stopped is not None or len(done) < len(planned):
        where = "Some waypoints were not reported."
        if stopped is not None:
            where = f"Stopped at '{stopped.stage}' ({stopped.abort}): {stopped.message}"
        return Score(0.5 * len(done) / max(len(planned), 1), where)
    limits = [2 * planned[r.index].tolerance if r.index < len(planned) else 0.02 for r in done]
    missed = sum(r.error > limit for r, limit in zip(done, limits, strict=True))
    return Score(1 - 0.5 * missed / len(done), f"{missed} waypoints were missed." if missed else "")


def _generalizability(case: Case) -> Score:
    """Least confidence in the handled objects, less .2 for a plan by the fallback planner."""
    plan = case.evidence.plan
    sure = min((o.confidence for o in map(case.seen, plan.roles.values()) if o is not None), default=0.5)
    return Score(float(np.clip(sure - 0.2 * bool(plan.fallback), 0.0, 1.0)), "")
