"""Who plans: the planner, again with what was wrong with its answer, then the fallback planner.

If a planner fails (no answer, no plan, rejected twice) or declines for lack of means, another one may follow. That is
never silent: the plan names the one that stepped in, and a note says why.

With ``agreement``, or by default where the planner ``defers``, the fallback planner is asked first, about every
instruction. If it is confident, or its refusal is final, it decides and the planner is not asked. Otherwise the planner
decides; if both have plans that mean the same, the planner's is taken, and if they do not, nothing is done.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

from gvla2.episode.advice import advice_for
from gvla2.episode.fallback import check_plan
from gvla2.episode.record import EpisodeRecord, Failure
from gvla2.errors import PlannerTimeoutError, PlanningError
from gvla2.language.failures import LanguageModelError
from gvla2.planning.arm import Arm
from gvla2.planning.asking import ask
from gvla2.planning.contracts import Abstention, Plan, Planner, PlanRequest
from gvla2.planning.findings import CheckReport
from gvla2.skills.skill import Skill

_FAILED = (LanguageModelError, PlanningError)


@dataclass(frozen=True)
class Asked:
    """A planner, and its name in messages."""

    name: str
    planner: Planner


@dataclass(frozen=True)
class Consultation:
    """Whom to ask (``agreement``: the fallback first; None: as the planner ``defers``), for how many seconds each (0:
    for ever), for which arm and skills.
    """

    first: Asked
    fallback: Asked | None
    seconds: float
    arm: Arm
    skills: Mapping[str, Skill]
    agreement: bool | None = None

    def plan(self, record: EpisodeRecord) -> EpisodeRecord:
        """The record with a plan; a final abstention is its failure.

        An invalid plan is returned to its planner once, with what is wrong with it. Raises :class:`PlanningError`,
        :class:`PlannerTimeoutError` or :class:`LanguageModelError` if no planner had a plan.
        """
        record, other = self._heard(record)
        if other is None or not _decides(other):
            try:
                record = self._answered(record, self.first)
            except _FAILED as error:
                if self.fallback is None:
                    raise
                record = self._stepped_in(record, self.fallback, f"failed: {error}")
            if other is not None and not self._is_out(record):
                record = self._compared(record, other)
        plan = record.plan
        assert plan is not None
        gave_way = plan.abstention is not None and plan.abstention.gives_way
        if (
            plan.abstention is not None
            and gave_way
            and self.fallback is not None
            and not self._is_out(record)
        ):
            why = f"declined ({plan.abstention.kind}): {plan.abstention.message}"
            record = self._stepped_in(record, self.fallback, why)
            plan = record.plan
            assert plan is not None
        if plan.abstention is not None:
            return replace(record, failure=Failure("plan", plan.abstention.kind, plan.abstention.message))
        return record

    def _heard(self, record: EpisodeRecord) -> tuple[EpisodeRecord, Plan | None]:
        """The record, with the fallback's plan where that decides, and the fallback's answer if the two must agree."""
        agreed = getattr(self.first.planner, "defers", False) if self.agreement is None else self.agreement
        if not agreed or self.fallback is None:
            return record, None
        try:
            other = self._ask(record, self.fallback)
        except _FAILED as error:
            return _noted(record, f"The fallback planner was to agree, and failed: {error}"), None
        return (self._taken_over(record, other) if _decides(other) else record), other

    def _compared(self, record: EpisodeRecord, other: Plan) -> EpisodeRecord:
        """The record with the joint decision about the planner's plan and an unsure fallback's: see the module."""
        plan = record.plan
        assert plan is not None
        if other.abstention is not None or _alike(plan, other):
            return record
        if plan.abstention is not None:
            return self._taken_over(record, other) if plan.abstention.gives_way else record
        words = f"'{self.first.name}' would {plan.skill}, the fallback {other.skill}, of other things or so."
        disagree = Abstention("ambiguous", f"The two planners read the instruction differently: {words}")
        return replace(record, plan=replace(plan, trajectory=None, abstention=disagree))

    def _taken_over(self, record: EpisodeRecord, other: Plan) -> EpisodeRecord:
        """The record with the fallback's plan or refusal, and what was said before it."""
        assert self.fallback is not None
        did = f"refused ({other.abstention.kind})" if other.abstention else f"planned to {other.skill}"
        said = record.plan.transcript if record.plan is not None else ()
        plan = replace(other, fallback=self.fallback.name, transcript=(*said, *other.transcript))
        note = f"The fallback planner '{self.fallback.name}' {did} and decided."
        return _noted(replace(record, plan=plan), note)

    def check(self, record: EpisodeRecord) -> EpisodeRecord:
        """Check the plan; on findings repair it, ask its planner once more with them, then the fallback."""
        fallback = self.fallback
        author = fallback if fallback is not None and self._is_out(record) else self.first
        record, report, gives_way = self._checked(record, author)
        if not report.passed and gives_way and fallback is not None and author is not fallback:
            try:
                other = self._stepped_in(record, fallback, f"was rejected twice: {' '.join(report.reasons)}")
            except _FAILED as error:
                record = _noted(record, f"The fallback planner failed: {error}")
            else:
                record, report = self._taken(record, report, other, fallback)
        record = replace(record, checks=report)
        if not report.passed:
            return replace(record, failure=Failure("check", "rejected", " ".join(report.reasons)))
        return record

    def _taken(
        self, record: EpisodeRecord, report: CheckReport, other: EpisodeRecord, fallback: Asked
    ) -> tuple[EpisodeRecord, CheckReport]:
        """The fallback's plan, checked; if it has none either, the rejected one stays."""
        assert other.plan is not None
        if other.plan.abstention is not None:
            refusal = f"The fallback planner declined ({other.plan.abstention.kind}): {other.plan.abstention.message}"
            return _noted(replace(record, notes=other.notes), refusal), report
        return self._checked(other, fallback)[:2]

    def _is_out(self, record: EpisodeRecord) -> bool:
        """Whether the fallback has had its turn."""
        return (
            self.fallback is not None
            and record.plan is not None
            and record.plan.fallback == self.fallback.name
        )

    def _checked(self, record: EpisodeRecord, author: Asked) -> tuple[EpisodeRecord, CheckReport, bool]:
        """The plan's report (the second plan's if the first was rejected), and whether another planner may try."""
        record, report = check_plan(record, self.arm)
        if report.passed:
            return record, report, False
        reasons = report.reasons
        try:
            again = self._ask(record, author, reasons, record.plan)
        except _FAILED as error:
            if self.fallback is None or author is self.fallback:
                raise
            return (
                _noted(record, f"The plan was rejected; asked again, the planner failed: {error}"),
                report,
                True,
            )
        if again.abstention is not None:
            said = f"asked again, the planner declined: {again.abstention.message}"
            record = _noted(record, f"The plan was rejected ({'; '.join(reasons)}); {said}")
            return record, report, again.abstention.gives_way
        if record.plan is not None and record.plan.fallback and not again.fallback:
            again = replace(again, fallback=record.plan.fallback)
        note = f"The first plan was rejected ({'; '.join(reasons)}) and the planner asked again."
        record, report = check_plan(_noted(replace(record, plan=again), note), self.arm)
        return record, report, True

    def _answered(self, record: EpisodeRecord, asked: Asked) -> EpisodeRecord:
        """The record with one planner's answer; it is asked again if the first one is not a plan."""
        try:
            plan = self._ask(record, asked)
        except PlannerTimeoutError:
            raise
        except PlanningError as error:
            plan = self._ask(record, asked, (str(error),))
            record = _noted(record, f"{error} It was asked again.")
        if plan.fallback:
            record = _noted(record, f"The planner '{plan.fallback}' stepped in.")
        return replace(record, plan=plan)

    def _stepped_in(self, record: EpisodeRecord, fallback: Asked, why: str) -> EpisodeRecord:
        """The record with the fallback's plan; the previous planner's conversation is kept."""
        said = record.plan.transcript if record.plan is not None else ()
        note = f"The planner '{self.first.name}' {why} The fallback planner '{fallback.name}' stepped in."
        record = _noted(replace(record, plan=None), note)
        try:
            record = self._answered(record, fallback)
        except _FAILED as error:
            late = isinstance(error, PlannerTimeoutError)
            kind = PlannerTimeoutError if late else PlanningError
            raise kind(f"{note} It failed too: {error}") from error
        assert record.plan is not None
        plan = replace(record.plan, fallback=fallback.name, transcript=(*said, *record.plan.transcript))
        return replace(record, plan=plan)

    def _ask(
        self,
        record: EpisodeRecord,
        asked: Asked,
        rejections: tuple[str, ...] = (),
        rejected: Plan | None = None,
    ) -> Plan:
        assert record.scene is not None
        assert record.observation is not None
        request = PlanRequest(
            instruction=record.instruction,
            scene=record.scene,
            arm=self.arm,
            start=record.observation.world_from_tcp,
            joints=record.observation.joints,
            observation=record.observation,
            advice=advice_for(record, self.skills),
            rejections=rejections,
            skills=self.skills,
            rejected=rejected,
        )
        return ask(asked.planner, request, asked.name, self.seconds)


def _decides(plan: Plan) -> bool:
    """Whether it needs no second voice: it is sure, or a refusal for good."""
    return plan.sure if plan.abstention is None else not plan.abstention.gives_way


def _alike(plan: Plan, other: Plan) -> bool:
    """Whether two plans do the same to the same things, in this part and those that come after it."""
    if plan.abstention is not None or other.abstention is not None:
        return False
    ends = [[p.roles.get(role, "") for role in ("theme", "goal")] for p in (plan, other)]
    return plan.skill == other.skill and ends[0] == ends[1] and len(plan.remaining) == len(other.remaining)


def _noted(record: EpisodeRecord, note: str) -> EpisodeRecord:
    return replace(record, notes=(*record.notes, note))
