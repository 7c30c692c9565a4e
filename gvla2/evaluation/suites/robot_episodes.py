"""One episode of the robot suite, as a worker process runs it: its components, its memory, its rows."""

from __future__ import annotations

import logging
import shutil
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

from omegaconf import OmegaConf

from gvla2.episode.lessons import stories_of
from gvla2.episode.loop import Components, EpisodeRequest, SilentListener, planned_again, run_episode
from gvla2.episode.record import VOID, EpisodeRecord, Stage
from gvla2.episode.refine import GeometryComponents
from gvla2.evaluation.arms import (
    MEMORY,
    PERCEIVED,
    STORIES,
    BenchArm,
    Frozen,
    Shuffled,
    Story,
    open_memory,
    teach,
)
from gvla2.evaluation.config import RobotBench
from gvla2.evaluation.engine import Unit
from gvla2.evaluation.results import Cell
from gvla2.evaluation.suites.robot_conditions import Reworded, sentences_of
from gvla2.geometry.views import Views
from gvla2.memory.contracts import Memory, MemoryTask
from gvla2.plugins.assembly import GEOMETRY, LOOP, build_components
from gvla2.plugins.registry import Registry
from gvla2.record.origin import Origin
from gvla2.record.recorder import RunRecorder
from gvla2.robot.backend import Moment

log = logging.getLogger(__name__)

EXPLORED = "exploration"
"""The arm whose episodes the others learn from: it varies the planner's theta and recalls nothing."""
NOT_MEASURED = ("timeout", "unavailable", "setup", VOID)
"""Kinds of failure that do not count against an arm: its planner timed out, its model was unavailable, it could not be
set up, or the simulated world blew up."""
UNSEEN = ("nothing_matches", "ambiguous", "perception")


@dataclass(frozen=True)
class Lessons:
    """What an arm has learned before an episode: ``bank`` is its frozen bank's file, "" if it keeps none.

    ``stories`` are what an arm without a file learns from; ``asked`` is what ``shuffled`` asks instead of the
    episode's own question (None: no such question).
    """

    bank: str = ""
    stories: tuple[Story, ...] = ()
    asked: MemoryTask | None = None


@dataclass(frozen=True)
class EpisodeUnit(Unit):
    """An episode of the design: a row of the bench in one arm, laid out by the seed ``layout``.

    ``subject`` names the row; ``task`` is the task's name and options; ``profiles`` are those of its cells, in the
    order of ``keys``, and ``factors`` what the cells have in common; ``config`` is the bench with the planner, and
    ``world`` the name of the design's world.
    ``folder`` is for the episode's film and page, if it has them, which name the bench's ``origin``.
    """

    config: RobotBench
    subject: str
    task: Mapping[str, Any]
    arm: BenchArm
    layout: int
    factors: Mapping[str, str | int]
    profiles: tuple[str, ...] = ("",)
    world: str = ""
    lessons: Lessons = Lessons()
    folder: Path | None = None
    origin: Origin | None = None


@dataclass(frozen=True)
class EpisodeGroup(Unit):
    """Episodes of one task in one layout, in different arms: those whose arms move alike share a simulation."""

    episodes: tuple[EpisodeUnit, ...]


def chosen_components(config: RobotBench, task: Mapping[str, Any]) -> dict[str, Any]:
    """What to build for a task, by kind, without its memory."""
    kinds = ("camera", *LOOP, *GEOMETRY, *MEMORY[1:], "language")
    chosen = {kind: getattr(config, kind) for kind in kinds if kind != "task"}
    return {**chosen, "task": dict(task), "memory": {"name": "none"}}


Ran = tuple[EpisodeRecord, float]
"""An episode's record and its seconds."""


def run_group(group: EpisodeGroup, registry: Registry) -> Iterator[Cell]:
    """Run the episodes here."""
    ran: list[Ran] = []
    for unit in group.episodes:  # one with a geometry of its own plans for another scene
        yield from run_unit(unit, registry, [] if unit.arm.geometry else ran)


def run_unit(unit: EpisodeUnit, registry: Registry, ran: list[Ran]) -> list[Cell]:
    """Run one of a group's episodes and add it to those that ``ran``.

    One in which a component crashed is a failure; the next has fresh components.
    """
    exploring = unit.arm.name == EXPLORED
    with _memory(unit, registry) as memory:
        components = replace(_components_of(unit, registry), memory=memory)
        if exploring:
            components = replace(components, planner=_exploring(unit, registry, components))
        record, seconds = _alike(unit, components, ran) or _run(unit, components)
        explored = tuple(stories_of(record, components.skills)) if exploring else ()
    if failure_class(record) in ("error", "setup"):
        release()
    ran.append((record, seconds))
    return cells_of(unit, record, seconds, explored)


def _alike(unit: EpisodeUnit, components: Components, ran: Sequence[Ran]) -> Ran | None:
    """The episode by that of another arm in the same layout that planned the same motion, if there is one.

    A simulated episode follows from its layout and its motion. Where the memory could have a say again later (further
    tries, a next part, a model's answer) the episode is run.
    """
    tries = unit.config.second_tries + (unit.config.replan if unit.arm.replan is None else unit.arm.replan)
    if tries or not ran or unit.folder is not None or components.language is not None:
        return None
    with suppress(Exception):  # what crashes is run, and recorded there
        planned = planned_again(ran[0][0], components, _request(unit))
        moves = None if planned.failure is not None else planned.executable.trajectory
        for record, seconds in ran:
            plan, later = record.plan, record.parts or record.attempts
            if plan is None or record.report is None or later or plan.remaining:
                continue
            if plan.trajectory == moves:
                notes = {name: getattr(planned, name) for name in ("recalled", "plan", "checks", "notes")}
                return replace(record, choices=components.choices, **notes), seconds
    return None


class _Watched(SilentListener):
    """Keeps the latest record of an episode and the moments of its motion, whose frames are drawn if it is written."""

    record: EpisodeRecord | None = None

    def __init__(self) -> None:
        self._moments: list[Moment] = []

    def stage(self, record: EpisodeRecord, stage: Stage) -> None:
        """Keep the record."""
        self.record = record

    def moment(self, moment: Moment) -> None:
        """Keep the robot's state at a frame."""
        self._moments.append(moment)

    def write(self, folder: Path, config: RobotBench, origin: Origin | None) -> None:
        """The episode's folder, with its film and page."""
        assert self.record is not None
        recorder = RunRecorder(folder, OmegaConf.to_yaml(OmegaConf.structured(config)), "bench", origin)
        for moment in self._moments:
            image = recorder.attempt("A frame of the film", moment.draw) if moment.draw is not None else None
            if image is not None:
                recorder.moment(moment)
                recorder.frame(image)
        recorder.finish(self.record)


def _run(unit: EpisodeUnit, components: Components) -> tuple[EpisodeRecord, float]:
    """The episode's record, and its seconds without those of its folder."""
    config, listener = unit.config, _Watched()
    started = time.perf_counter()
    with suppress(Exception):  # the record says what crashed; it must not end an ablation of many hours
        run_episode(components, _request(unit), listener)
    seconds = time.perf_counter() - started
    assert listener.record is not None
    if unit.folder is not None:
        shutil.rmtree(unit.folder, ignore_errors=True)  # of an earlier try
        check = listener.record.success_check
        if config.films == "all" or not (check and check.relaxed):
            listener.write(unit.folder, config, unit.origin)
    return listener.record, round(seconds, 3)


def _request(unit: EpisodeUnit) -> EpisodeRequest:
    config, arm = unit.config, unit.arm
    return EpisodeRequest(
        seed=unit.layout,
        source=f"{unit.subject}-{arm.name}-{unit.layout}",
        second_tries=0 if arm.name == EXPLORED else config.second_tries,
        replan=config.replan if arm.replan is None else arm.replan,
        depth_noise=config.depth_noise,
        planner_timeout=config.planner_timeout,
    )


def cells_of(
    unit: EpisodeUnit, record: EpisodeRecord, seconds: float, explored: tuple[Story, ...] = ()
) -> list[Cell]:
    """The episode's cells, one for each profile; ``explored`` is what others can learn from it."""
    check = record.success_check
    relaxed, strict = bool(check and check.relaxed), bool(check and check.strict)
    why = failure_class(record) or ("" if relaxed else "unnoticed")
    message = record.failure.message if record.failure else ""
    measured = why not in NOT_MEASURED
    if not measured:
        log.warning("%s, layout %d is not measured (%s): %s", unit.subject, unit.layout, why, message)
    notes: dict[str, Any] = {
        "status": "ok" if measured else f"not measured: {why}",
        "layout": unit.layout,
        "folder": str(unit.folder.absolute()) if unit.folder is not None and unit.folder.is_dir() else "",
        **_notes(record),
        **({"stories": STORIES.dump_python(explored, mode="json")} if explored else {}),
    }
    cells = []
    for profile, key in zip(unit.profiles, unit.keys, strict=True):
        done = strict if profile == "strict" else relaxed
        failure = {} if done else {"failure": why or "not_strictly", "message": message}
        factors = dict(unit.factors) | ({"profile": profile} if profile else {})
        measures = {
            "success": done if measured else None,
            "seconds": seconds,
            "width_error": _width_error(record),
            **spent_on(record),
        }
        cells.append(Cell(key, factors, measures, {"failure": "", "message": "", **notes, **failure}))
    return cells


def _width_error(record: EpisodeRecord) -> float | None:
    """Mean error of the first try's boxes that refinement looked at, mm; None where it looked at none."""
    looked = next((each.refined for each in reversed(_all_of(record)) if each.refined), ())
    errors = [one.width_error for one in looked if one.width_error is not None]
    return 1e3 * sum(errors) / len(errors) if errors else None


def failure_class(record: EpisodeRecord) -> str:
    """Where an episode that did not reach its goal went wrong, in one of eleven words; "" for no failure.

    ``unnoticed``: the robot's own verifier saw nothing wrong. ``not_achieved``: it ran to its end and noticed the
    failure. ``unavailable``: the planner's model did not answer; the plan, if any, was another's.
    """
    failure = record.failure
    asked = record.language.get("plan", {})
    if asked.get("failed") and not asked.get("calls") and not asked.get("cached"):
        return "unavailable"
    if failure is None:
        return ""
    if failure.stage == "setup":
        return "setup"
    if failure.kind in NOT_MEASURED:
        return failure.kind
    if failure.kind in ("crashed", "error", "interrupted"):
        return "error"
    if failure.stage in ("observe", "perceive", "reconstruct") or failure.kind in UNSEEN:
        return "perception"
    if failure.stage == "execute":
        return "grasp" if failure.kind == "slipped" else "execution"
    by_stage = {"plan": "abstained", "check": "plan_rejected", "success_check": "unnoticed"}
    return by_stage.get(failure.stage, "not_achieved")


def spent_on(record: EpisodeRecord) -> dict[str, float | None]:
    """Seconds of planning in all attempts and parts (None if there was none), and the use of language models.

    Checking counts as planning: it asks again after a rejected plan. ``calls`` cost tokens, ``cached`` ones did not;
    tokens are the server's own count, None if it gave none.
    """
    timings = [each.timings for each in _all_of(record) if "plan" in each.timings]
    planning = [each["plan"] + each.get("check", 0.0) for each in timings]
    tallies = record.language.values()
    names = ("calls", "cached", "prompt_tokens", "completion_tokens")
    counts: dict[str, float | None] = {name: sum(t.get(name, 0) for t in tallies) for name in names}
    if any(tally.get("unmetered") for tally in tallies):
        counts |= {"prompt_tokens": None, "completion_tokens": None}
    return {"planning_seconds": round(sum(planning), 4) if planning else None, **counts}


def _all_of(record: EpisodeRecord) -> list[EpisodeRecord]:
    """The record and those of its earlier attempts and parts, and theirs."""
    return [record, *(one for each in (*record.attempts, *record.parts) for one in _all_of(each))]


def _notes(record: EpisodeRecord) -> dict[str, Any]:
    recalled, plan = record.recalled, record.plan
    fallbacks = [each.plan.fallback for each in _all_of(record) if each.plan and each.plan.fallback]
    return {
        "instruction": record.instruction,
        "skill": plan.skill if plan else "",
        "fallback": fallbacks[0] if fallbacks else "",
        "second_tries": record.second_tries,
        "language": {purpose: dict(tally) for purpose, tally in record.language.items()},
        "verdict": record.verdict.outcome if record.verdict else "",
        "recalled": [item.id for item in recalled.items] if recalled else [],
        "abstained": recalled.abstained if recalled else "",
        "degraded": recalled.degraded if recalled else "",
        "parameters": dict(plan.parameters) if plan else {},
        "timings": dict(record.timings),
    }


def _exploring(unit: EpisodeUnit, registry: Registry, components: Components) -> Any:
    """The planner with its theta varied, differently in each episode; unchanged if it has no such option."""
    planner: Any = unit.config.planner
    if {"explore", "explore_seed"} <= {field.name for field in fields(planner)}:
        planner = replace(planner, explore=unit.config.exploration, explore_seed=unit.layout)
    given = {"language": components.language} if components.language else None
    return registry.build({"planner": planner}, "planner", given)


@contextmanager
def _memory(unit: EpisodeUnit, registry: Registry) -> Iterator[Memory]:
    """The frozen memory of the episode's arm."""
    arm, lessons = unit.arm, unit.lessons
    memory = _banks.get(lessons.bank) or open_memory(unit.config, registry, arm, lessons.bank)
    if lessons.bank:
        _banks[lessons.bank] = memory
    else:
        teach(memory, lessons.stories)
    try:
        yield Shuffled(memory, lessons.asked) if arm.source == "shuffled" else Frozen(memory)
    finally:
        if not lessons.bank:
            memory.close()


_banks: dict[str, Memory] = {}
"""The frozen banks that this process has opened, by their files."""
_kept: dict[str, Components] = {}
"""The components of the task that this process worked on last: a robot takes a second to build."""


def _components_of(unit: EpisodeUnit, registry: Registry) -> Components:
    key = repr((unit.config, unit.task))
    if key not in _kept:
        release()
        root = chosen_components(unit.config, unit.task)
        names = {kind: getattr(unit.config, kind).name for kind in (*LOOP, *GEOMETRY) if kind != "task"}
        built = build_components(root, registry, {**names, "task": unit.subject}, unit.config.branch)
        said = sentences_of(unit.config, unit.task["name"])
        if said and built.task is not None and not isinstance(built.task, str):
            built = replace(built, task=Reworded(built.task, said))
        _kept[key] = built
    choices = {**_kept[key].choices, "memory": unit.arm.name}
    return replace(_kept[key], choices=choices, geometry=_geometry(_kept[key].geometry, unit.arm.geometry))


def _geometry(given: GeometryComponents | None, row: str) -> GeometryComponents | None:
    """The reconstruction of an arm's row, given the bench's; that of perceived boxes makes nothing, but is reported."""
    if given is None or not row:
        return given
    if row == PERCEIVED:
        return replace(given, reconstructor=_Perceived())
    return replace(given, options=given.options.row(row))


class _Perceived:
    """Leaves every object as perceived."""

    def reconstruct(self, views: Views) -> None:
        """Nothing."""


def release() -> None:
    """Close the components and banks that this process keeps."""
    for memory in _banks.values():
        memory.close()
    _banks.clear()
    for components in _kept.values():
        components.robot.close()
        components.memory.close()
    _kept.clear()
