"""Success against the number of explored layouts, as a picture: one line per planner and world."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from itertools import cycle

from gvla2.evaluation.curve import CurveLine, CurvePoint, draw_curve
from gvla2.evaluation.results import Cell, grouped, latest
from gvla2.evaluation.robot.design import EPISODE, HOUSE, PLANNER
from gvla2.evaluation.statistics import wilson_interval

FEWEST = 3
"""Points of a curve."""
_COLOURS = ("#1f5fa8", "#b5651d", "#5a7d2a", "#7d2a5a")

Point = tuple[int, int, int]
"""Explored layouts, successes, episodes."""


def learning_curve(cells: Iterable[Cell]) -> str:
    """An SVG of success in per cent (relaxed) over arms with different amounts of exploration; "" with under three.

    ``off`` counts as zero. Bars are 95 % Wilson intervals over episodes.
    """
    lines = {name: found for name, found in _lines(cells).items() if len(found) >= FEWEST}
    if not lines:
        return ""
    shown = [
        CurveLine(name, colour, [_point(*point) for point in points])
        for (name, points), colour in zip(lines.items(), cycle(_COLOURS), strict=False)
    ]
    explored = sorted({point[0] for points in lines.values() for point in points})
    return draw_curve(
        "success of first attempts, with 95 % intervals",
        shown,
        {count: str(count) for count in explored},
        {share: f"{share} %" for share in (0, 25, 50, 75, 100)},
        (0.0, 100.0),
        "explored layouts of each row",
    )


def _point(explored: int, won: int, count: int) -> CurvePoint:
    low, high = wilson_interval(won, count)
    return CurvePoint(explored, 100 * won / count, (100 * low, 100 * high))


def _lines(cells: Iterable[Cell]) -> Mapping[str, list[Point]]:
    """The points of each planner and kind of memory, by how much was explored; benches that differ are apart."""
    once = [cell for cell in latest(cells, lambda cell: cell.told(*HOUSE, *EPISODE)) if _counts(cell)]
    several = len(grouped(once, *HOUSE)) > 1
    lines: dict[str, list[Point]] = {}
    for house, of_house in grouped(once, *HOUSE).items():
        around = f" ({', '.join(filter(None, house))})" if several else ""
        for planner, some in grouped(of_house, *PLANNER).items():
            off = [bool(c.measures["success"]) for c in some if c.told("arm", "variant") == ("off", "")]
            for memory, counts in _by_memory(some).items():
                every = {**({0: off} if off else {}), **counts}
                told = ", ".join((*filter(None, planner), memory))
                lines[f"{told}{around}"] = [(n, sum(won), len(won)) for n, won in sorted(every.items())]
    return lines


def _counts(cell: Cell) -> bool:
    return cell.factors.get("profile") == "relaxed" and cell.measures.get("success") is not None


def _by_memory(cells: Iterable[Cell]) -> Mapping[str, dict[int, list[bool]]]:
    """Successes of arms that learnt from a number of layouts, by the rest of their name and that number."""
    found: dict[str, dict[int, list[bool]]] = {}
    for cell in cells:
        arm, variant, learning = cell.told("arm", "variant", "learning")
        if explored := re.search(r"\bexplored=(\d+)", variant):
            rest = re.sub(r",? ?\bexplored=\d+", "", variant) or arm
            memory = f"{rest}, {learning}" if learning else rest
            found.setdefault(memory, {}).setdefault(int(explored[1]), []).append(
                bool(cell.measures["success"])
            )
    return found
