"""The record of one episode, filled stage by stage."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from typing import Any, Literal, TypeVar

from gvla2.episode.refine import Refinement
from gvla2.errors import Gvla2Error, PerceptionError, PlannerTimeoutError, PlanningError, SimulationError
from gvla2.geometry.views import Observation
from gvla2.language.contracts import ModelUnavailableError, Tally
from gvla2.memory.contracts import Learned, MemoryContext, Verdict
from gvla2.planning.contracts import AbstentionKind, Plan
from gvla2.planning.findings import CheckReport
from gvla2.planning.scene import Scene
from gvla2.planning.trajectory import Trajectory
from gvla2.robot.backend import SuccessCheck
from gvla2.robot.policy import Rollout
from gvla2.robot.report import AbortCode, ExecutionReport

Stage = Literal[
    "setup", "observe", "perceive", "reconstruct", "recall", "plan", "check", "execute", "verify", "learn",
    "success_check",
]  # fmt: skip


FailureKind = Literal[
    # not carried out
    "error", "unavailable", "crashed", "interrupted", "simulation",
    # perception and planning
    "perception", "timeout", "invalid_plan", "rejected", AbstentionKind,
    # execution and its judgement
    AbortCode, "not_achieved", "goal_not_reached",
]  # fmt: skip
"""Why an episode ended early: a stable word for tables; abstentions and aborted motions have words of their own."""


@dataclass(frozen=True)
class Failure:
    """Why an episode ended early: the ``stage``, the ``kind`` and a sentence."""

    stage: Stage
    kind: FailureKind
    message: str


ABANDONED: tuple[FailureKind, ...] = ("error", "unavailable", "crashed", "interrupted")
"""Kinds of failure that mean the episode was not carried out; every other kind is an outcome."""

PLANNING: tuple[Stage, ...] = ("plan", "check")
"""The stages at which nothing but the planner, its fallback and the skills that they call can crash."""

VOID: FailureKind = "simulation"
"""The kind of failure that makes the whole episode meaningless: its simulated world has blown up."""

_KINDS: Mapping[type[Gvla2Error], FailureKind] = {
    PerceptionError: "perception",
    PlannerTimeoutError: "timeout",  # before the planning error that it is too
    PlanningError: "invalid_plan",
    SimulationError: VOID,
    ModelUnavailableError: "unavailable",
}


@dataclass(frozen=True)
class Seen:
    """The output of ``perceive`` for the stages after it."""

    observation: Observation
    scene: Scene


@dataclass(frozen=True)
class Planned:
    """The output of ``plan`` for the stages after it; the plan may be an abstention."""

    scene: Scene
    plan: Plan


@dataclass(frozen=True)
class Executable(Planned):
    """The input of ``check`` and ``execute``: a plan with waypoints."""

    trajectory: Trajectory


@dataclass(frozen=True)
class Executed(Executable):
    """The output of ``execute``; ``after`` is the look at its end."""

    report: ExecutionReport
    after: Observation


T = TypeVar("T")


def _reached(value: T | None, what: str) -> T:
    if value is None:
        raise RuntimeError(f"The episode has no {what}: this stage was run too early.")
    return value


@dataclass(frozen=True)
class EpisodeRecord:
    """Everything about one episode; None for stages that it did not reach.

    ``choices`` are the component names by Hydra group ("robot": "sapien_panda"). ``goal`` is the success check's
    criterion, in words. ``timings`` are wall seconds per stage. ``language`` is the language models' cost so far, by
    purpose. ``notes`` are fallbacks and warnings, each a sentence that the run's page shows. ``success_check`` is the
    simulator's, from true state; it is filled last, so nothing can learn from it. ``refined`` are the boxes that the
    reconstruction branch looked at, None without a reconstructor. ``rollout`` is what a policy did,
    where one drives instead of a plan. ``attempts`` are the records of the
    attempts before this one, first to last, each with its own timings and no attempts; an episode that never replanned
    has none. A program that takes several plans is carried out part by part: ``parts`` are the records of the earlier
    parts of the same attempt, again without parts of their own. A ``second_try`` repeats the calls of the part that
    failed, the last of ``attempts``, with another grasp or place; the parts before it stay.
    """

    episode_id: str
    instruction: str
    task: str
    seed: int
    choices: Mapping[str, str]
    goal: str = ""
    observation: Observation | None = None
    scene: Scene | None = None
    refined: tuple[Refinement, ...] | None = None
    recalled: MemoryContext | None = None
    plan: Plan | None = None
    checks: CheckReport | None = None
    report: ExecutionReport | None = None
    rollout: Rollout | None = None
    after: Observation | None = None
    after_scene: Scene | None = None
    verdict: Verdict | None = None
    learned: Learned | None = None
    success_check: SuccessCheck | None = None
    failure: Failure | None = None
    timings: Mapping[str, float] = field(default_factory=dict)
    language: Mapping[str, Tally] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    attempts: tuple[EpisodeRecord, ...] = ()
    parts: tuple[EpisodeRecord, ...] = ()
    second_try: bool = False

    def __repr__(self) -> str:
        """What was asked and what became of it; not the pictures."""
        verdict = self.verdict.outcome if self.verdict else None
        asked = f"task={self.task!r}, seed={self.seed}, instruction={self.instruction!r}"
        return f"EpisodeRecord({asked}, {self.success_check}, verdict={verdict!r}, failure={self.failure})"

    @property
    def seen(self) -> Seen:
        """The perceived scene; this and the next three raise :class:`RuntimeError` before the stage that fills them."""
        return Seen(_reached(self.observation, "observation"), _reached(self.scene, "scene"))

    @property
    def planned(self) -> Planned:
        """The plan and what it was made for."""
        return Planned(_reached(self.scene, "scene"), _reached(self.plan, "plan"))

    @property
    def executable(self) -> Executable:
        """The plan with its waypoints."""
        planned = self.planned
        return Executable(**vars(planned), trajectory=_reached(planned.plan.trajectory, "trajectory"))

    @property
    def executed(self) -> Executed:
        """The motion and what was seen at its end."""
        report, after = _reached(self.report, "report"), _reached(self.after, "look at the end")
        return Executed(**vars(self.executable), report=report, after=after)

    @property
    def seconds(self) -> float:
        """Wall seconds of all stages of all attempts and their parts."""
        return sum(self.timings.values()) + sum(each.seconds for each in (*self.attempts, *self.parts))

    @property
    def memory_unavailable(self) -> str:
        """Why memory could not be used or taught, in a sentence; "" if it could."""
        return next((each.degraded for each in (self.recalled, self.learned) if each and each.degraded), "")

    @property
    def whole(self) -> tuple[EpisodeRecord, ...]:
        """The parts of this attempt, first to last, this record being the last; just one if it was not split."""
        return (*self.parts, replace(self, attempts=(), parts=()))

    @property
    def tries(self) -> tuple[EpisodeRecord, ...]:
        """The attempts, first to last, this record being the last."""
        return (*self.attempts, replace(self, attempts=()))

    @property
    def second_tries(self) -> int:
        """How many parts were tried again with another grasp or place, in all attempts."""
        return sum(part.second_try for each in self.tries for part in each.whole)

    def afresh(self, **kept: Any) -> EpisodeRecord:
        """The empty record of the next attempt or part; instruction, memory's answer and notes stay.

        ``kept`` are its attempts and parts so far.
        """
        stays = ("goal", "recalled", "learned", "success_check", "language", "notes", "attempts", "parts")
        same = {name: getattr(self, name) for name in stays} | kept
        return EpisodeRecord(self.episode_id, self.instruction, self.task, self.seed, self.choices, **same)

    @property
    def partial(self) -> bool:
        """Whether the plan is one part of a longer program."""
        return bool(self.parts) or (self.plan is not None and bool(self.plan.remaining))

    def result(self, command: str) -> dict[str, Any]:
        """``result.json``: the outcome and its components. ``success`` is the relaxed profile, None if unknown."""
        last = self.attempted()
        return {
            "command": command,
            "episode": self.episode_id,
            "success": self.success_check.relaxed if self.success_check else None,
            "success_strict": self.success_check.strict if self.success_check else None,
            "verdict": last["verdict"],
            "quality": self.verdict.quality if self.verdict else None,
            "task": self.task,
            "seed": self.seed,
            "instruction": self.instruction,
            **{kind: self.choices.get(kind) for kind in ("robot", "planner", "perceiver", "memory")},
            "fallback": self.plan.fallback if self.plan else "",
            "policy": asdict(self.rollout) if self.rollout else None,
            "choices": dict(self.choices),
            **{name: last[name] for name in ("skill", "parameters", "failure", "timings")},
            "language": {purpose: dict(tally) for purpose, tally in self.language.items()},
            "refined": [each.to_json() for each in self.refined or ()],
            "second_tries": self.second_tries,
            "attempts": [each.attempted() for each in self.tries],
            "parts": [each.attempted() for each in self.whole],
            "notes": list(self.notes),
        }

    def attempted(self) -> dict[str, Any]:
        """One of the attempts, or of their parts, in ``result.json``: what was tried and its result."""
        return {
            "skill": self.plan.skill if self.plan else None,
            "calls": [str(call) for call in self.plan.calls] if self.plan else [],
            "parameters": dict(self.plan.parameters) if self.plan else None,
            "executed": len(self.report.waypoints) if self.report else 0,
            "completed": self.report.completed if self.report else False,
            "verdict": self.verdict.outcome if self.verdict else None,
            "failure": asdict(self.failure) if self.failure else None,
            "timings": dict(self.timings),
        }


def failure_of(stage: Stage, error: Gvla2Error) -> Failure:
    """The failure of a stage that one of our errors ended."""
    known = (kind for wrong, kind in _KINDS.items() if isinstance(error, wrong))
    return Failure(stage, next(known, "error"), str(error))


def planner_crashed(record: EpisodeRecord) -> bool:
    """Whether the episode ended in a crash of its planner: a comparison of planners counts it as a failure."""
    failure = record.failure
    return failure is not None and failure.kind == "crashed" and failure.stage in PLANNING
