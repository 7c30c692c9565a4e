"""Tables that compare the rows of a suite: means, deviations over seeds, paired changes with their intervals."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from statistics import fmean
from typing import Literal

from gvla2.evaluation.results import Cell, grouped, latest, measured
from gvla2.evaluation.sheets import NONE, Exhibit, Exhibits, Sheet, SheetCell, SheetRow, Tone, runs_of
from gvla2.evaluation.statistics import Change, mean_and_deviation, paired_change
from gvla2.record.text import count

FEWEST = 5
"""Least objects for an interval: a bootstrap of fewer has hardly more values than objects."""
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
    ``labels``, compared with the row ``reference`` over the ``pair`` factor; deviations are over ``repeat``;
    ``explanation`` explains this suite's rows and measures.
    """

    title: str
    row: str
    labels: Mapping[str, str]
    reference: str
    measures: tuple[Measure, ...]
    groups: tuple[str, ...]
    pair: str = "object"
    repeat: str = "seed"
    explanation: str = ""


@dataclass(frozen=True)
class Entry:
    """One number of a table; None if not measured.

    ``mean`` over objects, then over seeds; ``deviation`` over seeds; ``change`` against the reference row, paired by
    object; ``worst`` the change in per cent of the object that fared worst, ``worst_object`` its name, and ``worse``
    all that lost more than :data:`NOTABLE` per cent, the worst first. ``deviation`` is None for one seed.
    """

    mean: float | None
    deviation: float | None = None
    change: Change | None = None
    worst: float | None = None
    worst_object: str = ""
    worse: tuple[str, ...] = ()


@dataclass(frozen=True)
class TableRow:
    """A row: its label, one entry per measure, its numbers of objects and seeds, and of failed cells.

    ``rejected``: for each stage, in how many of its cells the input views refuted it ("5 of 6"), if any: rows that
    differ only in such a stage are alike.
    """

    name: str
    label: str
    entries: tuple[Entry, ...]
    objects: int
    seeds: int
    failed: int
    rejected: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Table:
    """A finished table; ``group`` names what its ``cells`` have in common."""

    layout: TableLayout
    group: Mapping[str, str]
    rows: tuple[TableRow, ...]
    cells: tuple[Cell, ...]

    @property
    def title(self) -> str:
        """The suite's title and what the cells have in common."""
        return f"{self.layout.title}: " + ", ".join(
            f"{name} {value}" for name, value in self.group.items() if value
        )


NOTABLE = 2.0
"""Per cent of loss above which an object is named as made worse."""


def make_tables(cells: Iterable[Cell], layout: TableLayout) -> list[Table]:
    """One table per group, in order of first appearance; if equal cells were measured twice, the later counts."""
    place = (*layout.groups, layout.row, layout.pair, layout.repeat)
    once = latest(cells, lambda cell: cell.told(*place))
    tables = []
    for group, kept in grouped(once, *layout.groups).items():
        by_row = {name: some for (name,), some in grouped(kept, layout.row).items()}
        names = [*(n for n in layout.labels if n in by_row), *sorted(by_row.keys() - layout.labels.keys())]
        reference = by_row.get(layout.reference, [])
        rows = tuple(_row(name, by_row[name], reference, layout) for name in names)
        tables.append(Table(layout, dict(zip(layout.groups, group, strict=True)), rows, tuple(kept)))
    return tables


def comparison_sheets(cells: Iterable[Cell], layout: TableLayout) -> list[Sheet]:
    """The tables of these cells as text, with the pictures of each object."""
    return [_sheet(table) for table in make_tables(cells, layout)]


def _sheet(table: Table) -> Sheet:
    measures = table.layout.measures
    seeds = max((row.seeds for row in table.rows), default=0)
    objects = max((row.objects for row in table.rows), default=0)
    return Sheet(
        table.title,
        tuple(f"{measure.title} {'↓' if measure.better == 'lower' else '↑'}" for measure in measures),
        tuple(
            SheetRow(_label(row), tuple(_cell(*pair) for pair in zip(row.entries, measures, strict=True)))
            for row in table.rows
        ),
        f"{count(objects, 'object')}, {count(seeds, 'seed')}",
        runs_of(table.cells),
        f"{EXPLANATION} {table.layout.explanation}".strip(),
        _remarks(table),
        _gallery(table),
    )


def _label(row: TableRow) -> str:
    return f"{row.label} ({row.failed} failed)" if row.failed else row.label


def _cell(entry: Entry, measure: Measure) -> SheetCell:
    """Up to three lines: the number, its change, the worst object."""
    if entry.mean is None:
        return NONE
    spread = "" if entry.deviation is None else f" ± {entry.deviation:.{measure.digits}f}"
    lines = [f"{entry.mean:.{measure.digits}f}{spread}"]
    tone: Tone = ""
    if entry.change is not None:
        change, sure = entry.change, entry.change.count >= FEWEST
        lines.append(
            f"{change.percent:+.2f} %" + (f" [{change.low:+.2f}, {change.high:+.2f}]" if sure else "")
        )
        # Only a change whose interval leaves out zero has a colour.
        if sure and change.low * change.high > 0:
            tone = "better" if (change.percent < 0) == (measure.better == "lower") else "worse"
    if entry.worst is not None:
        lines.append(f"worst {entry.worst + 0.0:+.2f} % ({entry.worst_object})")
    return SheetCell(tuple(lines), tone=tone)


def _remarks(table: Table) -> str:
    """The objects that a row made worse, and the stages that the views refuted."""
    told = [
        f"Made worse by more than {NOTABLE:.0f} % ({row.label}, {measure.title}): {', '.join(entry.worse)}."
        for row in table.rows
        for entry, measure in zip(row.entries, table.layout.measures, strict=True)
        if entry.worse
    ]
    undone = [
        f"{row.label}: {', '.join(f'{stage} {count}' for stage, count in row.rejected.items())}"
        for row in table.rows
        if row.rejected
    ]
    told += [f"Cells in which the views refuted a stage: {'; '.join(undone)}."] if undone else []
    return " ".join(told)


def _gallery(table: Table) -> Exhibits | None:
    """One exhibit per object: the first picture of each row, in the order of the rows."""
    layout, found = table.layout, []
    order = [row.name for row in table.rows]
    pictured = [cell for cell in table.cells if cell.notes.get("picture")]
    for (name,), cells in sorted(grouped(pictured, layout.pair).items())[:MOST_PICTURES]:
        first = {row: str(some[0].notes["picture"]) for (row,), some in grouped(cells, layout.row).items()}
        found.append(Exhibit(name, tuple(first[row] for row in sorted(first, key=order.index))))
    heading = "Pictures: a held-out view, the baseline, the branch's output"
    return Exhibits(heading, "pictures", tuple(found)) if found else None


def _row(name: str, cells: Sequence[Cell], reference: Sequence[Cell], layout: TableLayout) -> TableRow:
    against = [] if name == layout.reference else reference
    entries = tuple(_entry(measure, cells, against, layout) for measure in layout.measures)
    return TableRow(
        name,
        layout.labels.get(name, name),
        entries,
        len(grouped(cells, layout.pair)),
        len(grouped(cells, layout.repeat)),
        sum(cell.notes.get("status", "ok") != "ok" for cell in cells),
        _rejected(cells),
    )


def _rejected(cells: Sequence[Cell]) -> dict[str, str]:
    told = [tuple(stage.split(": ")) for cell in cells for stage in cell.notes.get("stages", ())]
    ran, undone = Counter(stage for stage, _ in told), Counter(told)
    return {stage: f"{no} of {count}" for stage, count in ran.items() if (no := undone[stage, "rejected"])}


def _entry(measure: Measure, cells: Sequence[Cell], reference: Sequence[Cell], layout: TableLayout) -> Entry:
    by_seed = _means(measure, cells, layout.repeat)
    if not by_seed:
        return Entry(None)
    mean, spread = mean_and_deviation(list(by_seed.values()))
    deviation = spread if len(by_seed) > 1 else None  # one seed has no deviation
    ours, theirs = (_means(measure, some, layout.pair) for some in (cells, reference))
    both = [pair for pair in ours if pair in theirs]
    if not measure.compared or not both or fmean([theirs[pair] for pair in both]) == 0:
        return Entry(mean, deviation)
    change = paired_change([theirs[pair] for pair in both], [ours[pair] for pair in both])
    sign = 1 if measure.better == "lower" else -1
    losses = {pair: sign * 100 * (ours[pair] / theirs[pair] - 1) for pair in both if theirs[pair] != 0}
    # If nothing has changed, no object is the worst.
    worst = max(losses, key=losses.__getitem__) if any(losses.values()) else None
    # The change of the measure itself, like the one of the mean: a loss of PSNR is negative.
    changed = None if worst is None else sign * losses[worst]
    worse = sorted((pair for pair in losses if losses[pair] > NOTABLE), key=lambda pair: -losses[pair])
    return Entry(mean, deviation, change, changed, worst or "", tuple(worse))


def _means(measure: Measure, cells: Sequence[Cell], by: str) -> dict[str, float]:
    """The means of what was measured, grouped by a factor."""
    told = [cell for cell in cells if cell.measures.get(measure.name) is not None]
    return {group: fmean(measured(some, measure.name)) for (group,), some in grouped(told, by).items()}
