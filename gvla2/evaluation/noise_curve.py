"""Gain against noise as a picture: one line per method, intervals over objects."""

from __future__ import annotations

from collections.abc import Sequence

from gvla2.evaluation.prior_noise import CURVE, PER_CENT
from gvla2.evaluation.statistics import Change
from gvla2.evaluation.table_formats import FEWEST
from gvla2.evaluation.tables import Table

_ROWS = {"carving": "#b5651d", "aligned_tsdf": "#5a7d2a", "ab_fusion": "#1f5fa8"}
_WIDTH, _HEIGHT, _LEFT, _TOP, _RIGHT, _BOTTOM = 640, 380, 64, 34, 20, 52


def noise_curve(tables: Sequence[Table], measure: str = "cd_surface") -> str:
    """An SVG of the change of a measure against low-frequency error; "" with fewer than three points of the curve.

    Lines are carving, aligned TSDF and the whole branch, of the tables whose ``noise`` lies on :data:`CURVE`, of the
    first baseline and drift that have any. Bars are 95 % intervals over objects, if a table has them.
    """
    on = [table for table in tables if table.group.get("noise") in CURVE]
    if not on:
        return ""
    same = ("data", "baseline", "drift", "mode", "compat")
    on = [table for table in on if all(table.group.get(n) == on[0].group.get(n) for n in same)]
    if len({table.group["noise"] for table in on}) < 3:
        return ""
    lines = {row: _points(on, row, measure) for row in _ROWS}
    lines = {row: points for row, points in lines.items() if points}
    values = [v for points in lines.values() for _, change in points for v in (change.low, change.high, 0.0)]
    low, high = min(values) - 5, max(values) + 5
    most = max(PER_CENT[table.group["noise"]] for table in on)

    def x(noise: float) -> float:
        return _LEFT + (_WIDTH - _LEFT - _RIGHT) * noise / most

    def y(value: float) -> float:
        return _TOP + (_HEIGHT - _TOP - _BOTTOM) * (high - value) / (high - low)

    title = (
        f"{on[0].group['data']}, {on[0].group['baseline']}: change of surface distance, same prior for all"
    )
    drawn = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {_WIDTH} {_HEIGHT}" '
        'font-family="sans-serif" font-size="12">',
        f'<rect width="{_WIDTH}" height="{_HEIGHT}" fill="white"/><text x="{_LEFT}" y="20">{title}</text>',
    ]
    step = 25 if high - low < 200 else 100
    for value in range(int(low // step) * step, int(high) + 1, step):
        if low <= value <= high:
            drawn.append(
                f'<path d="M{_LEFT} {y(value):.1f}H{_WIDTH - _RIGHT}" stroke="{"#888" if value == 0 else "#ddd"}"/>'
                f'<text x="{_LEFT - 8}" y="{y(value) + 4:.1f}" text-anchor="end">{value:+d} %</text>'
            )
    for noise in sorted({PER_CENT[table.group["noise"]] for table in on}):
        drawn.append(f'<text x="{x(noise):.1f}" y="{_HEIGHT - 32}" text-anchor="middle">{noise:g} %</text>')
    below = "low-frequency error of the prior's depth; bars: 95 % intervals over objects, from five on"
    drawn.append(f'<text x="{_LEFT}" y="{_HEIGHT - 12}">{below}</text>')
    labels = on[0].layout.labels
    for number, (row, points) in enumerate(lines.items()):
        way = "L".join(f"{x(n):.1f} {y(c.percent):.1f}" for n, c in points)
        drawn.append(f'<path d="M{way}" fill="none" stroke="{_ROWS[row]}" stroke-width="2"/>')
        for noise, change in points:
            at = x(noise) + 3 * (number - 1)
            if change.count >= FEWEST:
                drawn.append(
                    f'<path d="M{at:.1f} {y(change.low):.1f}V{y(change.high):.1f}" stroke="{_ROWS[row]}"/>'
                )
            drawn.append(
                f'<circle cx="{x(noise):.1f}" cy="{y(change.percent):.1f}" r="3" fill="{_ROWS[row]}"/>'
            )
        drawn.append(
            f'<text x="{_WIDTH - _RIGHT}" y="{_HEIGHT - 40 + 15 * number}" text-anchor="end" fill="{_ROWS[row]}">'
            f"{labels.get(row, row)}</text>"
        )
    return "\n".join([*drawn, "</svg>\n"])


def _points(tables: Sequence[Table], row: str, measure: str) -> list[tuple[float, Change]]:
    found = {}
    for table in tables:
        names = [m.name for m in table.layout.measures]
        for line in table.rows:
            change = line.entries[names.index(measure)].change if line.name == row else None
            if change is not None:
                found[PER_CENT[table.group["noise"]]] = change
    return sorted(found.items())
