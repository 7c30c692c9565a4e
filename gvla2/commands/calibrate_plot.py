"""A picture of a calibration's residuals, pair by pair, solver by solver."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from gvla2.robot.hand_eye import Solution

_LEFT, _TOP, _HIGH, _GAP, _WIDE = 60, 40, 150, 46, 640
_COLOURS = ("#0b6e99", "#d9730d", "#0f7b6c", "#ad1a72", "#6940a5", "#dfab01", "#64473a", "#e03e3e", "#787774")


def residuals_svg(solutions: Sequence[Solution], limit: float) -> str:
    """Two charts as SVG: millimetres and degrees by pair; ``limit`` metres is drawn as a line."""
    count = len(solutions[0].shifts)
    shifts = [1e3 * s.shifts for s in solutions]
    turns = [np.degrees(s.turns) for s in solutions]
    height = _TOP + 2 * (_HIGH + _GAP) + 20 * len(solutions)
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{_LEFT + _WIDE + 20}" height="{height}" '
        'font-family="sans-serif" font-size="12">',
        '<rect width="100%" height="100%" fill="white"/>',
        f'<text x="{_LEFT}" y="20" font-size="15">Hand-eye residuals of {count} pose pairs</text>',
    ]
    parts += _chart(shifts, _TOP, "mm", 1e3 * limit)
    parts += _chart(turns, _TOP + _HIGH + _GAP, "degrees", None)
    y = _TOP + 2 * (_HIGH + _GAP)
    for index, solution in enumerate(solutions):
        colour = _COLOURS[index % len(_COLOURS)]
        parts.append(f'<rect x="{_LEFT}" y="{y - 9}" width="12" height="10" fill="{colour}"/>')
        parts.append(
            f'<text x="{_LEFT + 18}" y="{y}">{solution.method}: RMSE {1e3 * solution.rmse:.2f} mm, '
            f"{np.degrees(np.sqrt(np.mean(solution.turns**2))):.3f} degrees</text>"
        )
        y += 20
    return "\n".join([*parts, "</svg>"]) + "\n"


def _chart(series: Sequence[np.ndarray], top: float, unit: str, limit: float | None) -> list[str]:
    largest = max([float(values.max()) for values in series] + ([] if limit is None else [limit]))
    largest = max(largest, 1e-6) * 1.08
    count = len(series[0])
    slot = _WIDE / count
    bar = 0.8 * slot / len(series)
    bottom = top + _HIGH
    parts = [
        f'<line x1="{_LEFT}" y1="{bottom}" x2="{_LEFT + _WIDE}" y2="{bottom}" stroke="#888"/>',
        f'<text x="{_LEFT - 8}" y="{top + 10}" text-anchor="end">{largest:.2g}</text>',
        f'<text x="{_LEFT - 8}" y="{bottom}" text-anchor="end">0 {unit}</text>',
        f'<text x="{_LEFT + _WIDE / 2}" y="{bottom + 16}" text-anchor="middle">pose pair</text>',
    ]
    for index, values in enumerate(series):
        for pair, value in enumerate(values):
            tall = _HIGH * float(value) / largest
            x = _LEFT + pair * slot + 0.1 * slot + index * bar
            parts.append(
                f'<rect x="{x:.1f}" y="{bottom - tall:.1f}" width="{bar:.2f}" height="{tall:.1f}" '
                f'fill="{_COLOURS[index % len(_COLOURS)]}"/>'
            )
    if limit is not None:
        y = bottom - _HIGH * limit / largest
        parts.append(
            f'<line x1="{_LEFT}" y1="{y:.1f}" x2="{_LEFT + _WIDE}" y2="{y:.1f}" stroke="#e03e3e" '
            'stroke-dasharray="4 3"/>'
        )
    return parts
