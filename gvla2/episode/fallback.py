"""Plan and check: the planner, once more with what was wrong with its answer, then the fallback planner.

If a planner fails (no answer, no plan, rejected twice) or declines for lack of means, the fallback may follow. That is
never silent: the plan names the planner that stepped in, and a note says why.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

from gvla2.episode.advice import advice_for
from gvla2.episode.failure_diagnosis import theme_of
from gvla2.episode.lessons import handled_lengths
from gvla2.episode.record import EpisodeRecord, Failure
from gvla2.errors import PlannerTimeoutError, PlanningError
from gvla2.language.contracts import LanguageModelError
from gvla2.planning.arm import Arm
from gvla2.planning.asking import ask
from gvla2.planning.checks import check_trajectory
from gvla2.planning.contracts import Plan, Planner, PlanRequest
from gvla2.planning.effects import look_of, own_first
from gvla2.planning.findings import CheckReport
from gvla2.planning.skill import Skill

_FAILED = (LanguageModelError, PlanningError)


@dataclass(frozen=True)
class NamedPlanner:
    """A planner, and its name in messages."""

    name: str
    planner: Planner


@dataclass(frozen=True)
class PlannerWithFallback:
    """A planner and its fallback, if there is one, for one arm and its skills.

    Each has ``seconds`` to answer; 0 waits for ever.
    """

    first: NamedPlanner
    fallback: NamedPlanner | None
    seconds: float
    arm: Arm
    skills: Mapping[str, Skill]

    def plan(self, record: EpisodeRecord) -> EpisodeRecord:
        """The record with a plan; a final abstention is its failure.

        An invalid plan is returned to its planner once, with what is wrong with it. Raises :class:`PlanningError`,
        :class:`PlannerTimeoutError` or :class:`LanguageModelError` if no planner had a plan.
        """
        try:
            record = self._answered(record, self.first)
        except _FAILED as error:
            if self.fallback is None:
                raise
            record = self._stepped_in(record, self.fallback, f"failed: {error}")
        refusal = record.planned.plan.abstention
        if refusal is not None and refusal.gives_way and self.fallback and not self._fallback_planned(record):
            why = f"declined ({refusal.kind}): {refusal.message}"
            record = self._stepped_in(record, self.fallback, why)
            refusal = record.planned.plan.abstention
        if refusal is not None:
            return replace(record, failure=Failure("plan", refusal.kind, refusal.message))
        return record

    def check(self, record: EpisodeRecord) -> EpisodeRecord:
        """Check the plan; on findings ask its planner once more with them, then the fallback."""
        fallback = self.fallback
        author = fallback if fallback is not None and self._fallback_planned(record) else self.first
        record, report, may_fall_back = self._checked(record, author)
        if not report.passed and may_fall_back and fallback is not None and author is not fallback:
            why = f"was rejected twice: {' '.join(report.reasons)}"
            try:
                other = self._stepped_in(record, fallback, why)
            except _FAILED as error:
                record = _noted(record, f"The fallback planner failed: {error}")
            else:
                record, report = self._fallback_checked(record, report, other, fallback)
        record = replace(record, checks=report)
        if not report.passed:
            return replace(record, failure=Failure("check", "rejected", " ".join(report.reasons)))
        return record

    def _fallback_checked(
        self, record: EpisodeRecord, report: CheckReport, other: EpisodeRecord, fallback: NamedPlanner
    ) -> tuple[EpisodeRecord, CheckReport]:
        """The fallback's plan, checked; if it has none either, the rejected one stays."""
        refusal = other.planned.plan.abstention
        if refusal is not None:
            note = f"The fallback planner declined ({refusal.kind}): {refusal.message}"
            return _noted(replace(record, notes=other.notes), note), report
        return self._checked(other, fallback)[:2]

    def _fallback_planned(self, record: EpisodeRecord) -> bool:
        return self.fallback is not None and record.planned.plan.fallback == self.fallback.name

    def _checked(
        self, record: EpisodeRecord, author: NamedPlanner
    ) -> tuple[EpisodeRecord, CheckReport, bool]:
        """The plan's report (the second plan's if the first was rejected), and whether the fallback may try."""
        report = check_plan(record, self.arm)
        if report.passed:
            return record, report, False
        first, reasons = record.planned.plan, report.reasons
        try:
            again = self._ask(record, author, reasons, first)
        except _FAILED as error:
            if self.fallback is None or author is self.fallback:
                raise
            note = f"The plan was rejected; asked again, the planner failed: {error}"
            return _noted(record, note), report, True
        if again.abstention is not None:
            answer = f"asked again, the planner declined: {again.abstention.message}"
            record = _noted(record, f"The plan was rejected ({'; '.join(reasons)}); {answer}")
            return record, report, again.abstention.gives_way
        if first.fallback and not again.fallback:
            again = replace(again, fallback=first.fallback)
        note = f"The first plan was rejected ({'; '.join(reasons)}) and the planner asked again."
        record = _noted(replace(record, plan=again), note)
        return record, check_plan(record, self.arm), True

    def _answered(self, record: EpisodeRecord, planner: NamedPlanner) -> EpisodeRecord:
        """The record with one planner's answer; it is asked again if the first one is not a plan."""
        try:
            plan = self._ask(record, planner)
        except PlannerTimeoutError:
            raise
        except PlanningError as error:
            plan = self._ask(record, planner, (str(error),))
            record = _noted(record, f"{error} It was asked again.")
        if plan.fallback:
            record = _noted(record, f"The planner '{plan.fallback}' stepped in.")
        return replace(record, plan=plan)

    def _stepped_in(self, record: EpisodeRecord, fallback: NamedPlanner, why: str) -> EpisodeRecord:
        """The record with the fallback's plan; the previous planner's conversation is kept."""
        earlier = record.plan.transcript if record.plan is not None else ()
        note = f"The planner '{self.first.name}' {why} The fallback planner '{fallback.name}' stepped in."
        record = _noted(replace(record, plan=None), note)
        try:
            record = self._answered(record, fallback)
        except _FAILED as error:
            late = isinstance(error, PlannerTimeoutError)
            kind = PlannerTimeoutError if late else PlanningError
            raise kind(f"{note} It failed too: {error}") from error
        plan = record.planned.plan
        plan = replace(plan, fallback=fallback.name, transcript=(*earlier, *plan.transcript))
        return replace(record, plan=plan)

    def _ask(
        self,
        record: EpisodeRecord,
        asked: NamedPlanner,
        rejections: tuple[str, ...] = (),
        rejected: Plan | None = None,
    ) -> Plan:
        seen = record.seen
        request = PlanRequest(
            instruction=record.instruction,
            scene=seen.scene,
            arm=self.arm,
            start=seen.observation.world_from_tcp,
            joints=seen.observation.joints,
            observation=seen.observation,
            advice=advice_for(record, self.skills),
            rejections=rejections,
            skills=self.skills,
            rejected=rejected,
        )
        return ask(asked.planner, request, asked.name, self.seconds)


def check_plan(record: EpisodeRecord, arm: Arm) -> CheckReport:
    """The report of all checks on the record's plan, with the effects that apply to its theme."""
    given, observation = record.executable, record.seen.observation
    return check_trajectory(
        given.trajectory,
        given.scene,
        arm,
        observation.world_from_tcp,
        observation.joints,
        own_first(advice_for(record).effects, look_of(theme_of(record), given.scene)),
        given.plan.parameters,
        skill=given.plan.skill,
        lengths=handled_lengths(record),
    )


def _noted(record: EpisodeRecord, note: str) -> EpisodeRecord:
    return replace(record, notes=(*record.notes, note))
