"""``gvla2 bench suite=perception``: perceivers alone, against a simulator's ground-truth pixels."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gvla2.commands.bench_config import BenchConfig
from gvla2.commands.bench_frame import BenchRun, code_of, noise_label, pictured
from gvla2.commands.bench_subjects import task_label, task_options
from gvla2.component import described
from gvla2.plugins.registry import Registry

if TYPE_CHECKING:
    from gvla2.evaluation.perception.suite import WantedLayout
    from gvla2.evaluation.results import Cell

DATA = "simulated"
MEASURING_CODE = (
    "gvla2.evaluation.perception", "gvla2.geometry", "gvla2.perception", "gvla2.robot", "gvla2.planning.scene",
    "gvla2.planning.colours",
)  # fmt: skip
"""Code whose change outdates stored rows, besides the chosen plugins."""


@dataclass(frozen=True)
class LayoutUnit:
    """One process's unit of work: one layout of a task, seen by one perceiver."""

    task: str
    perceiver: str
    wanted: WantedLayout
    config: BenchConfig
    folder: Path

    @property
    def rows(self) -> Sequence[str]:
        """The key of the layout's own row."""
        return (self.wanted.key,)

    @property
    def label(self) -> str:
        """The task and the perceiver."""
        return f"{self.task}, {self.perceiver}"


def run(bench: BenchRun) -> list[Cell]:
    """Measure what the database lacks; all rows of the design, a layout's own before those of its things.

    Pictures go to ``folder/pictures``.
    """
    units = list(_design(bench))
    try:
        with bench.rows(units, _whole(bench, units)) as rows:
            rows.fill(units, measure_unit)
            scenes = rows.of(units)
            return [cell for one in scenes for cell in (one, *(rows.known[k] for k in one.notes["objects"]))]
    finally:
        _let_go()


def _whole(bench: BenchRun, units: Sequence[LayoutUnit]) -> dict[str, Cell]:
    """The known rows of layouts and their things, by key; without incomplete layouts."""
    scenes = bench.known([unit.wanted.key for unit in units])
    things = bench.results.with_keys([key for cell in scenes.values() for key in cell.notes["objects"]])
    whole = {key: cell for key, cell in scenes.items() if things.keys() >= set(cell.notes["objects"])}
    return {**things, **whole}


def chosen_tasks(config: BenchConfig, registry: Registry) -> list[str]:
    """The tasks by name, each once; by default all that need no option. Raises for an unknown one."""
    for name in config.tasks:
        registry.get("task", name)
    tasks = registry.components("task").items()
    whole = [name for name, task in tasks if name != "none" and not task.config.required]
    return list(dict.fromkeys(config.tasks or whole))


def chosen_parts(config: BenchConfig, registry: Registry, task: str, perceiver: str) -> dict[str, Any]:
    """What to build for a task and a perceiver: the configured perceiver keeps its options.

    Raises :class:`ConfigurationError` for an option that the task does not have.
    """
    parts = {
        "robot": config.robot,
        "camera": config.camera,
        "task": {"name": task, **task_options(config, registry, task)},
        "perceiver": config.perceiver if config.perceiver.name == perceiver else {"name": perceiver},
    }
    return {**parts, "planner": config.planner} if config.planner.name else parts


def _design(bench: BenchRun) -> Iterator[LayoutUnit]:
    """Every layout with its key, those of a task and perceiver together."""
    from gvla2.evaluation.perception.suite import SUITE, VERSION, WantedLayout, layout_seed
    from gvla2.evaluation.provenance import versions
    from gvla2.evaluation.results import cell_key

    config, registry = bench.config, bench.registry
    for task, perceiver in product(chosen_tasks(config, registry), dict.fromkeys(config.perceivers)):
        root = chosen_parts(config, registry, task, perceiver)
        kinds = [kind for kind in ("robot", "task", "perceiver", "planner") if kind in root]
        typed = [registry.configure(root, kind)[0] for kind in kinds]
        code = code_of(typed, *MEASURING_CODE)
        protocol = (VERSION, code, versions(), asdict(config.depth_noise), [asdict(one) for one in typed])
        for seed, episode in product(dict.fromkeys(config.seeds), range(config.episodes)):
            factors: dict[str, str | int] = {
                "task": task_label(config, task),
                "perceiver": described(config.perceiver) if config.perceiver.name == perceiver else perceiver,
                "depth_noise": noise_label(config.depth_noise),
                "scale": f"{config.scale:g}",
                "robot": described(config.robot),
                "seed": seed,
                "episode": episode,
            }
            first = seed == config.seeds[0] and episode == 0
            key = cell_key(SUITE, factors, protocol)
            wanted = WantedLayout(key, factors, layout_seed(seed, episode), pictured=first)
            yield LayoutUnit(task, perceiver, wanted, config, bench.folder)


_kept: dict[str, dict[str, Any]] = {}
"""The components that this process used last, by perceiver, with tasks by name: building a robot takes a second."""


def measure_unit(unit: LayoutUnit, registry: Registry) -> list[Cell]:
    """The rows of one layout, the first with its picture."""
    from gvla2.evaluation.perception.suite import Bench, measure

    root = chosen_parts(unit.config, registry, unit.task, unit.perceiver)
    if unit.perceiver not in _kept:
        _let_go()
        kinds = [kind for kind in ("robot", "perceiver", "planner") if kind in root]
        _kept[unit.perceiver] = registry.build_all(root, kinds)
    parts, task, noise = _kept[unit.perceiver], f"task {unit.task}", unit.config.depth_noise
    if task not in parts:
        parts[task] = registry.build(root, "task")
    bench = Bench(parts["robot"], parts[task], parts["perceiver"], parts.get("planner"), noise)
    measured = measure(unit.wanted, bench)
    scene, *things = measured.cells
    name = f"{unit.task}-{unit.perceiver}-{noise.kind}"
    return [pictured(scene, measured.picture, unit.folder, name), *things]


def _let_go() -> None:
    for parts in _kept.values():
        parts["robot"].close()
    _kept.clear()
