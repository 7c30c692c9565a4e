"""``gvla2 bench suite=perception``: perceivers alone, against what a simulator's pixels truly show."""

from __future__ import annotations

import logging
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, fields, replace
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gvla2.catalog import Registry, load_plugins
from gvla2.commands.bench_config import BenchConfig
from gvla2.commands.bench_progress import BenchProgress
from gvla2.commands.bench_subjects import task_options
from gvla2.commands.bench_workers import in_processes, workers_for
from gvla2.errors import ConfigurationError, Gvla2Error

if TYPE_CHECKING:
    from gvla2.evaluation.perception.suite import Bench, Measured, Wanted
    from gvla2.evaluation.results import Cell, Results

DATA = "simulated"
MEASURING_CODE = (
    "gvla2.evaluation.perception", "gvla2.geometry", "gvla2.robot", "gvla2.planning.scene", "gvla2.planning.colours",
)  # fmt: skip
"""Code whose change makes stored rows out of date, besides the plugins that were chosen."""

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Unit:
    """What one process does in one go: some layouts of a task, seen by one perceiver."""

    task: str
    perceiver: str
    wanted: tuple[Wanted, ...]
    config: BenchConfig


def run(config: BenchConfig, registry: Registry, results: Results, run_id: int, folder: Path) -> list[Cell]:
    """Measure what the database lacks; all rows of the design, a layout's own before those of its things.

    Every layout is stored at once, so that an interrupted bench goes on where it stopped. Pictures go to
    ``folder/pictures``.
    """
    from gvla2.evaluation.perception.suite import SUITE, with_picture
    from gvla2.record.files import write_bytes

    units = list(_design(config, registry))
    keys = [want.key for unit in units for want in unit.wanted]
    known = {} if config.results.fresh else _known(results, keys)
    missing = [replace(unit, wanted=tuple(w for w in unit.wanted if w.key not in known)) for unit in units]
    missing = [replace(unit, wanted=(want,)) for unit in missing for want in unit.wanted]
    if known:
        log.info("%d of %d layouts are in %s already.", len(known), len(keys), results.url)
    with BenchProgress(len(missing), config.quiet) as progress:
        for unit, measured in _measure(missing, registry, config.workers):
            cells = measured.cells
            if measured.picture is not None:
                name = f"{unit.task}-{unit.perceiver}-{config.depth_noise.kind}.png"
                path = write_bytes(folder / "pictures" / name, measured.picture)
                cells = with_picture(cells, str(path.absolute()))
            results.add(run_id, SUITE, cells)
            known[unit.wanted[0].key] = list(cells)
            progress.done(1, f"{unit.task}, {unit.perceiver}")
    return [cell for key in keys for cell in known[key]]


def _known(results: Results, keys: Sequence[str]) -> dict[str, list[Cell]]:
    """The rows of the layouts that were measured well, by the key of the layout's row."""
    scenes = {key: cell for key, cell in results.with_keys(keys).items() if cell.notes.get("status") == "ok"}
    names = [name for cell in scenes.values() for name in cell.notes["objects"]]
    things = results.with_keys(names)
    return {
        key: [cell, *(things[name] for name in cell.notes["objects"])]
        for key, cell in scenes.items()
        if all(name in things for name in cell.notes["objects"])
    }


def chosen_tasks(config: BenchConfig, registry: Registry) -> list[str]:
    """The tasks by name, each once; by default all that need no option. Raises for one that is not there."""
    for name in config.tasks:
        registry.get("task", name)
    tasks = registry.components("task").items()
    whole = [name for name, task in tasks if name != "none" and not task.config.required]
    return list(dict.fromkeys(config.tasks or whole))


def chosen_parts(config: BenchConfig, registry: Registry, task: str, perceiver: str) -> dict[str, Any]:
    """What to build for a task and a perceiver: the configured perceiver keeps its options.

    Raises :class:`ConfigurationError` when ``scale`` is asked of a task that has none.
    """
    options: dict[str, Any] = {"name": task, **task_options(config, registry, task)}
    scalable = "scale" in {field.name for field in fields(registry.get("task", task).config)}
    if scalable:
        options["scale"] = config.scale
    elif config.scale != 1.0:
        raise ConfigurationError(f"scale is {config.scale}, but task={task} has no option scale.")
    configured = config.perceiver.name == perceiver
    parts = {
        "robot": config.robot,
        "camera": config.camera,
        "task": options,
        "perceiver": config.perceiver if configured else {"name": perceiver},
    }
    return {**parts, "planner": config.planner} if config.planner.name else parts


def _design(config: BenchConfig, registry: Registry) -> Iterator[Unit]:
    """Every layout with its key, one unit a task and perceiver."""
    from gvla2.evaluation.perception.suite import SUITE, VERSION, Wanted, layout_seed
    from gvla2.evaluation.provenance import code_digest, versions
    from gvla2.evaluation.results import cell_key

    for task in chosen_tasks(config, registry):
        for perceiver in dict.fromkeys(config.perceivers):
            root = chosen_parts(config, registry, task, perceiver)
            kinds = [kind for kind in ("robot", "task", "perceiver", "planner") if kind in root]
            typed = [registry.configure(root, kind)[0] for kind in kinds]
            code = code_digest((*MEASURING_CODE, *sorted({type(one).__module__ for one in typed})))
            protocol = (VERSION, code, versions(), asdict(config.depth_noise), [asdict(one) for one in typed])
            wanted = []
            for seed in dict.fromkeys(config.seeds):
                for episode in range(config.episodes):
                    factors: dict[str, str | int] = {
                        "task": task,
                        "perceiver": perceiver,
                        "depth_noise": config.depth_noise.kind,
                        "scale": f"{config.scale:g}",
                        "robot": config.robot.name,
                        "seed": seed,
                        "episode": episode,
                    }
                    key = cell_key(SUITE, factors, protocol)
                    first = seed == config.seeds[0] and episode == 0
                    wanted.append(Wanted(key, factors, layout_seed(seed, episode), pictured=first))
            yield Unit(task, perceiver, tuple(wanted), config)


def _measure(units: Sequence[Unit], registry: Registry, asked: int) -> Iterator[tuple[Unit, Measured]]:
    workers = workers_for(asked, len(units))
    if workers > 1:
        yield from in_processes(measure_there, units, workers)
        return
    built = _Built()
    try:
        for unit in units:
            yield unit, _measure_unit(unit, registry, built)
    finally:
        built.close()


def measure_there(unit: Unit) -> Measured:
    """Measure the unit's one layout in a worker process, which finds the plugins itself.

    Errors travel back as their message alone: exceptions with constructors of their own do not survive pickling.
    """
    try:
        return _measure_unit(unit, _registry(), _built())
    except ConfigurationError as error:
        raise ConfigurationError(str(error)) from None
    except Gvla2Error as error:
        raise Gvla2Error(str(error)) from None


def _measure_unit(unit: Unit, registry: Registry, built: _Built) -> Measured:
    from gvla2.evaluation.perception.suite import measure

    (wanted,) = unit.wanted
    return measure(wanted, built.bench(unit, registry))


class _Built:
    """The components of the latest unit: what its task has no part in is kept for other tasks of the same perceiver."""

    def __init__(self) -> None:
        self._parts: dict[str, Any] = {}
        self._perceiver = ""
        self._task: tuple[str, Any] = ("", None)

    def bench(self, unit: Unit, registry: Registry) -> Bench:
        """The components for a unit."""
        from gvla2.evaluation.perception.suite import Bench

        root = chosen_parts(unit.config, registry, unit.task, unit.perceiver)
        if not self._parts or self._perceiver != unit.perceiver:
            self.close()
            self._parts = registry.build_all(
                root, [k for k in ("robot", "perceiver", "planner") if k in root]
            )
            self._perceiver = unit.perceiver
        if self._task[0] != unit.task:
            self._task = unit.task, registry.build(root, "task")
        parts, noise = self._parts, unit.config.depth_noise
        return Bench(parts["robot"], self._task[1], parts["perceiver"], parts.get("planner"), noise)

    def close(self) -> None:
        """Let go of the robot; safe to call twice."""
        if self._parts:
            self._parts["robot"].close()
        self._parts = {}


@cache
def _registry() -> Registry:
    return load_plugins()


@cache
def _built() -> _Built:
    """The one of this worker process."""
    return _Built()
