"""Plan and check: the planner with its advice, once more if its plan is rejected, then the fallback planner.

If a planner fails (no answer, no plan, rejected twice) or declines for lack of means, the fallback may follow. That is
never silent: the plan names the planner that stepped in, and a note says why.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from gvla2.episode.attempts import present_ids
from gvla2.episode.failure_diagnosis import diagnose, theme_of
from gvla2.episode.lessons import handled_lengths
from gvla2.episode.record import EpisodeRecord, Failure
from gvla2.errors import PlannerTimeoutError, PlanningError
from gvla2.geometry.transform import FloatArray, rigid
from gvla2.language.contracts import LanguageModelError
from gvla2.memory.contracts import MemoryContext
from gvla2.planning.arm import Arm
from gvla2.planning.asking import ask
from gvla2.planning.checks import check_trajectory
from gvla2.planning.contracts import Advice, Done, Plan, Planner, PlanRequest, Tried
from gvla2.planning.effects import Bound, effect_from_json, look_of, own_first, reconciled
from gvla2.planning.findings import CheckReport
from gvla2.planning.programs import Program
from gvla2.planning.skill import Signal, Skill
from gvla2.skills.table import STANDARD

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

        Raises :class:`PlanningError`, :class:`PlannerTimeoutError` or :class:`LanguageModelError` if no planner had a
        plan.
        """
        try:
            record = replace(record, plan=self._ask(record, self.first))
            refusal = record.planned.plan.abstention
            why = f"declined ({refusal.kind}): {refusal.message}" if refusal and refusal.gives_way else ""
        except _FAILED as error:
            if self.fallback is None:
                raise
            why = f"failed: {error}"
        if why and self.fallback is not None:
            record = self._stepped_in(record, self.fallback, why)
        refusal = record.planned.plan.abstention
        if refusal is not None:
            return replace(record, failure=Failure("plan", refusal.kind, refusal.message))
        return record

    def check(self, record: EpisodeRecord) -> EpisodeRecord:
        """Check the plan; on findings ask its planner once more with them, then the fallback."""
        report, first, other = check_plan(record, self.arm), record.planned.plan, self.fallback
        author = self.first
        if other is not None and first.fallback == other.name:
            author, other = other, None
        if not report.passed:
            rejected = f"plan was rejected ({'; '.join(report.reasons)})"
            try:
                again = self._ask(record, author, report.reasons)
            except _FAILED as error:
                if other is None:
                    raise
                record = _noted(record, f"The {rejected}; asked again, the planner failed: {error}")
            else:
                refusal = again.abstention
                if refusal is not None:
                    other = other if refusal.gives_way else None
                    answer = f"asked again, the planner declined: {refusal.message}"
                    record = _noted(record, f"The {rejected}; {answer}")
                else:
                    record = replace(record, plan=replace(again, fallback=first.fallback))
                    record = _noted(record, f"The first {rejected} and the planner asked again.")
                    report = check_plan(record, self.arm)
        if not report.passed and other is not None:
            try:
                stepped = self._stepped_in(record, other, f"was rejected twice: {' '.join(report.reasons)}")
                refusal = stepped.planned.plan.abstention
                if refusal is None:
                    record, report = stepped, check_plan(stepped, self.arm)
                else:  # the rejected plan stays
                    note = f"The fallback planner declined ({refusal.kind}): {refusal.message}"
                    record = _noted(replace(record, notes=stepped.notes), note)
            except _FAILED as error:
                record = _noted(record, f"The fallback planner failed: {error}")
        record = replace(record, checks=report)
        if not report.passed:
            return replace(record, failure=Failure("check", "rejected", " ".join(report.reasons)))
        return record

    def _stepped_in(self, record: EpisodeRecord, fallback: NamedPlanner, why: str) -> EpisodeRecord:
        """The record with the fallback's plan; the previous planner's conversation is kept."""
        earlier = record.plan.transcript if record.plan is not None else ()
        note = f"The planner '{self.first.name}' {why} The fallback planner '{fallback.name}' stepped in."
        try:
            plan = self._ask(record, fallback)
        except _FAILED as error:
            kind = PlannerTimeoutError if isinstance(error, PlannerTimeoutError) else PlanningError
            raise kind(f"{note} It failed too: {error}") from error
        plan = replace(plan, fallback=fallback.name, transcript=(*earlier, *plan.transcript))
        return _noted(replace(record, plan=plan), note)

    def _ask(self, record: EpisodeRecord, asked: NamedPlanner, rejections: tuple[str, ...] = ()) -> Plan:
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


def advice_for(record: EpisodeRecord, skills: Mapping[str, Skill] = STANDARD) -> Advice:
    """Memory's text, effects (reconciled) and programs, then those of failed attempts, which bind in the same way."""
    context = record.recalled or MemoryContext()
    recalled = [(item.effect, item.id) for item in context.items if item.effect]
    known = [effect_from_json(effect, source) for effect, source in recalled]
    effects = [*reconciled(one for one in known if not isinstance(one, Program))]
    programs = [one for one in known if isinstance(one, Program)]
    lines = [context.text] if context.text else []
    done: list[Done] = []
    tried: list[Tried] = []
    for number, attempt in enumerate(record.attempts, 1):
        source, signals = f"attempt {number}", diagnose(attempt, skills)
        effects += [replace(signal.effect, source=source) for signal in signals if signal.effect is not None]
        done += _done(attempt, signals, skills)
        tried += _tried(attempt, signals, record)
        reasons = [signal.words for signal in signals]
        if not reasons and attempt.verdict is not None:
            reasons = [reason.rstrip(".") for reason in attempt.verdict.reasons]
        why = "; ".join(reasons) or "the goal was not reached"
        skill = f" ({attempt.plan.skill})" if attempt.plan is not None and attempt.plan.skill else ""
        lines.append(f"Earlier in this episode, {source}{skill} failed: {why}.")
    return Advice("\n".join(lines), tuple(effects), tuple(programs), tuple(done), tuple(tried))


def _done(attempt: EpisodeRecord, signals: Sequence[Signal], skills: Mapping[str, Skill]) -> list[Done]:
    """The value that an attempt reached for a persistent parameter, where it was not enough."""
    plan, theme = attempt.plan, theme_of(attempt)
    if plan is None or theme is None or plan.skill not in skills:
        return []
    x, y, z = (float(v) for v in theme.centre)
    short = {s.effect.parameter for s in signals if s.kind == "undershoot" and isinstance(s.effect, Bound)}
    lasting = [name for name in skills[plan.skill].lasting if name in short]
    return [Done(plan.skill, name, plan.parameters[name], (x, y, z)) for name in lasting]


def _tried(attempt: EpisodeRecord, signals: Sequence[Signal], record: EpisodeRecord) -> list[Tried]:
    """The grasp that an attempt failed with, and the place if the object got there, moved with the two objects."""
    plan, theme, before, after = attempt.plan, theme_of(attempt), attempt.scene, record.scene
    if plan is None or plan.trajectory is None or theme is None or before is None or after is None:
        return []
    close, opens = plan.trajectory.grips()
    lost = any(signal.kind in ("slip", "missed_grasp") for signal in signals)
    if close is None or (opens is None and not lost and not record.second_try):
        return []  # the grasp was not the reason
    now = present_ids(before, attempt.after_scene, after)
    poses = plan.trajectory.poses(attempt.seen.observation.world_from_tcp)

    def moved(pose: FloatArray, name: str) -> FloatArray:
        shift = after[now[name]].centre - before[name].centre if name in now else np.zeros(3)
        return rigid(None, shift) @ pose

    release = None if lost or opens is None else moved(poses[opens], plan.roles.get("goal", ""))
    return [Tried(moved(poses[close], theme.id), release)]


def with_sound_effects(context: MemoryContext) -> tuple[MemoryContext, tuple[str, ...]]:
    """The context with ill-defined effects removed from their items, and one note each."""
    items, notes = [], []
    for item in context.items:
        try:
            if item.effect:
                effect_from_json(item.effect)
        except PlanningError as error:
            notes.append(f"The effect of the remembered '{item.id}' was ignored: {error}")
            item = replace(item, effect=None)  # its words may still help
        items.append(item)
    return replace(context, items=tuple(items)), tuple(notes)
