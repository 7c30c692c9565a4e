"""One episode of the robot suite, as a worker process runs it: its parts, its memory, its rows."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gvla2.commands.bench_arms import MEMORY, BenchArm, chosen_memory, has_bank
from gvla2.commands.bench_config import BenchConfig
from gvla2.commands.bench_subjects import subject_options
from gvla2.commands.run import GEOMETRY, LOOP, EpisodeReporter, build_components
from gvla2.evaluation.robot.design import NOT_MEASURED, failure_class
from gvla2.plugins.registry import Registry

if TYPE_CHECKING:
    from gvla2.episode.loop import Components
    from gvla2.episode.record import EpisodeRecord
    from gvla2.evaluation.results import Cell
    from gvla2.evaluation.robot.experience import Experience
    from gvla2.memory.contracts import Memory, MemoryTask

HELPED = ("camera", *MEMORY, "language")
EXPLORED = "exploration"
"""The arm whose episodes the others learn from: it varies the planner's theta and recalls nothing."""


@dataclass(frozen=True)
class Lessons:
    """What an arm has learnt before an episode: ``bank`` is its frozen bank's file, "" if it keeps none.

    ``experiences`` are what an arm without a file learns from; ``asked`` is what ``shuffled`` asks instead of the
    episode's own question (None: no such question).
    """

    bank: str = ""
    experiences: tuple[Experience, ...] = ()
    asked: MemoryTask | None = None


@dataclass(frozen=True)
class Planned:
    """An episode of the design: a row of the bench (``task``) in one arm, laid out by the seed ``layout``.

    ``keys`` of its cells are by profile, ``factors`` what these have in common; ``config`` is the bench with the
    planner that plans. ``film`` names a folder for a complete run page.
    """

    config: BenchConfig
    task: str
    arm: BenchArm
    layout: int
    keys: Mapping[str, str]
    factors: Mapping[str, str | int]
    lessons: Lessons = Lessons()
    film: str = ""

    @property
    def rows(self) -> Sequence[str]:
        """The keys of its cells."""
        return tuple(self.keys.values())

    @property
    def label(self) -> str:
        """Its planner, task and arm."""
        return f"{self.config.planner.name}, {self.task}, {self.arm.name}"


def chosen_parts(config: BenchConfig, registry: Registry, subject: str) -> dict[str, Any]:
    """What to build for a row of the bench (see :func:`~gvla2.commands.bench_subjects.subjects`), by kind, without its
    memory.
    """
    root: dict[str, Any] = {
        kind: getattr(config, kind) for kind in (*LOOP, *GEOMETRY, *HELPED) if kind not in ("task", "memory")
    }
    return {**root, "task": subject_options(config, registry, subject), "memory": {"name": "none"}}


def run_unit(unit: Planned, registry: Registry) -> list[Cell]:
    """Run the episode here. One in which a component crashed is a failure; the next has fresh parts."""
    from gvla2.evaluation.robot.experience import Experience

    with _memory(unit, registry) as memory:
        parts = replace(_parts_of(unit, registry), memory=memory)
        if unit.arm.name == EXPLORED:
            parts = replace(parts, planner=_exploring(unit, registry, parts))
        record, seconds = _run(unit, parts)
        explored = Experience.of(record, parts.skills) if unit.arm.name == EXPLORED else ()
    if failure_class(record) == "error":
        _forget_parts()
    return cells_of(unit, record, seconds, explored)


def _run(unit: Planned, parts: Components) -> tuple[EpisodeRecord, float]:
    """The episode's record, and its seconds. A film has everything that `gvla2 run` writes."""
    from gvla2.episode.loop import EpisodeRequest, run_episode
    from gvla2.record.recorder import RunRecorder

    same = ("depth_noise", "planner_timeout", "max_parts")
    options: dict[str, Any] = {name: getattr(unit.config, name) for name in same}
    replan = unit.config.replan if unit.arm.replan is None else unit.arm.replan
    source = f"{unit.task}-{unit.arm.name}-{unit.layout}"
    request = EpisodeRequest(seed=unit.layout, source=source, replan=replan, **options)
    told = f"# gvla2 bench suite=robot: task {unit.task}, arm {unit.arm.name}\n"
    film = RunRecorder(Path(unit.film) / str(unit.layout), told, command="bench") if unit.film else None
    listener = EpisodeReporter(film)
    started = time.perf_counter()
    with suppress(Exception):  # the record says what crashed; it must not end an ablation of many hours
        run_episode(parts, request, listener)
    seconds = time.perf_counter() - started
    assert listener.latest is not None
    listener.finish()
    return listener.latest, round(seconds, 3)


def cells_of(
    unit: Planned, record: EpisodeRecord, seconds: float, explored: Sequence[Experience] = ()
) -> list[Cell]:
    """The episode's cells, one for each profile; ``explored`` is what others can learn from it."""
    from gvla2.evaluation.results import Cell

    judged = record.success_check
    relaxed, strict = bool(judged and judged.relaxed), bool(judged and judged.strict)
    why = failure_class(record) or ("" if relaxed else "unnoticed")
    message = record.failure.message if record.failure else ""
    measured = why not in NOT_MEASURED
    status = "ok" if measured else f"not measured: {why}"
    notes: dict[str, Any] = {"status": status, "layout": unit.layout, **_notes(record)}
    if explored:
        notes["experience"] = [one.to_json() for one in explored]
    cells = []
    for profile, key in unit.keys.items():
        done = strict if profile == "strict" else relaxed
        told = (
            {"failure": "", "message": ""} if done else {"failure": why or "not_strictly", "message": message}
        )
        factors = dict(unit.factors) | ({} if profile == "both" else {"profile": profile})
        measures = {"success": done if measured else None, "seconds": seconds, **spent_on(record)}
        cells.append(Cell(key, factors, measures, {**notes, **told}))
    return cells


def spent_on(record: EpisodeRecord) -> dict[str, float | None]:
    """Seconds of planning in all attempts and parts (None if there was none), and the use of language models.

    Checking counts as planning: it asks again after a rejected plan.

    ``calls`` cost tokens, ``cached`` ones did not; tokens are the server's own count, None if it gave none.
    """
    timings = [each.timings for each in _all_of(record) if "plan" in each.timings]
    planning = [each["plan"] + each.get("check", 0.0) for each in timings]
    tallies = record.language.values()
    counts: dict[str, float | None] = {
        name: sum(tally.get(name, 0) for tally in tallies)
        for name in ("calls", "cached", "prompt_tokens", "completion_tokens")
    }
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
        "skills": [part.plan.skill if part.plan else "" for part in record.whole],
        "fallback": fallbacks[0] if fallbacks else "",
        "language": {purpose: dict(tally) for purpose, tally in record.language.items()},
        "verdict": record.verdict.outcome if record.verdict else "",
        "quality": record.verdict.quality if record.verdict else None,
        "recalled": [item.id for item in recalled.items] if recalled else [],
        "abstained": recalled.abstained if recalled else "",
        "degraded": recalled.degraded if recalled else "",
        "parameters": dict(plan.parameters) if plan else {},
        "timings": dict(record.timings),
        "parts": [dict(part.timings) for part in record.parts],
    }


def _exploring(unit: Planned, registry: Registry, parts: Components) -> Any:
    """The planner with its theta varied, differently in each episode; unchanged if it has no such option."""
    planner = unit.config.planner
    if {"explore", "explore_seed"} <= {field.name for field in fields(planner)}:
        planner = replace(planner, explore=unit.config.exploration, explore_seed=unit.layout)  # type: ignore[call-arg]
    given = {"language": parts.language} if parts.language else None
    return registry.build({"planner": planner}, "planner", given)


@contextmanager
def _memory(unit: Planned, registry: Registry) -> Iterator[Memory]:
    """The frozen memory of the episode's arm."""
    from gvla2.evaluation.robot.arms import BestTheta, Frozen, Shuffled
    from gvla2.evaluation.robot.experience import teach

    arm, lessons = unit.arm, unit.lessons
    if arm.source == "best_theta":
        yield BestTheta(lessons.experiences)
        return
    with closing(registry.build(chosen_memory(unit.config, registry, arm, lessons.bank), "memory")) as memory:
        if not has_bank(registry, arm):
            teach(memory, lessons.experiences)
        yield Shuffled(memory, lessons.asked) if arm.source == "shuffled" else Frozen(memory)


_kept: dict[str, Components] = {}
"""The parts of the task that this process worked on last: a robot takes a second to build."""


def _parts_of(unit: Planned, registry: Registry) -> Components:
    key = repr((unit.config, unit.task))
    if key not in _kept:
        _forget_parts()
        root = chosen_parts(unit.config, registry, unit.task)
        named = {kind: getattr(unit.config, kind).name for kind in (*LOOP, *GEOMETRY) if kind != "task"}
        _kept[key] = build_components(root, registry, {**named, "task": unit.task}, unit.config.branch)
    return replace(_kept[key], choices={**_kept[key].choices, "memory": unit.arm.name})


def _forget_parts() -> None:
    for parts in _kept.values():
        parts.robot.close()
        parts.memory.close()
    _kept.clear()
