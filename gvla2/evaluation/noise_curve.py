"""Gain against noise as a picture: one line per method, intervals over objects."""

from __future__ import annotations

from collections.abc import Sequence

from gvla2.evaluation.comparison import FEWEST, Table
from gvla2.evaluation.curve import CurveLine, CurvePoint, draw_curve
from gvla2.evaluation.prior_noise import PER_CENT

_ROWS = {"carving": "#b5651d", "aligned_tsdf": "#5a7d2a", "ab_fusion": "#1f5fa8"}


def noise_curve(tables: Sequence[Table], measure: str = "cd_surface") -> str:
    """An SVG of the change of a measure against low-frequency error; "" with fewer than three points of the curve.

    Lines are carving, aligned TSDF and the whole branch, of the tables whose ``noise`` lies on :data:`PER_CENT`, of the
    first baseline and drift that have any. Bars are 95 % intervals over objects, if a table has them.
    """
    on = [table for table in tables if table.group.get("noise") in PER_CENT]
    if not on:
        return ""
    same = ("data", "baseline", "drift", "branch")
    on = [table for table in on if all(table.group.get(n) == on[0].group.get(n) for n in same)]
    if len({table.group["noise"] for table in on}) < 3:
        return ""
    labels = on[0].layout.labels
    lines = [CurveLine(labels[row], colour, _points(on, row, measure)) for row, colour in _ROWS.items()]
    drawn = [line for line in lines if line.points]
    points = [point for line in drawn for point in line.points]
    values = [value for point in points for value in (point.y, *(point.bar or ()), 0.0)]
    low, high = min(values) - 5, max(values) + 5
    step = 25 if high - low < 200 else 100
    shown = range(int(low // step) * step, int(high) + 1, step)
    noises = sorted({PER_CENT[table.group["noise"]] for table in on})
    return draw_curve(
        f"{on[0].group['data']}, {on[0].group['baseline']}: change of surface distance, same prior for all",
        drawn,
        {noise: f"{noise:g} %" for noise in noises},
        {value: f"{value:+d} %" for value in shown if low <= value <= high},
        (low, high),
        "low-frequency error of the prior's depth; bars: 95 % intervals over objects, from five on",
    )


def _points(tables: Sequence[Table], row: str, measure: str) -> list[CurvePoint]:
    found = {}
    for table in tables:
        names = [m.name for m in table.layout.measures]
        for line in table.rows:
            change = line.entries[names.index(measure)].change if line.name == row else None
            if change is not None:
                bar = (change.low, change.high) if change.count >= FEWEST else None
                noise = PER_CENT[table.group["noise"]]
                found[noise] = CurvePoint(noise, change.percent, bar)
    return [point for _, point in sorted(found.items())]
