"""Success against the number of explored layouts, as a picture: one line per planner and world."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping, Sequence

from gvla2.evaluation.results import Cell
from gvla2.evaluation.statistics import wilson_interval

FEWEST = 3
"""Points of a curve."""
_COLOURS = ("#1f5fa8", "#b5651d", "#5a7d2a", "#7d2a5a")
_WIDTH, _HEIGHT, _LEFT, _TOP, _RIGHT, _BOTTOM = 640, 380, 64, 34, 20, 52

Point = tuple[int, int, int]
"""Explored layouts, successes, episodes."""


def learning_curve(cells: Iterable[Cell]) -> str:
    """An SVG of success in per cent (eased) over arms with different amounts of exploration; "" with under three.

    ``off`` counts as zero. Bars are 95 % Wilson intervals over episodes.
    """
    lines = {name: found for name, found in _lines(cells).items() if len(found) >= FEWEST}
    if not lines:
        return ""
    most = max(point[0] for points in lines.values() for point in points)

    def x(explored: int) -> float:
        return _LEFT + (_WIDTH - _LEFT - _RIGHT) * explored / most

    def y(share: float) -> float:
        return _TOP + (_HEIGHT - _TOP - _BOTTOM) * (1.0 - share)

    drawn = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {_WIDTH} {_HEIGHT}" '
        'font-family="sans-serif" font-size="12">',
        f'<rect width="{_WIDTH}" height="{_HEIGHT}" fill="white"/>'
        f'<text x="{_LEFT}" y="20">success of first attempts, with 95 % intervals</text>',
    ]
    for share in (0.0, 0.25, 0.5, 0.75, 1.0):
        drawn.append(
            f'<path d="M{_LEFT} {y(share):.1f}H{_WIDTH - _RIGHT}" stroke="#ddd"/>'
            f'<text x="{_LEFT - 8}" y="{y(share) + 4:.1f}" text-anchor="end">{100 * share:.0f} %</text>'
        )
    for explored in sorted({point[0] for points in lines.values() for point in points}):
        drawn.append(f'<text x="{x(explored):.1f}" y="{_HEIGHT - 32}" text-anchor="middle">{explored}</text>')
    drawn.append(f'<text x="{_LEFT}" y="{_HEIGHT - 12}">explored layouts of each row</text>')
    for number, (name, points) in enumerate(lines.items()):
        drawn += _line(name, points, _COLOURS[number % len(_COLOURS)], number, x, y)
    return "\n".join([*drawn, "</svg>\n"])


def _line(
    name: str,
    points: Sequence[Point],
    colour: str,
    number: int,
    x: Callable[[int], float],
    y: Callable[[float], float],
) -> list[str]:
    way = "L".join(f"{x(explored):.1f} {y(won / count):.1f}" for explored, won, count in points)
    drawn = [f'<path d="M{way}" fill="none" stroke="{colour}" stroke-width="2"/>']
    for explored, won, count in points:
        low, high = wilson_interval(won, count)
        drawn.append(
            f'<path d="M{x(explored):.1f} {y(low):.1f}V{y(high):.1f}" stroke="{colour}"/>'
            f'<circle cx="{x(explored):.1f}" cy="{y(won / count):.1f}" r="3" fill="{colour}"/>'
        )
    place = _HEIGHT - _BOTTOM - 8 - 15 * number
    drawn.append(f'<text x="{_WIDTH - _RIGHT}" y="{place}" text-anchor="end" fill="{colour}">{name}</text>')
    return drawn


def _lines(cells: Iterable[Cell]) -> Mapping[str, list[Point]]:
    """The points of each planner and kind of memory, by how much was explored."""
    counts: dict[str, dict[int, list[bool]]] = {}
    without: dict[str, list[bool]] = {}
    for cell in cells:
        f, won = cell.factors, cell.measures.get("success")
        if f.get("profile") != "eased" or won is None:
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
