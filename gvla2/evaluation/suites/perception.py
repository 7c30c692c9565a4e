"""The suite ``perception``: perceivers alone, against a simulator's true pixels.

A layout is laid out and seen; the perceived scene is compared with what each pixel shows. A layout has a row of its
own and one for each true object in it.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from itertools import product
from statistics import fmean, median
from typing import Any

import numpy as np

from gvla2.component import described
from gvla2.errors import ConfigurationError, Gvla2Error, PerceptionError
from gvla2.evaluation.components import code_of, given_label, noise_label, task_options
from gvla2.evaluation.config import PerceptionBench
from gvla2.evaluation.engine import Rows, Suite, Unit
from gvla2.evaluation.perception_scoring import ObjectScore, score
from gvla2.evaluation.perception_truth import Segmented, true_objects
from gvla2.evaluation.results import Cell, cell_key, grouped, latest, measured, versions
from gvla2.evaluation.tables import Sheet, SheetCell, SheetRow, runs_of, text_cell
from gvla2.planning.asking import perceive
from gvla2.planning.scene import Scene
from gvla2.plugins.registry import Registry
from gvla2.robot.depth_noise import apply_noise

VERSION = 3
"""Version of the measurement: rows of another version are measured again."""
WHOLE = 0.8
"""Overlap above which an object without a second piece counts as seen whole."""
SCENE = "scene"
"""The ``object`` and ``kind`` of a whole layout's row."""
MEASURING_CODE = (
    "gvla2.evaluation.perception_scoring",
    "gvla2.evaluation.perception_truth",
    "gvla2.evaluation.suites.perception",
    "gvla2.geometry",
    "gvla2.perception",
    "gvla2.robot",
    "gvla2.planning.scene",
    "gvla2.planning.colours",
)
"""Code whose change outdates stored rows, besides the chosen plugins."""
GROUPS = ("robot", "perceiver", "depth_noise", "scale")
EXPLANATION = (
    "Objects that the true pixels show, against the perceived ones. Mask IoU is over all views together, and an "
    "object is found above 0.5, seen whole from 0.8 where no second object is a piece of it. Label, colour, centre "
    "and extent are of found objects: a label is right when its colour words and its head noun are the true ones "
    "(a synonym is wrong), an extent's error is that of the worst visible side. The first line is the median (a "
    "share, if in per cent), the second the 95th percentile, p95: one in twenty is worse. False objects match no "
    "true one, or are a second piece of one."
)

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class LayoutUnit(Unit):
    """One layout of a task, seen by one perceiver."""

    task: str
    perceiver: str
    factors: Mapping[str, str | int]
    layout: int
    config: PerceptionBench


class PerceptionSuite(Suite[PerceptionBench, LayoutUnit]):
    """Every layout of each task and perceiver."""

    name = "perception"
    title = "Perception"

    def stages(self) -> Sequence[Sequence[LayoutUnit]]:
        """Every layout with its key, those of a task and perceiver together."""
        config, registry, units = self.config, self.registry, []
        tasks = chosen_tasks(config, registry)
        for task, perceiver in product(tasks, dict.fromkeys(config.perceivers)):
            root = chosen_components(config, registry, task, perceiver)
            typed = [registry.configure(root, kind)[0] for kind in ("robot", "task", "perceiver")]
            code = code_of(typed, *MEASURING_CODE)
            protocol = (VERSION, code, versions(), asdict(config.depth_noise), [asdict(one) for one in typed])
            own = config.perceiver.name == perceiver
            for seed, episode in product(dict.fromkeys(config.seeds), range(config.episodes)):
                factors: dict[str, str | int] = {
                    "task": given_label(task, config.task_options),
                    "perceiver": described(config.perceiver) if own else perceiver,
                    "depth_noise": noise_label(config.depth_noise),
                    "scale": f"{config.scale:g}",
                    "robot": described(config.robot),
                    "seed": seed,
                    "episode": episode,
                }
                key = cell_key(self.name, factors, protocol)
                layout, label = layout_seed(seed, episode), f"{task}, {perceiver}"
                units.append(LayoutUnit((key,), label, task, perceiver, factors, layout, config))
        return [units]

    def known(self, units: Sequence[LayoutUnit]) -> Rows:
        """The known rows of layouts and their objects; without incomplete layouts."""
        scenes = super().known(units)
        keys = [key for cell in scenes.values() for key in cell.notes["objects"]]
        objects = self.bench.results.with_keys(keys)
        whole = {key: cell for key, cell in scenes.items() if objects.keys() >= set(cell.notes["objects"])}
        return {**objects, **whole}

    @staticmethod
    def measure(unit: LayoutUnit, registry: Registry) -> list[Cell]:
        """The rows of one layout, the scene's last: a layout whose objects are not all stored is measured again."""
        scene, objects = measure_layout(unit, _built(unit, registry))
        return [*objects, scene]

    def result(self, units: Sequence[LayoutUnit], rows: Rows) -> list[Cell]:
        """A layout's own row before those of its objects."""
        scenes = super().result(units, rows)
        return [cell for one in scenes for cell in (one, *(rows[key] for key in one.notes["objects"]))]

    def close(self) -> None:
        """Release the robot of this process."""
        _release()

    @staticmethod
    def sheets(cells: Sequence[Cell]) -> list[Sheet]:
        """Two tables per group, by task and by kind; if equal cells were measured twice, the later counts."""
        once = latest(cells, lambda cell: cell.texts(*GROUPS, "task", "seed", "episode", "object"))
        sheets = []
        for group, placed in grouped(once, *GROUPS).items():
            kept = _without_stale(placed)
            shared = ", ".join(f"{name} {value}" for name, value in zip(GROUPS, group, strict=True))
            sheets += [_sheet(kept, f"Perception: {shared}, by {by}", by) for by in ("task", "kind")]
        return sheets


def layout_seed(seed: int, episode: int) -> int:
    """The seed of a layout: a seed's first layout is that of ``gvla2 run seed=...``; no two seeds share any."""
    return seed + 1_000_000 * episode


def chosen_tasks(config: PerceptionBench, registry: Registry) -> list[str]:
    """The tasks by name, each once; by default all that need no option. Raises for an unknown one."""
    for name in config.tasks:
        registry.get("task", name)
    tasks = registry.components("task").items()
    whole = [name for name, task in tasks if name != "none" and not task.config.required]
    return list(dict.fromkeys(config.tasks or whole))


def chosen_components(
    config: PerceptionBench, registry: Registry, task: str, perceiver: str
) -> dict[str, Any]:
    """What to build for a task and a perceiver: the configured perceiver keeps its options.

    Raises :class:`ConfigurationError` for an option that the task does not have.
    """
    return {
        "robot": config.robot,
        "camera": config.camera,
        "language": config.language,
        "task": {"name": task, **task_options(config, registry, task)},
        "perceiver": config.perceiver if config.perceiver.name == perceiver else {"name": perceiver},
    }


_kept: dict[str, dict[str, Any]] = {}
"""The components that this process used last, by perceiver, with tasks by name: building a robot takes a second."""


def _built(unit: LayoutUnit, registry: Registry) -> dict[str, Any]:
    """The robot, the perceiver and the task of a unit, those of the previous unit where they are the same."""
    root = chosen_components(unit.config, registry, unit.task, unit.perceiver)
    if unit.perceiver not in _kept:
        _release()
        _kept[unit.perceiver] = registry.build_all(root, ("robot", "perceiver"))
    parts, task = _kept[unit.perceiver], f"task {unit.task}"
    if task not in parts:
        parts[task] = registry.build(root, "task")
    return {**parts, "task": parts[task]}


def _release() -> None:
    for parts in _kept.values():
        parts["robot"].close()
    _kept.clear()


def measure_layout(unit: LayoutUnit, parts: Mapping[str, Any]) -> tuple[Cell, list[Cell]]:
    """The row of a layout and those of its objects; a layout that cannot be measured is a row that says why.

    Raises :class:`ConfigurationError` for a robot without ground truth.
    """
    if not isinstance(parts["robot"], Segmented):
        raise ConfigurationError(
            "suite=perception needs a simulated robot that knows what each pixel shows, such as robot=sapien_panda."
        )
    try:
        return _measure(unit, parts, parts["robot"])
    except ConfigurationError:
        raise
    except Exception as error:  # a perceiver's crash is its layout's, not the bench's
        log.info("A layout could not be measured.", exc_info=True)
        why = str(error) if isinstance(error, Gvla2Error) else f"crashed, {type(error).__name__}: {error}"
        return _scene_row(unit, {}, {"status": f"failed: {why}", "objects": []}), []


def _measure(unit: LayoutUnit, parts: Mapping[str, Any], truth: Segmented) -> tuple[Cell, list[Cell]]:
    robot = parts["robot"]
    instance = robot.reset(parts["task"], unit.layout)
    if instance is None:
        raise ConfigurationError("suite=perception needs a simulated robot, which lays out tasks.")
    clear = robot.observe()  # the truth is what ideal cameras would show
    noise = np.random.default_rng([unit.layout, 0])  # that of an episode of this seed
    observation = apply_noise(clear, unit.config.depth_noise, noise, unit.layout)
    truths = true_objects(truth, clear, instance.layout)
    started, worked = time.perf_counter(), time.process_time()
    try:
        workspace = robot.arm.workspace
        scene = perceive(parts["perceiver"], observation, instance.instruction, workspace, "The perceiver")
        note = ""
    except PerceptionError as error:
        scene, note = Scene((), 0.0, robot.arm.workspace), f"Nothing was perceived: {error}"
    seconds, cpu_seconds = time.perf_counter() - started, time.process_time() - worked
    found = score(truths, scene, clear)
    split = {stray.piece_of for stray in found.strays}
    rows = [_object_row(unit, one, one.true.name in split) for one in found.truths]
    pieces = [
        f"a piece of {stray.piece_of}" if stray.piece_of else "nothing that exists" for stray in found.strays
    ]
    labels = [scene.objects[stray.index].label for stray in found.strays]
    measures = {
        "found": found.found,
        "false": float(len(found.strays)),
        "seconds": seconds,
        "cpu_seconds": cpu_seconds,
    }
    notes = {
        "status": "ok",
        "instruction": instance.instruction,
        "objects": [row.key for row in rows],
        "strays": [f"{label}: {what}" for label, what in zip(labels, pieces, strict=True)],
        "note": note,
    }
    return _scene_row(unit, measures, notes), rows


def _scene_row(unit: LayoutUnit, measures: Mapping[str, float | None], notes: Mapping[str, Any]) -> Cell:
    return Cell(unit.keys[0], {**unit.factors, "object": SCENE, "kind": SCENE}, measures, notes)


def _object_row(unit: LayoutUnit, one: ObjectScore, split: bool) -> Cell:
    true = one.true
    measures: dict[str, float | None] = {
        "found": float(one.match.found),
        "iou": one.match.iou,
        "whole": float(one.match.iou >= WHOLE and not split),
        **{name: None if judged is None else float(judged) for name, judged in vars(one.words).items()},
        "centre_mm": one.centre_mm,
        "extent_mm": one.extent_mm,
        "pixels": float(true.whole.sum()),
        **{f"extent_{axis}_mm": error for axis, error in zip("xyz", one.extents_mm, strict=True)},
    }  # fmt: skip
    factors = {**unit.factors, "object": true.name, "kind": true.kind}
    notes = {"status": "ok", "true": true.label, "perceived": one.perceived, "part": true.part}
    return Cell(cell_key(PerceptionSuite.name, unit.keys[0], true.name), factors, measures, notes)


def _share(values: Sequence[float]) -> tuple[str, ...]:
    return f"{100 * fmean(values):.0f} %", f"{sum(values):.0f} of {len(values)}"


def _mean(values: Sequence[float]) -> tuple[str, ...]:
    return (f"{fmean(values):.2f}",)


def _spread(digits: int, worst: float = 95) -> Callable[[Sequence[float]], tuple[str, ...]]:
    def lines(values: Sequence[float]) -> tuple[str, ...]:
        return f"{median(values):.{digits}f}", f"p95 {np.percentile(values, worst):.{digits}f}"

    return lines


_OF_OBJECTS = {
    "found ↑": ("found", _share),
    "whole ↑": ("whole", _share),
    "mask IoU ↑": ("iou", _spread(2, worst=5)),
    "label ↑": ("label", _share),
    "colour ↑": ("colour", _share),
    "centre mm ↓": ("centre_mm", _spread(1)),
    "extent mm ↓": ("extent_mm", _spread(1)),
}
"""Columns by heading: the measure of an object's row, and how to summarise its values."""
_OF_SCENES = {"false a scene ↓": ("false", _mean), "seconds ↓": ("seconds", _spread(2))}


def _is_scene(cell: Cell) -> bool:
    return cell.factors.get("object") == SCENE


def _without_stale(cells: Sequence[Cell]) -> list[Cell]:
    """The cells whose layout was last measured together with them: an older run's objects may have other names."""
    current = {key for cell in cells if _is_scene(cell) for key in (cell.key, *cell.notes.get("objects", []))}
    return [cell for cell in cells if cell.key in current]


def _sheet(cells: Sequence[Cell], title: str, by: str) -> Sheet:
    """One row per task or kind of object, and one for all."""
    scenes = by == "task"
    groups = grouped([cell for cell in cells if scenes or not _is_scene(cell)], by)
    rows = []
    for (name,), some in sorted(groups.items()):
        failed = sum(cell.status != "ok" for cell in some)
        rows.append(SheetRow(f"{name} ({failed} failed)" if failed else name, _row(some, scenes)))
    if len(rows) > 1:
        rows.append(SheetRow("all", _row(cells, scenes)))
    headings = ("objects", *_OF_OBJECTS, *(_OF_SCENES if scenes else ()), "missed most")
    counts = f"{sum(map(_is_scene, cells))} layouts"
    return Sheet(title, headings, tuple(rows), counts, runs_of(cells), EXPLANATION)


def _row(cells: Sequence[Cell], with_scenes: bool) -> tuple[SheetCell, ...]:
    scenes = [cell for cell in cells if _is_scene(cell)]
    objects = [cell for cell in cells if not _is_scene(cell)]
    columns = [(objects, *column) for column in _OF_OBJECTS.values()]
    columns += [(scenes, *column) for column in _OF_SCENES.values()] if with_scenes else []
    found = [(measured(some, name), lines) for some, name, lines in columns]
    numbers = [SheetCell(lines(values)) if values else SheetCell(("",), none=True) for values, lines in found]
    return (text_cell(f"{len(objects):,}"), *numbers, text_cell(_missed(objects)))


def _missed(objects: Sequence[Cell]) -> str:
    """The kind that is missed most often, and how many of how many."""
    kinds = grouped(objects, "kind")
    missed = {
        kind: sum(not cell.measures.get("found") for cell in some) for (kind,), some in sorted(kinds.items())
    }
    kind = max(missed, key=missed.__getitem__, default="")
    return f"{kind}: {missed[kind]} of {len(kinds[kind,])}" if kind and missed[kind] else ""
