"""``gvla2 bench suite=robot``: success task by task, and what memory adds to it: explore, freeze, test."""

from __future__ import annotations

import logging
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gvla2.catalog import Registry
from gvla2.commands.bench_config import BenchConfig
from gvla2.commands.bench_episodes import (
    GEOMETRY,
    LOOP,
    MEMORY,
    EpisodeUnit,
    Outcome,
    chosen_memory,
    chosen_parts,
    configured,
    has_file,
    run_there,
    run_unit,
)
from gvla2.commands.bench_progress import BenchProgress
from gvla2.commands.bench_workers import in_processes, workers_for
from gvla2.errors import ConfigurationError, Gvla2Error
from gvla2.evaluation.robot.design import (
    CONTROLS,
    EXPLORATION,
    MEMORY_OF,
    NOT_MEASURED,
    PROFILES,
    SUITE,
    VERSION,
    check_seeds,
    layout_seed,
    ordered,
    stand_in,
)

if TYPE_CHECKING:
    from gvla2.evaluation.results import Cell, Results
    from gvla2.evaluation.robot.experience import Experience

DATA = "simulated"
MEASURING_CODE = (
    "gvla2.advice", "gvla2.attempts", "gvla2.checking", "gvla2.consulting", "gvla2.continuing", "gvla2.correspondence",
    "gvla2.diagnosis", "gvla2.episode", "gvla2.evaluation.robot", "gvla2.geometry", "gvla2.lessons", "gvla2.memory",
    "gvla2.planning", "gvla2.refine", "gvla2.robot", "gvla2.skills", "gvla2.telling",
)  # fmt: skip
"""Code whose change makes stored rows out of date, besides the plugins that were chosen."""
TOGETHER = 5
"""Episodes that a process runs before their rows are stored."""

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class _Planned:
    """An episode of the design: both its profiles' keys, and the factors that they have in common."""

    task: str
    arm: str
    layout: int
    keys: Mapping[str, str]
    factors: Mapping[str, str | int]


def run(config: BenchConfig, registry: Registry, results: Results, run_id: int, folder: Path) -> list[Cell]:
    """Run what the database lacks; all rows of the design, in its order.

    Episodes are stored a few at a time, so that an interrupted bench goes on where it stopped. Exploration is kept,
    too: every arm learns from the same episodes, of which the banks in ``folder/banks`` are made.
    """
    tasks = ordered(config.tasks)
    check_seeds(config.episodes, config.exploration_seeds)
    _check_names(config, registry, tasks)
    explored = _explored_tasks(config, tasks)
    around = _around(config, registry, sorted({*tasks, *explored}))
    plan = _design(config, registry, tasks, explored, around)
    exploring = _exploration(config, explored, around)
    wanted = [*plan, *exploring]
    known = _known(config, results, plan, SUITE) | _known(config, results, exploring, EXPLORATION)
    missing = [one for one in wanted if not known.keys() >= set(one.keys.values())]
    if len(missing) < len(wanted):
        log.info("%d of %d episodes are in %s already.", len(wanted) - len(missing), len(wanted), results.url)
    with BenchProgress(len(missing), config.quiet) as progress:

        def carry_out(planned: Sequence[_Planned], units: Sequence[EpisodeUnit], suite: str) -> None:
            by_place = {(one.task, one.arm, one.layout): one for one in planned}
            for unit, outcomes in _measure(units, registry, config.workers):
                cells = []
                for outcome in outcomes:
                    cells += _cells(by_place[unit.task, unit.arm, outcome.layout], outcome)
                results.add(run_id, suite, cells)
                known.update({cell.key: cell for cell in cells})
                progress.done(len(outcomes), f"{unit.task}, {unit.arm}")

        lacking = [one for one in exploring if one in missing]
        carry_out(lacking, _units(config, lacking), EXPLORATION)
        _require_measured(exploring, known)
        experiences = _experiences(exploring, known)
        lacking = [one for one in plan if one in missing]
        banks = _banks(config, registry, sorted({one.arm for one in lacking}), experiences, folder)
        carry_out(lacking, _units(config, lacking, experiences, banks, tasks), SUITE)
    cells = [known[key] for one in plan for key in one.keys.values()]
    shown = _filmed(config, registry, plan, cells, (experiences, banks, tasks), folder)
    results.add(run_id, SUITE, [new for old, new in zip(cells, shown, strict=True) if new is not old])
    return shown


def _check_names(config: BenchConfig, registry: Registry, tasks: Sequence[str]) -> None:
    for task in tasks:
        chosen_parts(config, registry, task)
    for arm in config.arms:
        if arm not in CONTROLS and arm not in MEMORY_OF and arm not in registry.components("memory"):
            there = ", ".join(dict.fromkeys([*CONTROLS, *MEMORY_OF, *registry.components("memory")]))
            raise ConfigurationError(f"No arm '{arm}'. Available: {there}.")
    for arm in config.arm_options:
        if arm not in config.arms or arm in ("off", "best_theta"):
            raise ConfigurationError(
                f"arm_options.{arm}: there is no arm '{arm}' with a memory among the arms."
            )


def _explored_tasks(config: BenchConfig, tasks: Sequence[str]) -> list[str]:
    """The tasks whose experience some arm needs."""
    if all(arm in ("off", "none") for arm in config.arms):
        return []
    others = [stand_in(task, tasks) for task in tasks] if "shuffled" in config.arms else []
    return list(dict.fromkeys([*tasks, *others]))


def _around(config: BenchConfig, registry: Registry, tasks: Sequence[str]) -> dict[str, Any]:
    """What all episodes of a task have in common and could change their outcome, by task."""
    from gvla2.evaluation.provenance import code_digest

    found = {}
    for task in tasks:
        root = chosen_parts(config, registry, task)
        typed = configured(registry, root, (*LOOP, *GEOMETRY))
        tries = (config.replan, config.max_parts)
        code = code_digest((*MEASURING_CODE, *sorted({type(one).__module__ for one in typed})))
        found[task] = (list(map(asdict, typed)), asdict(config.depth_noise), tries, code, VERSION)
    return found


def _design(
    config: BenchConfig,
    registry: Registry,
    tasks: Sequence[str],
    explored: Sequence[str],
    around: Mapping[str, Any],
) -> list[_Planned]:
    from gvla2.evaluation.results import cell_key

    learnt = (
        list(explored),
        config.exploration_seeds,
        config.exploration,
        [around[task] for task in explored],
    )
    memories = {arm: _memory_key(config, registry, arm) for arm in config.arms}
    common: dict[str, str | int] = {
        kind: getattr(config, kind).name for kind in ("robot", "perceiver", "planner", "verifier")
    }
    if config.fallback.name not in ("", "none"):
        common["planner"] = f"{config.planner.name}, then {config.fallback.name}"
    common |= {"depth_noise": config.depth_noise.kind, "scale": str(config.scale)}
    plan = []
    for task in tasks:
        for arm in dict.fromkeys(config.arms):
            past = () if arm in ("off", "none") else (learnt, memories[arm])
            for seed in dict.fromkeys(config.seeds):
                for episode in range(config.episodes):
                    layout = layout_seed(seed, episode)
                    place: dict[str, str | int] = {"task": task, "arm": arm, "seed": seed, "episode": episode}
                    keys = {p: cell_key(SUITE, place, p, around[task], past) for p in PROFILES}
                    plan.append(_Planned(task, arm, layout, keys, {**place, **common}))
    return plan


def _memory_key(config: BenchConfig, registry: Registry, arm: str) -> Any:
    if arm in CONTROLS and arm not in MEMORY_OF:
        return None
    root = chosen_memory(config, registry, arm, "")
    from gvla2.evaluation.provenance import code_digest

    typed = configured(registry, root, MEMORY)
    return [list(map(asdict, typed)), code_digest(tuple(sorted({type(one).__module__ for one in typed})))]


def _exploration(config: BenchConfig, tasks: Sequence[str], around: Mapping[str, Any]) -> list[_Planned]:
    from gvla2.evaluation.results import cell_key

    plan = []
    for task in tasks:
        for seed in dict.fromkeys(config.exploration_seeds):
            place: dict[str, str | int] = {"task": task, "arm": "exploration", "seed": seed}
            key = cell_key(EXPLORATION, place, around[task], config.exploration)
            plan.append(_Planned(task, "exploration", seed, {"both": key}, place))
    return plan


def _known(config: BenchConfig, results: Results, plan: Sequence[_Planned], suite: str) -> dict[str, Cell]:
    if config.results.fresh:
        return {}
    found = results.with_keys([key for one in plan for key in one.keys.values()])
    return {key: cell for key, cell in found.items() if cell.notes.get("status") == "ok"}


def _units(
    config: BenchConfig,
    planned: Sequence[_Planned],
    experiences: Mapping[str, Sequence[Experience]] | None = None,
    banks: Mapping[str, str] | None = None,
    tasks: Sequence[str] = (),
    film: str = "",
) -> list[EpisodeUnit]:
    """Some episodes of one task and arm each; a task's arms come one after the other, so that its parts are kept."""
    grouped: dict[tuple[str, str], list[int]] = defaultdict(list)
    for one in planned:
        grouped[one.task, one.arm].append(one.layout)
    units = []
    for (task, arm), layouts in grouped.items():
        learnt, asked = experiences or {}, None
        if arm == "shuffled":
            asked = next((e.episode.task for e in learnt.get(stand_in(task, tasks), ())), None)
        own = learnt.get(task, ()) if arm == "best_theta" else [e for one in learnt.values() for e in one]
        for start in range(0, len(layouts), TOGETHER):
            some = tuple(layouts[start : start + TOGETHER])
            bank = (banks or {}).get(arm, "")
            units.append(EpisodeUnit(config, task, arm, some, bank, tuple(own), asked, film))
    return units


def _measure(
    units: Sequence[EpisodeUnit], registry: Registry, asked: int
) -> Iterator[tuple[EpisodeUnit, list[Outcome]]]:
    workers = workers_for(asked, len(units))
    if workers == 1:
        for unit in units:
            yield unit, run_unit(unit, registry)
    else:
        yield from in_processes(run_there, units, workers, tries=3)


def _cells(planned: _Planned, outcome: Outcome) -> list[Cell]:
    from gvla2.evaluation.results import Cell

    measured = outcome.failure not in NOT_MEASURED
    status = "ok" if measured else f"not measured: {outcome.failure}"
    notes: dict[str, Any] = {"status": status, "layout": outcome.layout, **outcome.notes}
    if outcome.experience:
        notes["experience"] = [one.to_json() for one in outcome.experience]
    cells = []
    for profile, key in planned.keys.items():
        done = outcome.succeeded.get(profile, outcome.succeeded["eased"])
        failure = "" if done else outcome.failure or "not_strictly"
        told = {"failure": failure, "message": "" if done else outcome.message}
        factors = dict(planned.factors) | ({} if profile == "both" else {"profile": profile})
        measures = {"success": done if measured else None, "seconds": outcome.seconds}
        cells.append(Cell(key, factors, measures, {**notes, **told}))
    return cells


def _require_measured(exploring: Sequence[_Planned], known: Mapping[str, Cell]) -> None:
    """Raises :class:`Gvla2Error` where exploration has gaps: arms that learnt less would pass for full ones."""
    gaps = [one for one in exploring if known[one.keys["both"]].notes.get("status") != "ok"]
    if gaps:
        tasks = ", ".join(dict.fromkeys(one.task for one in gaps))
        raise Gvla2Error(
            f"{len(gaps)} of {len(exploring)} explored episodes could not be measured ({tasks}): no answer in time, or "
            "no language model. What was measured is kept; run again, or with a longer planner_timeout=SECONDS."
        )


def _experiences(plan: Sequence[_Planned], known: Mapping[str, Cell]) -> dict[str, list[Experience]]:
    """What each task's exploration brought, in the order of its seeds."""
    from gvla2.evaluation.robot.experience import Experience

    found: dict[str, list[Experience]] = {}
    for one in plan:
        told = known[one.keys["both"]].notes.get("experience") or ()
        found.setdefault(one.task, []).extend(map(Experience.from_json, told))
    return found


def _banks(
    config: BenchConfig,
    registry: Registry,
    arms: Sequence[str],
    experiences: Mapping[str, Sequence[Experience]],
    folder: Path,
) -> dict[str, str]:
    """Teach each memory that keeps a file, once; the files by arm."""
    from gvla2.evaluation.robot.experience import teach
    from gvla2.record.files import make_folder

    banks = {}
    for arm in arms:
        if arm in ("off", "none", "best_theta") or not has_file(registry, arm):
            continue
        path = make_folder(folder / "banks").absolute() / f"{arm}.db"
        root = chosen_memory(config, registry, arm, str(path))
        with closing(registry.build(root, "memory")) as memory:
            teach(memory, (one for learnt in experiences.values() for one in learnt))
        banks[arm] = str(path)
    return banks


def _filmed(
    config: BenchConfig,
    registry: Registry,
    plan: Sequence[_Planned],
    cells: Sequence[Cell],
    learnt: tuple[Mapping[str, Sequence[Experience]], Mapping[str, str], Sequence[str]],
    folder: Path,
) -> list[Cell]:
    """The cells, some failed ones with the folder of their film: the episode run once more, which is the same."""
    by_key = {cell.key: cell for cell in cells}
    taken: dict[tuple[str, str], int] = defaultdict(int)
    chosen = []
    for one in plan:
        cell = by_key[one.keys["eased"]]
        old = str(cell.notes.get("film", ""))
        failed = cell.measures["success"] is not None and not cell.measures["success"]
        if not failed or taken[one.task, one.arm] >= config.videos:
            continue
        taken[one.task, one.arm] += 1
        if not old or not Path(old).is_dir():
            chosen.append(one)
    experiences, banks, tasks = learnt
    arms = sorted({one.arm for one in chosen} - set(banks))
    banks = {**banks, **_banks(config, registry, arms, experiences, folder)}
    for one in chosen:
        place = (folder / "failures" / f"{one.task}-{one.arm}").absolute()
        (unit,) = _units(config, [one], experiences, banks, tasks, str(place))
        log.info("Filming %s, %s, layout %d.", one.task, one.arm, one.layout)
        (outcome,) = run_unit(unit, registry)
        cell = by_key[one.keys["eased"]]
        same = outcome.succeeded["eased"] == cell.measures["success"]
        notes = {"film": str(place / str(one.layout)), "film_agrees": same}
        by_key[cell.key] = replace(cell, notes={**cell.notes, **notes})
    return list(by_key.values())
