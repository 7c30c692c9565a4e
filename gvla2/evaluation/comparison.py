"""Tables that compare the rows of a suite: means, deviations over seeds, paired changes with their intervals."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from statistics import fmean
from typing import Literal

from gvla2.evaluation.results import Cell, grouped, latest, measured
from gvla2.evaluation.statistics import mean_and_deviation, relative_change
from gvla2.evaluation.tables import NONE, Sheet, SheetCell, SheetRow, Tone, runs_of
from gvla2.record.text import count

FEWEST = 5
"""Least number of objects for an interval: a bootstrap of fewer has hardly more values than objects."""
EXPLANATION = (
    "Mean over objects ± standard deviation over seeds, if there are several; change of the mean against the first "
    "row in per cent [95 % interval, bootstrap over objects, from five objects on]."
)


@dataclass(frozen=True)
class Measure:
    """A column: the measure's name, its heading, which way is better, and its decimals."""

    name: str
    title: str
    better: Literal["lower", "higher"]
    digits: int = 2
    compared: bool = True


@dataclass(frozen=True)
class TableLayout:
    """How a suite's cells become tables.

    One table for each combination of the ``groups`` factors; one row for each value of ``row`` in the order of
    ``labels``, compared with the row ``reference`` over the ``pair`` factor; deviations are over seeds;
    ``explanation`` explains this suite's rows and measures.
    """

    title: str
    row: str
    labels: Mapping[str, str]
    reference: str
    measures: tuple[Measure, ...]
    groups: tuple[str, ...]
    pair: str = "object"
    explanation: str = ""


def comparison_sheets(cells: Iterable[Cell], layout: TableLayout) -> list[Sheet]:
    """One table per group, in order of first appearance; if equal cells were measured twice, the later counts."""
    place = (*layout.groups, layout.row, layout.pair, "seed")
    once = latest(cells, lambda cell: cell.texts(*place))
    return [_sheet(group, kept, layout) for group, kept in grouped(once, *layout.groups).items()]


def _sheet(group: tuple[str, ...], cells: Sequence[Cell], layout: TableLayout) -> Sheet:
    by_row = {name: some for (name,), some in grouped(cells, layout.row).items()}
    names = [*(n for n in layout.labels if n in by_row), *sorted(by_row.keys() - layout.labels.keys())]
    rows = []
    for name in names:
        reference = [] if name == layout.reference else by_row.get(layout.reference, [])
        entries = tuple(_entry(m, by_row[name], reference, layout.pair) for m in layout.measures)
        failed = sum(cell.status != "ok" for cell in by_row[name])
        label = layout.labels.get(name, name)
        rows.append(SheetRow(f"{label} ({failed} failed)" if failed else label, entries))
    shared = zip(layout.groups, group, strict=True)
    objects, seeds = (max(len(grouped(some, by)) for some in by_row.values()) for by in (layout.pair, "seed"))
    return Sheet(
        f"{layout.title}: {', '.join(f'{name} {value}' for name, value in shared if value)}",
        tuple(f"{measure.title} {'↓' if measure.better == 'lower' else '↑'}" for measure in layout.measures),
        tuple(rows),
        f"{count(objects, 'object')}, {count(seeds, 'seed')}",
        runs_of(cells),
        f"{EXPLANATION} {layout.explanation}".strip(),
    )


def _entry(measure: Measure, cells: Sequence[Cell], reference: Sequence[Cell], pair: str) -> SheetCell:
    """The mean, and its change."""
    by_seed = _means(measure, cells, "seed")
    if not by_seed:
        return NONE
    mean, deviation = mean_and_deviation(list(by_seed.values()))
    spread = f" ± {deviation:.{measure.digits}f}" if len(by_seed) > 1 else ""  # one seed has no deviation
    lines = [f"{mean:.{measure.digits}f}{spread}"]
    tone: Tone = ""
    ours, theirs = _means(measure, cells, pair), _means(measure, reference, pair)
    both = [name for name in ours if name in theirs]
    if not measure.compared or not both or fmean([theirs[name] for name in both]) == 0:
        return SheetCell(tuple(lines))
    change = relative_change([theirs[name] for name in both], [ours[name] for name in both])
    line = f"{change.value:+.2f} %"
    if change.count >= FEWEST:
        line += f" [{change.low:+.2f}, {change.high:+.2f}]"
        if change.low * change.high > 0:  # only an interval without zero has a colour
            tone = "better" if (change.value < 0) == (measure.better == "lower") else "worse"
    lines.append(line)
    return SheetCell(tuple(lines), tone=tone)


def _means(measure: Measure, cells: Sequence[Cell], by: str) -> dict[str, float]:
    """The means of what was measured, grouped by a factor."""
    found = [cell for cell in cells if cell.measures.get(measure.name) is not None]
    return {group: fmean(measured(some, measure.name)) for (group,), some in grouped(found, by).items()}
