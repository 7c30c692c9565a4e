"""Success against the number of explored layouts, as a picture: one line per planner and world."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from itertools import cycle

from gvla2.evaluation.curve import CurveLine, CurvePoint, draw_curve
from gvla2.evaluation.results import Cell
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
    """The points of each planner and kind of memory, by how much was explored."""
    counts: dict[str, dict[int, list[bool]]] = {}
    without: dict[str, list[bool]] = {}
    for cell in cells:
        f, won = cell.factors, cell.measures.get("success")
        if f.get("profile") != "relaxed" or won is None:
            continue
        variant = str(f.get("variant", ""))
        explored = re.search(r"\bexplored=(\d+)", variant)
        planner = str(f.get("planner", ""))
        if f.get("arm") == "off" and not variant:
            without.setdefault(planner, []).append(bool(won))
        elif explored:
            memory = re.sub(r",? ?\bexplored=\d+", "", variant) or str(f.get("arm"))
            counts.setdefault(f"{planner}, {memory}", {}).setdefault(int(explored[1]), []).append(bool(won))
    lines: dict[str, list[Point]] = {}
    for name, found in counts.items():
        off = without.get(name.rpartition(", ")[0])
        every = {0: off, **found} if off and 0 not in found else found
        lines[name] = [(explored, sum(won), len(won)) for explored, won in sorted(every.items()) if won]
    return lines
