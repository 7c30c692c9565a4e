"""The tables of the perception suite: by task and by kind of object, medians and 95th percentiles."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from statistics import fmean, median

import numpy as np

from gvla2.evaluation.results import Cell, grouped, latest, measured
from gvla2.evaluation.sheets import Exhibit, Exhibits, Sheet, SheetCell, SheetRow, runs_of

GROUPS = ("robot", "perceiver", "depth_noise", "scale")
SCENE = "scene"
ALL = "all"

EXPLANATION = (
    "Things that the true pixels show, against the perceived objects. Mask IoU is over all views together, and a "
    "thing is found above 0.5, seen whole from 0.8 where no second object is a piece of it. Label, colour, centre "
    "and extent are of found things: a label is right when its colour words and its head noun are the true ones "
    "(a synonym is wrong), an extent's error is that of the worst visible side. The first line is the median (a "
    "share, if in per cent), the second the 95th percentile, p95: one in twenty is worse. False objects match no "
    "thing, or are a second piece of one. Abstained: refused sentences that fit two twins of one colour."
)


def _share(values: Sequence[float]) -> tuple[str, ...]:
    return f"{100 * fmean(values):.0f} %", f"{sum(values):.0f} of {len(values)}"


def _mean(values: Sequence[float]) -> tuple[str, ...]:
    return (f"{fmean(values):.2f}",)


def _spread(digits: int, worst: float = 95) -> Callable[[Sequence[float]], tuple[str, ...]]:
    def say(values: Sequence[float]) -> tuple[str, ...]:
        return f"{median(values):.{digits}f}", f"p95 {np.percentile(values, worst):.{digits}f}"

    return say


_OF_THINGS = {
    "found ↑": ("found", _share),
    "whole ↑": ("whole", _share),
    "mask IoU ↑": ("iou", _spread(2, worst=5)),
    "label ↑": ("label", _share),
    "colour ↑": ("colour", _share),
    "centre mm ↓": ("centre_mm", _spread(1)),
    "extent mm ↓": ("extent_mm", _spread(1)),
}
"""Columns by heading: the measure of a thing's row, and how to say its values."""
_OF_SCENES = {
    "false a scene ↓": ("false", _mean),
    "abstained ↑": ("abstained", _share),
    "seconds ↓": ("seconds", _spread(2)),
}


def perception_sheets(cells: Iterable[Cell]) -> list[Sheet]:
    """Two tables per group, by task and by kind; if equal cells were measured twice, the later counts."""
    once = latest(cells, lambda cell: cell.told(*GROUPS, "task", "seed", "episode", "object"))
    sheets = []
    for group, placed in grouped(once, *GROUPS).items():
        kept = _without_stale(placed)
        said = ", ".join(f"{name} {value}" for name, value in zip(GROUPS, group, strict=True))
        sheets += [_sheet(kept, f"Perception: {said}, by {by}", by) for by in ("task", "kind")]
    return sheets


def _without_stale(cells: Sequence[Cell]) -> list[Cell]:
    """The cells whose layout was last measured together with them: an older run's things may have had other names."""
    latest = {key for cell in cells for key in [cell.key, *cell.notes.get("objects", [])] if _is_scene(cell)}
    return [cell for cell in cells if cell.key in latest]


def _sheet(cells: Sequence[Cell], title: str, by: str) -> Sheet:
    """One row per task or kind of thing, and one for all; by task with a picture of each."""
    scenes = by == "task"
    groups = grouped([cell for cell in cells if scenes or not _is_scene(cell)], by)
    rows = [SheetRow(_label(name, some), _row(some, scenes)) for (name,), some in sorted(groups.items())]
    if len(rows) > 1:
        rows.append(SheetRow(ALL, _row(cells, scenes)))
    headings = ("things", *_OF_THINGS, *(_OF_SCENES if scenes else ()), "missed most")
    counts = f"{sum(map(_is_scene, cells))} layouts"
    gallery = _gallery(cells) if scenes else None
    return Sheet(title, headings, tuple(rows), counts, runs_of(cells), EXPLANATION, gallery=gallery)


def _gallery(cells: Sequence[Cell]) -> Exhibits | None:
    paths = {str(c.factors["task"]): str(c.notes["picture"]) for c in cells if c.notes.get("picture")}
    exhibits = tuple(Exhibit(task, (path,)) for task, path in sorted(paths.items()))
    heading = "True outlines (white: found, red: missed) and perceived boxes"
    return Exhibits(heading, "overlays", exhibits) if exhibits else None


def _is_scene(cell: Cell) -> bool:
    return cell.factors.get("object") == SCENE


def _label(name: str, cells: Sequence[Cell]) -> str:
    failed = sum(cell.notes.get("status", "ok") != "ok" for cell in cells)
    return f"{name} ({failed} failed)" if failed else name


def _row(cells: Sequence[Cell], with_scenes: bool) -> tuple[SheetCell, ...]:
    scenes = [cell for cell in cells if _is_scene(cell)]
    things = [cell for cell in cells if not _is_scene(cell)]
    told = [(things, *column) for column in _OF_THINGS.values()]
    told += [(scenes, *column) for column in _OF_SCENES.values()] if with_scenes else []
    found = [(measured(some, name), say) for some, name, say in told]
    numbers = [SheetCell(say(values)) if values else SheetCell(("",), none=True) for values, say in found]
    return (SheetCell((f"{len(things):,}",)), *numbers, SheetCell((_missed(things),)))


def _missed(things: Sequence[Cell]) -> str:
    """The most often missed kind, and how many of how many."""
    kinds = {
        kind: [bool(cell.measures.get("found")) for cell in some]
        for (kind,), some in grouped(things, "kind").items()
    }
    kind = max(sorted(kinds), key=lambda kind: kinds[kind].count(False), default="")
    missed = kinds[kind].count(False) if kinds else 0
    return f"{kind}: {missed} of {len(kinds[kind])}" if missed else ""
