"""One episode, from a sentence to a lesson: the loop that ties the packages together.

    observe -> perceive -> reconstruct -> recall -> plan -> check -> execute -> verify -> learn

Read :func:`run_episode` first; each stage below it is one function from record to record. A program that takes more
than one plan runs from observe to verify part by part; a part whose object was surely missed or lost is tried again in
another way; an attempt that is seen to have failed may be repeated as a whole. A simulator's success check comes last,
after everything was learned, so that no stage can see true state.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import partial
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import NDArray

from gvla2.episode.attempts import (
    back_off,
    cameras_moved,
    hand_is_free,
    has_next_part,
    last_look_stands,
    least_seconds,
    next_attempt,
    next_part,
    part_instruction,
    previous,
    previous_attempt_stands,
    remaining_program,
    second_try,
    should_replan,
    should_try_again,
    with_covered,
)
from gvla2.episode.evidence import RobotEvidence
from gvla2.episode.lessons import memory_task, stories_of, transcript
from gvla2.episode.planning import NamedPlanner, PlannerWithFallback, with_sound_effects
from gvla2.episode.record import ABANDONED, VOID, EpisodeRecord, Failure, Stage, failure_of
from gvla2.episode.refine import GeometryComponents, Refinement, refine_scene, with_truth
from gvla2.episode.rollout import roll_out
from gvla2.errors import Gvla2Error, SimulationError, kept_alive
from gvla2.geometry.exchange import read_only
from gvla2.geometry.views import Observation
from gvla2.memory.admission import answer_of, verdict_of
from gvla2.memory.contracts import Learned, Memory, MemoryContext, Verifier
from gvla2.planning.asking import perceive
from gvla2.planning.contracts import Perceiver, Planner
from gvla2.planning.findings import CheckReport
from gvla2.planning.scene import Scene
from gvla2.planning.skill import Skill
from gvla2.robot.backend import ExecutionListener, MotionListener, RobotBackend, TimeLimited, Truthful
from gvla2.robot.depth_noise import apply_noise
from gvla2.robot.options import DepthNoise
from gvla2.robot.policy import Policy
from gvla2.robot.report import ExecutionReport, WaypointReport
from gvla2.robot.task import Task
from gvla2.skills.table import STANDARD

if TYPE_CHECKING:
    from gvla2.language.contracts import LanguageModel, Tally


@dataclass(frozen=True)
class Components:
    """The components of one run, built; ``choices`` are their names by Hydra group, ``plugins`` those of their plugins.

    ``geometry`` refines the perceived boxes, None for no reconstructor; ``fallback`` plans where the planner fails or
    declines for want of means; a ``policy``, if there is one, drives instead of all stages between setup and success
    check; ``skills`` are those that planners call; ``language`` is the model that some of them ask, None if none does.
    """

    robot: RobotBackend
    task: Task | str | None
    perceiver: Perceiver
    geometry: GeometryComponents | None
    memory: Memory
    planner: Planner
    verifier: Verifier
    choices: Mapping[str, str]
    fallback: Planner | None = None
    policy: Policy | None = None
    skills: Mapping[str, Skill] = field(default_factory=lambda: STANDARD)
    language: LanguageModel | None = None
    plugins: Mapping[str, str] = field(default_factory=dict)

    def named(self, kind: str) -> str:
        """The component in a message: "The verifier 'mine' of plugin 'yours'"."""
        plugin = self.plugins.get(kind, "")
        return f"The {kind} '{self.choices.get(kind, '')}'" + (f" of plugin '{plugin}'" if plugin else "")


@dataclass(frozen=True)
class EpisodeRequest:
    """One episode to run. Without ``instruction`` the task words its own by the seed; ``source`` identifies the run.

    An object that the hand surely missed or lost is tried again with another grasp or place, without the planner, until
    ``second_tries`` attempts have failed. After an attempt that the verifier is sure has failed there are up to
    ``replan`` further ones, planned anew. A planner that does not answer within ``planner_timeout`` seconds ends the
    episode, unless there is a fallback; 0 waits for ever.
    """

    seed: int
    instruction: str | None = None
    depth_noise: DepthNoise = field(default_factory=DepthNoise)
    source: str = ""
    second_tries: int = 2
    replan: int = 0
    planner_timeout: float = 60.0


class EpisodeListener(Protocol):
    """Follows an episode while it runs (a recorder, a progress line). Exceptions stop the episode.

    One that has ``wants_frames`` and it is False gets no frames, which then need not be drawn.
    """

    def begin(self, stage: Stage) -> None:
        """A stage starts."""
        ...

    def stage(self, record: EpisodeRecord, stage: Stage) -> None:
        """A stage ended, successfully or not; ``record`` holds everything so far."""
        ...

    def frame(self, image: NDArray[np.uint8]) -> None:
        """The robot moves: an RGB image (H, W, 3)."""
        ...


class SilentListener(EpisodeListener):
    """Ignores everything."""

    def begin(self, stage: Stage) -> None:
        """Ignored."""

    def stage(self, record: EpisodeRecord, stage: Stage) -> None:
        """Ignored."""

    def frame(self, image: NDArray[np.uint8]) -> None:
        """Ignored."""

    @property
    def wants_frames(self) -> bool:
        """Whether a subclass uses them."""
        return type(self).frame is not SilentListener.frame


_SILENT = SilentListener()


def run_episode(
    components: Components, request: EpisodeRequest, listener: EpisodeListener = _SILENT
) -> EpisodeRecord:
    """Run one episode and return its record, whose ``failure`` says where and why it ended early, if so.

    Never raises for what happens in an episode; an interrupt and a crash of a plugin are recorded as
    failures of a kind in :data:`~gvla2.episode.record.ABANDONED` (the listener has then seen the record) and raised
    again.
    """
    record = EpisodeRecord(
        episode_id=request.source or f"{components.choices.get('task') or 'episode'}/seed-{request.seed}",
        instruction=request.instruction or "",
        task=components.choices.get("task", ""),
        seed=request.seed,
        choices=components.choices,
    )
    run = _Run(components, request, listener)
    judged: _Stages = {"success_check": _check_success}
    if (policy := components.policy) is not None:
        driven: _Stages = {"execute": lambda r, run: roll_out(r, policy, run.robot, run.moving())}
        return _go_through({"setup": _set_up, **driven, **judged}, record, run)
    record = _to_the_end(_go_through({"setup": _set_up, **_ONCE}, record, run), run)
    for _ in range(request.replan):
        if not should_replan(record, components.skills):
            break
        record, moved = _another(next_attempt(record), run)
        if not moved:
            break
        record = _to_the_end(record, run)
    return _go_through({"learn": _learn, **judged}, record, run)


def planned_again(record: EpisodeRecord, components: Components, request: EpisodeRequest) -> EpisodeRecord:
    """What these components would recall and plan for the scene that an episode began with, and the checks on it;
    nothing moves.
    """
    seen = record.tries[0].whole[0].seen
    names = ("episode_id", "instruction", "task", "seed", "choices", "goal")
    look = EpisodeRecord(
        **{name: getattr(record, name) for name in names}, observation=seen.observation, scene=seen.scene
    )
    stages: _Stages = {"recall": _recall, "plan": _ONCE["plan"], "check": _ONCE["check"]}
    return _go_through(stages, look, _Run(components, request, _SILENT))


class _Run:
    """What every stage of an episode uses."""

    def __init__(self, components: Components, request: EpisodeRequest, listener: EpisodeListener) -> None:
        self.components, self.request, self.listener = components, request, listener
        self.robot = components.robot
        self._truths: dict[int, Scene] = {}
        self._before: Mapping[str, Tally] = {}
        self._before = self.cost()

    def cost(self) -> Mapping[str, Tally]:
        """The language model's cost since the episode began, by purpose."""
        language = self.components.language
        return language.ledger.totals(self._before) if language is not None else {}

    def moving(self, waypoint: Callable[[WaypointReport], None] | None = None) -> ExecutionListener:
        """The callbacks during a motion: those that the listener wants, and ``waypoint`` for each report."""
        heard: dict[str, Callable[..., None]] = {} if waypoint is None else {"waypoint": waypoint}
        if getattr(self.listener, "wants_frames", True):
            heard["frame"] = self.listener.frame
        if isinstance(self.listener, MotionListener):
            heard["moment"] = self.listener.moment
        return ExecutionListener(**heard)

    def note_truth(self, refined: Sequence[Refinement]) -> None:
        """Keep the true scene beside refined boxes until the success check, when no stage can see it any more."""
        if isinstance(self.robot, Truthful):
            self._truths[id(refined)] = self.robot.true_scene()

    def with_truth(self, record: EpisodeRecord) -> EpisodeRecord:
        """The record, its parts and attempts, with the true objects of what was refined."""
        refined = record.refined
        if refined is not None and id(refined) in self._truths:
            refined = with_truth(refined, self._truths[id(refined)])
        parts, attempts = map(self.with_truth, record.parts), map(self.with_truth, record.attempts)
        return replace(record, refined=refined, parts=tuple(parts), attempts=tuple(attempts))

    def look(self, record: EpisodeRecord, *, after: bool = False) -> Observation:
        """The robot's observation before or ``after`` the present part's motion, with the noise of this look."""
        motions = sum(len(each.whole) for each in record.attempts) + len(record.parts)
        seen, seed = self.robot.observe(), self.request.seed
        noise = np.random.default_rng([seed, 2 * motions + after])
        return read_only(apply_noise(seen, self.request.depth_noise, noise, seed))

    def perceived(self, observation: Observation, instruction: str) -> Scene:
        """The scene that the perceiver finds in an observation."""
        who, workspace = self.components.named("perceiver"), self.robot.arm.workspace
        return perceive(self.components.perceiver, observation, instruction, workspace, who)


_Function = Callable[[EpisodeRecord, _Run], EpisodeRecord]
_Stages = Mapping[Stage, _Function]


def _to_the_end(record: EpisodeRecord, run: _Run) -> EpisodeRecord:
    """Carry out the rest of an attempt's program, part by part, until it is done or a part fails for good."""
    moved, skills = True, run.components.skills
    while moved:
        if has_next_part(record):
            record = _go_through(_AGAIN, next_part(record), run)
        elif len(record.attempts) < run.request.second_tries and should_try_again(record, skills):
            if trouble := _out_of_time(record, run.robot):
                return _noted(record, trouble)
            record, moved = _another(second_try(record), run)
        else:
            break
    return record


def _out_of_time(record: EpisodeRecord, robot: RobotBackend) -> str:
    """Why the robot's world leaves no time for another try of a part that failed, "" if it does."""
    left = robot.seconds_left() if isinstance(robot, TimeLimited) else np.inf
    needed = least_seconds(record)
    if needed <= left:
        return ""
    return f"No second try: it would take {needed:.1f} s or more, and this world ends in {left:.1f} s."


def _another(record: EpisodeRecord, run: _Run) -> tuple[EpisodeRecord, bool]:
    """Another attempt, and whether it moved anything: if it did not, the one before stands."""
    record = _go_through(_AGAIN, record, run)
    broken = record.failure is not None and record.failure.kind in (*ABANDONED, VOID)
    if record.report is None and not broken:
        return previous_attempt_stands(record), False
    return record, record.report is not None


def _go_through(stages: _Stages, record: EpisodeRecord, run: _Run) -> EpisodeRecord:
    for stage, function in stages.items():
        if record.failure is None or _still_worthwhile(stage, record):
            record = _run_stage(stage, function, record, run)
    return record


def _noted(record: EpisodeRecord, note: str) -> EpisodeRecord:
    """The record with a further note, "" for none."""
    return replace(record, notes=(*record.notes, note)) if note else record


class _StoppedMidwayError(Exception):
    """A stage was stopped by its cause after it had reached ``record``."""

    def __init__(self, record: EpisodeRecord) -> None:
        super().__init__()
        self.record = record


def _still_worthwhile(stage: Stage, record: EpisodeRecord) -> bool:
    """After a failure, a plan is still verified and learned from, and a laid-out scene still judged."""
    if record.failure is not None and record.failure.kind == VOID:
        return False
    if stage == "verify":
        return record.plan is not None
    earlier = bool(record.attempts or record.parts)
    if stage == "learn":
        return record.verdict is not None or earlier
    return stage == "success_check" and (record.observation is not None or earlier)


def _run_stage(stage: Stage, function: _Function, record: EpisodeRecord, run: _Run) -> EpisodeRecord:
    """Run one stage: time it, turn errors into a typed failure, notify the listener."""
    run.listener.begin(stage)
    started = time.perf_counter()

    def ended(record: EpisodeRecord) -> EpisodeRecord:
        timings = {**record.timings, stage: round(time.perf_counter() - started, 4)}
        record = replace(record, timings=timings, language=run.cost())
        run.listener.stage(record, stage)
        return record

    try:
        try:
            with kept_alive():
                record = function(
                    record, run
                )  # an interrupt of the listener must not lose what the stage found
        except _StoppedMidwayError as stopped:
            record = stopped.record
            raise stopped.__cause__ or stopped from None
        return ended(record)
    except Gvla2Error as error:
        return ended(replace(record, failure=failure_of(stage, error)))
    except KeyboardInterrupt:
        ended(replace(record, failure=Failure(stage, "interrupted", "Stopped by the user.")))
        raise
    except Exception as error:
        message = f"{type(error).__name__}: {error}"
        ended(replace(record, failure=Failure(stage, "crashed", message)))
        raise


def _set_up(record: EpisodeRecord, run: _Run) -> EpisodeRecord:
    instance = run.robot.reset(run.components.task, run.request.seed, run.request.instruction)
    if instance is None:
        return record
    return replace(record, instruction=instance.instruction, goal=instance.goal)


def _observe(record: EpisodeRecord, run: _Run) -> EpisodeRecord:
    if record.attempts or record.parts:
        last = previous(record)
        if (record.parts or record.second_try) and last_look_stands(run.robot, last):
            return replace(record, observation=last.after, scene=last.after_scene)
        record = _noted(record, back_off(run.robot, last, run.moving()))
    return replace(record, observation=run.look(record))


def _perceive(record: EpisodeRecord, run: _Run) -> EpisodeRecord:
    if record.observation is None:
        raise RuntimeError("The episode has no observation: perceive was run too early.")
    # That of the last motion's look, where that stands.
    scene = record.scene or run.perceived(record.observation, record.instruction)
    return replace(record, scene=with_covered(scene, record))


def _reconstruct(record: EpisodeRecord, run: _Run) -> EpisodeRecord:
    seen, geometry = record.seen, run.components.geometry
    if geometry is None:
        return record
    scene, refined = refine_scene(seen.scene, seen.observation, record.instruction, geometry)
    run.note_truth(refined)
    return replace(record, scene=seen.scene if scene is seen.scene else read_only(scene), refined=refined)


def _recall(record: EpisodeRecord, run: _Run) -> EpisodeRecord:
    task, memory, who = memory_task(record), run.components.memory, run.components.named("memory")
    context = answer_of(
        lambda: memory.recall(task), MemoryContext, lambda why: MemoryContext(degraded=why), who
    )
    notes = (f"Memory was not used: {context.degraded}",) if context.degraded else ()
    context, skipped = with_sound_effects(context)
    return replace(record, recalled=context, notes=record.notes + notes + skipped)


def _planner(record: EpisodeRecord, run: _Run) -> PlannerWithFallback:
    """The planner with its fallback; for a later part or a second try, the rest of the program itself."""
    components = run.components
    name, other = components.choices.get("planner", ""), components.choices.get("fallback", "fallback")
    first, fallback = NamedPlanner(name, components.planner), None
    if record.parts or record.second_try:
        first = NamedPlanner(f"{name}, part {len(record.whole)}", remaining_program(record))
    elif components.fallback is not None:
        fallback = NamedPlanner(other, components.fallback)
    return PlannerWithFallback(first, fallback, run.request.planner_timeout, run.robot.arm, components.skills)


def _execute(record: EpisodeRecord, run: _Run) -> EpisodeRecord:
    """Move, and observe the result."""
    given = record.executable
    done: list[WaypointReport] = []
    try:
        with kept_alive():
            report = run.robot.execute(given.trajectory, given.scene, run.moving(done.append))
    except (Exception, KeyboardInterrupt) as cause:
        raise _StoppedMidwayError(replace(record, report=ExecutionReport(tuple(done)))) from cause
    record = replace(record, report=report)
    if report.abort is not None:
        stopped = report.abort
        message = f"Waypoint {stopped.index} ({stopped.stage}): {stopped.message or stopped.abort}"
        record = replace(record, failure=Failure("execute", stopped.abort, message))
    try:
        after = run.look(record, after=True)
        if cameras_moved(record.seen.observation, after) and hand_is_free(report):
            # Around the scene as it is now: what the motion opened stands where nothing was.
            now = replace(record, after=after)
            with suppress(Gvla2Error):
                now = replace(now, after_scene=run.perceived(after, record.instruction))
            record = _noted(record, back_off(run.robot, now, run.moving()))
            after = run.look(record, after=True)
        return replace(record, after=after, after_scene=run.perceived(after, record.instruction))
    except SimulationError as error:
        return replace(record, failure=Failure("execute", VOID, str(error)))
    except Gvla2Error as error:
        return _noted(record, f"Nothing could be perceived at the end: {error}")


def _verify(record: EpisodeRecord, run: _Run) -> EpisodeRecord:
    given, components = record.planned, run.components
    last = record.after or record.seen.observation
    evidence = RobotEvidence(
        instruction=part_instruction(record) if record.partial else record.instruction,
        transcript=transcript(record),
        before=given.scene,
        after=record.after_scene,
        plan=given.plan,
        checks=record.checks or CheckReport(),
        report=record.report or ExecutionReport(),
        gripper_width=last.gripper_width,
    )
    name = components.choices.get("verifier", "")
    verdict = verdict_of(components.verifier, evidence, name, components.named("verifier"))
    record = replace(record, verdict=verdict)
    if verdict.outcome == "verified_fail" and record.failure is None:
        return replace(record, failure=Failure("verify", "not_achieved", " ".join(verdict.reasons)))
    return record


def _learn(record: EpisodeRecord, run: _Run) -> EpisodeRecord:
    """Report every attempt and every part to memory, each with its own verdict."""
    memory, who = run.components.memory, run.components.named("memory")
    learned = Learned.combined(
        answer_of(partial(memory.learn, episode, verdict), Learned, lambda why: Learned(degraded=why), who)
        for episode, verdict in stories_of(record, run.components.skills)
    )
    record = replace(record, learned=learned)
    return _noted(record, f"Nothing was learned: {learned.degraded}" if learned.degraded else "")


def _check_success(record: EpisodeRecord, run: _Run) -> EpisodeRecord:
    success_check = run.robot.success_check()
    record = replace(run.with_truth(record), success_check=success_check)
    if success_check is not None and not success_check.relaxed and record.failure is None:
        # The verifier saw nothing wrong, the success check did: say so rather than leave an unexplained failure.
        message = f"The success check found the goal not reached ({record.goal or 'see the task'})."
        if run.request.instruction:
            message += " It knows the task's goal, not what a sentence of your own asks."
        return replace(record, failure=Failure("success_check", "goal_not_reached", message))
    return record


_ONCE: _Stages = {
    "observe": _observe,
    "perceive": _perceive,
    "reconstruct": _reconstruct,
    "recall": _recall,
    "plan": lambda record, run: _planner(record, run).plan(record),
    "check": lambda record, run: _planner(record, run).check(record),
    "execute": _execute,
    "verify": _verify,
}
"""The stages from a look to a verdict."""
_AGAIN: _Stages = {stage: function for stage, function in _ONCE.items() if stage != "recall"}
"""Those of later parts and attempts: what memory answered stays."""
