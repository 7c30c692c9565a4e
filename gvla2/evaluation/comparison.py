"""Tables that compare the rows of a suite: means, deviations over seeds, paired changes with their intervals."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from statistics import fmean
from typing import Literal

from gvla2.evaluation.results import Cell, grouped, latest, measured
from gvla2.evaluation.statistics import mean_and_deviation, relative_change
from gvla2.evaluation.tables import NONE, Exhibit, Exhibits, Sheet, SheetCell, SheetRow, Tone, runs_of
from gvla2.record.text import count

FEWEST = 5
"""Least number of objects for an interval: a bootstrap of fewer has hardly more values than objects."""
MOST_PICTURES = 60
"""Objects shown below one table: the page stays small enough for e-mail."""
EXPLANATION = (
    "Mean over objects ± standard deviation over seeds, if there are several; change of the mean against the first "
    "row in per cent [95 % interval, bootstrap over objects, from five objects on]; worst: the change of the object "
    "that fared worst."
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
        _gallery(cells, names, layout),
    )


def _entry(measure: Measure, cells: Sequence[Cell], reference: Sequence[Cell], pair: str) -> SheetCell:
    """Up to three lines: the mean, its change, and the object that fared worst."""
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
    changes = {name: 100 * (ours[name] / theirs[name] - 1) for name in both if theirs[name] != 0}
    if any(changes.values()):  # if nothing has changed, no object is the worst
        worst = sorted(changes, key=changes.__getitem__)[-1 if measure.better == "lower" else 0]
        lines.append(f"worst {changes[worst] + 0.0:+.2f} % ({worst})")
    return SheetCell(tuple(lines), tone=tone)


def _means(measure: Measure, cells: Sequence[Cell], by: str) -> dict[str, float]:
    """The means of what was measured, grouped by a factor."""
    found = [cell for cell in cells if cell.measures.get(measure.name) is not None]
    return {group: fmean(measured(some, measure.name)) for (group,), some in grouped(found, by).items()}


def _gallery(cells: Sequence[Cell], order: Sequence[str], layout: TableLayout) -> Exhibits | None:
    """One exhibit per object: the first picture of each row, in the order of the rows."""
    found = []
    pictured = [cell for cell in cells if cell.notes.get("picture")]
    for (name,), some in sorted(grouped(pictured, layout.pair).items())[:MOST_PICTURES]:
        first = {row: str(one[0].notes["picture"]) for (row,), one in grouped(some, layout.row).items()}
        found.append(Exhibit(name, tuple(first[row] for row in sorted(first, key=order.index))))
    heading = "Pictures: a held-out view, the baseline, the branch's output"
    return Exhibits(heading, tuple(found)) if found else None
