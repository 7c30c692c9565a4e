"""Running the robot suite's episodes in a worker process: building the parts once, one episode after the other."""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator, Mapping
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gvla2.catalog import Registry, nothing_in
from gvla2.commands.bench_arms import BenchArm, arm_named, has_bank
from gvla2.commands.bench_config import BenchConfig
from gvla2.commands.bench_subjects import subject_options
from gvla2.commands.run import GEOMETRY, LOOP, EpisodeReporter, build_parts
from gvla2.evaluation.robot.design import failure_class

if TYPE_CHECKING:
    from gvla2.episode import Parts
    from gvla2.evaluation.robot.experience import Experience
    from gvla2.language.endpoint import LanguageModel
    from gvla2.memory.contracts import Memory, MemoryTask
    from gvla2.record.contents import EpisodeRecord
    from gvla2.record.recorder import RunRecorder

MEMORY = ("memory", "retriever", "embedder", "inducer", "judge")
HELPED = ("camera", *MEMORY, "language")
EXPLORED = "exploration"
"""The arm whose episodes the others learn from."""
RARELY = 0.05
"""Pictures per second of an episode that is not filmed."""


@dataclass(frozen=True)
class EpisodeUnit:
    """One process's unit of work: some episodes of one row of the bench (``task``) in one arm.

    ``layouts`` are the seeds that lay them out. The arm ``exploration`` varies the planner's theta and recalls nothing.
    ``bank`` is the file of the arm's frozen bank, "" if it has none; ``experiences`` are what an arm without a file
    learns from; ``asked`` is what ``shuffled`` asks instead (None: no such question). ``film`` names a folder for
    complete run pages.
    """

    config: BenchConfig
    task: str
    arm: str
    layouts: tuple[int, ...]
    bank: str = ""
    experiences: tuple[Experience, ...] = ()
    asked: MemoryTask | None = None
    film: str = ""


@dataclass(frozen=True)
class EpisodeOutcome:
    """The result of one episode; plain data. ``succeeded`` by profile; ``spent`` is what planning took, by measure;
    ``experience`` comes from exploration only, one per attempt and part.
    """

    layout: int
    succeeded: Mapping[str, bool]
    seconds: float
    failure: str
    message: str
    spent: Mapping[str, float | None]
    notes: Mapping[str, Any]
    experience: tuple[Experience, ...] = ()


def chosen_parts(
    config: BenchConfig, registry: Registry, subject: str, *, filmed: bool = False
) -> dict[str, Any]:
    """What to build for a row of the bench (see :func:`~gvla2.commands.bench_subjects.subjects`), by kind, without its
    memory.
    """
    root: dict[str, Any] = {
        kind: getattr(config, kind) for kind in (*LOOP, *GEOMETRY, *HELPED) if kind not in ("task", "memory")
    }
    robot = config.robot
    if not filmed and "video_fps" in {field.name for field in fields(robot)}:
        root["robot"] = replace(robot, video_fps=RARELY)  # type: ignore[call-arg]
    return {**root, "task": subject_options(config, registry, subject), "memory": {"name": "none"}}


def chosen_memory(config: BenchConfig, registry: Registry, arm: BenchArm, bank: str) -> dict[str, Any]:
    """What to build for an arm's memory; one that has a ``url`` option keeps its bank in the file ``bank``."""
    options = {"name": arm.memory, **arm.options}
    if has_bank(registry, arm):
        options |= {"url": f"sqlite:///{bank}"}
    return {
        **{kind: getattr(config, kind) for kind in (*MEMORY[1:], "verifier", "language")},
        "memory": options,
    }


def configured(registry: Registry, root: Mapping[str, Any], kinds: Iterable[str]) -> list[Any]:
    """The typed options of the kinds (empty slots have none), and of the language model if one of them asks it."""
    found = [registry.configure(root, kind) for kind in kinds if not nothing_in(root, kind)]
    asking = any("language" in component.needs for _, component in found)
    return [options for options, _ in (*found, *([registry.configure(root, "language")] if asking else []))]


def run_unit(unit: EpisodeUnit, registry: Registry) -> list[EpisodeOutcome]:
    """Run the unit's episodes here. An episode in which a component crashed is a failure; the next has fresh parts."""
    outcomes = []
    for layout in unit.layouts:
        with _memory(unit, registry) as memory:
            parts = replace(_parts_of(unit, registry), memory=memory)
            if unit.arm == EXPLORED:
                parts = replace(parts, planner=_exploring(unit.config, registry, layout, parts.language))
            outcomes.append(_run(unit, parts, layout))
        if outcomes[-1].failure == "error":
            _forget_parts()
    return outcomes


def _run(unit: EpisodeUnit, parts: Parts, layout: int) -> EpisodeOutcome:
    from gvla2.episode import EpisodeRequest, run_episode
    from gvla2.evaluation.robot.experience import Experience

    same = ("depth_noise", "planner_timeout", "max_parts", "agreement")
    options: dict[str, Any] = {name: getattr(unit.config, name) for name in same}
    source = f"{unit.task}-{unit.arm}-{layout}"
    request = EpisodeRequest(seed=layout, source=source, replan=_tries(unit), **options)
    listener = EpisodeReporter(_filming(unit, layout))
    started = time.perf_counter()
    with suppress(Exception):  # the record says what crashed; it must not end an ablation of many hours
        run_episode(parts, request, listener)
    seconds = time.perf_counter() - started
    record = listener.latest
    assert record is not None
    listener.finish()
    judged = record.judgement
    succeeded = {"eased": bool(judged and judged.eased), "strict": bool(judged and judged.strict)}
    failure = failure_class(record)
    explored = Experience.of(record, parts.skills) if unit.arm == EXPLORED else ()
    return EpisodeOutcome(
        layout,
        succeeded,
        round(seconds, 3),
        failure or ("" if succeeded["eased"] else "unnoticed"),
        record.failure.message if record.failure else "",
        spent_on(record),
        _notes(record),
        explored,
    )


def _filming(unit: EpisodeUnit, layout: int) -> RunRecorder | None:
    """A recorder that writes everything `gvla2 run` does, if a film was requested."""
    from gvla2.record.recorder import RunRecorder

    told = f"# gvla2 bench suite=robot: task {unit.task}, arm {unit.arm}\n"
    return RunRecorder(Path(unit.film) / str(layout), told, command="bench") if unit.film else None


def _tries(unit: EpisodeUnit) -> int:
    """Further attempts that an episode of the unit may make."""
    if unit.arm == EXPLORED:
        return unit.config.exploration_replan
    own = arm_named(unit.config, unit.arm).replan
    return unit.config.replan if own is None else own


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


def _exploring(config: BenchConfig, registry: Registry, layout: int, language: LanguageModel | None) -> Any:
    """The planner with its theta varied, differently in each episode; unchanged if it has no such option."""
    given = {field.name for field in fields(config.planner)}
    planner = config.planner
    if {"explore", "explore_seed"} <= given:
        planner = replace(planner, explore=config.exploration, explore_seed=layout)  # type: ignore[call-arg]
    return registry.build({"planner": planner}, "planner", {"language": language} if language else None)


@contextmanager
def _memory(unit: EpisodeUnit, registry: Registry) -> Iterator[Memory]:
    """The frozen memory of the unit's arm."""
    from gvla2.evaluation.robot.arms import BestTheta, Frozen, Shuffled
    from gvla2.evaluation.robot.experience import teach

    arm = arm_named(unit.config, "off" if unit.arm == EXPLORED else unit.arm)
    if arm.source == "best_theta":
        yield BestTheta(unit.experiences)
        return
    if arm.source == "off":
        with closing(registry.build({"memory": {"name": "none"}}, "memory")) as memory:
            yield Frozen(memory)
        return
    root = chosen_memory(unit.config, registry, arm, unit.bank)
    with closing(registry.build(root, "memory")) as memory:
        if not has_bank(registry, arm):
            teach(memory, unit.experiences)
        yield Shuffled(memory, unit.asked) if arm.source == "shuffled" else Frozen(memory)


_kept: dict[str, Parts] = {}
"""The parts of the task that this process worked on last: a robot takes a second to build."""


def _parts_of(unit: EpisodeUnit, registry: Registry) -> Parts:
    key = repr((unit.config, unit.task, bool(unit.film)))
    if key not in _kept:
        _forget_parts()
        root = chosen_parts(unit.config, registry, unit.task, filmed=bool(unit.film))
        named = {kind: getattr(unit.config, kind).name for kind in (*LOOP, *GEOMETRY) if kind != "task"}
        _kept[key] = build_parts(root, registry, {**named, "task": unit.task})
    return replace(_kept[key], choices={**_kept[key].choices, "memory": unit.arm})


def _forget_parts() -> None:
    for parts in _kept.values():
        parts.robot.close()
        parts.memory.close()
    _kept.clear()
