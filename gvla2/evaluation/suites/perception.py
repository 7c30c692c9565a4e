"""The suite ``perception``: a perceiver alone, against a simulator's true pixels.

A layout is laid out and seen; the perceived scene is compared with what each pixel shows. A layout is one row, whose
notes hold the numbers of each true object in it.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from statistics import fmean, median
from typing import Any

import numpy as np

from gvla2.component import described
from gvla2.errors import ConfigurationError, Gvla2Error, PerceptionError
from gvla2.evaluation.components import code_of, given_label, named_tasks, noise_label, task_options
from gvla2.evaluation.config import PerceptionBench
from gvla2.evaluation.engine import Suite, Unit
from gvla2.evaluation.perception_scoring import Segmented, score, true_objects
from gvla2.evaluation.results import Cell, Run, cell_key, grouped, latest, measured, versions
from gvla2.evaluation.tables import Sheet, SheetCell, SheetRow, runs_of, text_cell
from gvla2.planning.asking import perceive
from gvla2.planning.scene import Scene
from gvla2.plugins.kinds import NONE
from gvla2.plugins.registry import Registry
from gvla2.robot.depth_noise import apply_noise

VERSION = 5
"""Version of the measurement: rows of another version are measured again."""
MEASURING_CODE = (
    "gvla2.evaluation.perception_scoring", "gvla2.evaluation.suites.perception", "gvla2.geometry", "gvla2.perception",
    "gvla2.robot", "gvla2.planning.scene", "gvla2.planning.colours",
)  # fmt: skip
"""Code whose change outdates stored rows, besides the chosen plugins."""
GROUPS = ("robot", "perceiver", "depth_noise", "scale")
EXPLANATION = (
    "Objects that the true pixels show, against the perceived ones with the nearest centres; an object is found where "
    "one of the two centres lies in the other's box, or within 10 mm of it. A name is right when its colour words and "
    "its head noun are the true ones (a synonym is wrong). Centre and worst side are of objects of which no side is "
    "hidden. The first line is the median (a share, if in per cent), the second the 95th percentile, p95: one in "
    "twenty is worse. A false object's centre lies in no true one."
)

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class LayoutUnit(Unit):
    """One layout of a task."""

    task: str
    factors: Mapping[str, str | int]
    layout: int
    config: PerceptionBench


class PerceptionSuite(Suite[PerceptionBench, LayoutUnit]):
    """Every layout of each task."""

    name = "perception"
    title = "Perception"

    def stages(self) -> Sequence[Sequence[LayoutUnit]]:
        """Every layout with its key, those of a task together."""
        config, registry, units = self.config, self.registry, []
        for task in chosen_tasks(config, registry):
            root = chosen_components(config, registry, task)
            typed = [registry.configure(root, kind)[0] for kind in ("robot", "task", "perceiver")]
            code = code_of(typed, *MEASURING_CODE)
            protocol = (VERSION, code, versions(), asdict(config.depth_noise), [asdict(one) for one in typed])
            for seed in dict.fromkeys(config.seeds):
                for episode in range(config.episodes):
                    factors: dict[str, str | int] = {
                        "task": given_label(task, config.task_options),
                        "perceiver": described(config.perceiver),
                        "depth_noise": noise_label(config.depth_noise),
                        "scale": f"{config.scale:g}",
                        "robot": described(config.robot),
                        "seed": seed,
                        "episode": episode,
                    }
                    # A seed's first layout is that of `gvla2 run seed=...`; no two seeds share any.
                    layout, key = seed + 1_000_000 * episode, cell_key(self.name, factors, protocol)
                    units.append(LayoutUnit((key,), task, task, factors, layout, config))
        return [units]

    @staticmethod
    def measure(unit: LayoutUnit, registry: Registry) -> list[Cell]:
        """The row of one layout."""
        return [measure_layout(unit, _built(unit, registry))]

    def close(self) -> None:
        """Release the robot of this process."""
        _release()

    @staticmethod
    def sheets(cells: Sequence[Cell], runs: Sequence[Run] = ()) -> list[Sheet]:
        """A table per group, by task; if equal cells were measured twice, the later counts."""
        known = [cell for cell in cells if "seen" in cell.notes]  # earlier versions had other rows
        once = latest(known, lambda cell: cell.texts(*GROUPS, "task", "seed", "episode"))
        return [_sheet(group, placed) for group, placed in grouped(once, *GROUPS).items()]


def chosen_tasks(config: PerceptionBench, registry: Registry) -> list[str]:
    """The tasks by name, each once; by default all that need no option."""
    tasks = registry.components("task").items()
    whole = [name for name, task in tasks if name != NONE and not task.config.required]
    return named_tasks(config, registry) or whole


def chosen_components(config: PerceptionBench, registry: Registry, task: str) -> dict[str, Any]:
    """What to build for a task; raises :class:`ConfigurationError` for an option that it does not have."""
    kinds = ("robot", "camera", "language", "perceiver")
    chosen = {kind: getattr(config, kind) for kind in kinds}
    return {**chosen, "task": {"name": task, **task_options(config, registry, task)}}


_kept: dict[str, dict[str, Any]] = {}
"""The components of the task that this process worked on last: building a robot takes a second."""


def _built(unit: LayoutUnit, registry: Registry) -> dict[str, Any]:
    """The robot, the task and the perceiver of a unit."""
    if unit.task not in _kept:
        _release()
        root = chosen_components(unit.config, registry, unit.task)
        _kept[unit.task] = registry.build_all(root, ("robot", "task", "perceiver"))
    return _kept[unit.task]


def _release() -> None:
    for built in _kept.values():
        built["robot"].close()
    _kept.clear()


def measure_layout(unit: LayoutUnit, components: Mapping[str, Any]) -> Cell:
    """The row of a layout; of one that cannot be measured, the status says why.

    Raises :class:`ConfigurationError` for a robot without ground truth.
    """
    try:
        measures, notes = _measure(unit, components)
    except ConfigurationError:
        raise
    except Exception as error:  # a perceiver's crash is its layout's, not the bench's
        log.info("A layout could not be measured.", exc_info=True)
        why = str(error) if isinstance(error, Gvla2Error) else f"crashed, {type(error).__name__}: {error}"
        measures, notes = {}, {"status": f"failed: {why}", "seen": []}
    return Cell(unit.keys[0], unit.factors, measures, notes)


def _measure(
    unit: LayoutUnit, components: Mapping[str, Any]
) -> tuple[dict[str, float | None], dict[str, Any]]:
    """The measures and the notes of a layout."""
    robot: Any = components["robot"]
    instance = robot.reset(components["task"], unit.layout) if isinstance(robot, Segmented) else None
    if instance is None:
        raise ConfigurationError(
            "suite=perception needs a simulated robot that lays out tasks and knows what each pixel shows, such as "
            "robot=sapien_panda."
        )
    clear = robot.observe()  # the truth is what ideal cameras would show
    noise = np.random.default_rng([unit.layout, 0])  # that of an episode of this seed
    observation = apply_noise(clear, unit.config.depth_noise, noise, unit.layout)
    workspace, note = robot.arm.workspace, ""
    started = time.perf_counter()
    try:
        scene = perceive(
            components["perceiver"], observation, instance.instruction, workspace, "The perceiver"
        )
    except PerceptionError as error:
        scene, note = Scene((), 0.0, workspace), f"Nothing was perceived: {error}"
    seconds = time.perf_counter() - started
    objects, false = score(true_objects(robot, clear, instance.layout), scene)
    notes = {
        "status": "ok",
        "instruction": instance.instruction,
        "seen": [one.summary() for one in objects],
        "false_objects": [scene.objects[k].label for k in false],
        "note": note,
    }
    return {"false": float(len(false)), "seconds": seconds}, notes


def _share(values: Sequence[float]) -> tuple[str, ...]:
    return f"{100 * fmean(values):.0f} %", f"{sum(values):.0f} of {len(values)}"


def _spread(values: Sequence[float]) -> tuple[str, ...]:
    return f"{median(values):.2f}", f"p95 {np.percentile(values, 95):.2f}"


_OF_OBJECTS = {
    "found ↑": ("found", _share),
    "named right ↑": ("named", _share),
    "centre mm ↓": ("centre_mm", _spread),
    "worst side mm ↓": ("side_mm", _spread),
}
"""Columns by heading: the number of an object, and how to summarise its values."""


def _sheet(group: Sequence[str], cells: Sequence[Cell]) -> Sheet:
    """One row per task, and one for all."""
    rows = []
    for (name,), some in sorted(grouped(cells, "task").items()):
        failed = sum(cell.status != "ok" for cell in some)
        rows.append(SheetRow(f"{name} ({failed} failed)" if failed else name, _row(some)))
    if len(rows) > 1:
        rows.append(SheetRow("all", _row(cells)))
    headings = ("objects", *_OF_OBJECTS, "false a scene ↓", "seconds ↓")
    shared = ", ".join(f"{name} {value}" for name, value in zip(GROUPS, group, strict=True))
    counts = f"{len(cells)} layouts"
    return Sheet(f"Perception: {shared}", headings, tuple(rows), counts, runs_of(cells), EXPLANATION)


def _row(cells: Sequence[Cell]) -> tuple[SheetCell, ...]:
    objects = [one for cell in cells for one in cell.notes["seen"]]
    columns = [([float(o[n]) for o in objects if o.get(n) is not None], f) for n, f in _OF_OBJECTS.values()]
    columns.append((measured(cells, "false"), lambda values: (f"{fmean(values):.2f}",)))
    columns.append((measured(cells, "seconds"), _spread))
    numbers = [
        SheetCell(lines(values)) if values else SheetCell(("",), none=True) for values, lines in columns
    ]
    return (text_cell(f"{len(objects):,}"), *numbers)
