"""Tables that compare the rows of a suite: means, deviations over seeds, paired changes with their intervals."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from statistics import fmean
from typing import Literal

from gvla2.evaluation.results import Cell, grouped, latest, measured
from gvla2.evaluation.statistics import mean_and_deviation, relative_change
from gvla2.evaluation.tables import NONE, Exhibit, Exhibits, Sheet, SheetCell, SheetRow, Tone, runs_of
from gvla2.record.text import count

FEWEST = 5
"""Least objects for an interval: a bootstrap of fewer has hardly more values than objects."""
MOST_PICTURES = 60
"""Objects shown below one table: the page stays small enough for e-mail."""
NOTABLE = 2.0
"""Per cent of loss above which an object is named as made worse."""
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


def comparison_sheets(cells: Iterable[Cell], layout: TableLayout) -> list[Sheet]:
    """One table per group, in order of first appearance; if equal cells were measured twice, the later counts."""
    place = (*layout.groups, layout.row, layout.pair, layout.repeat)
    once = latest(cells, lambda cell: cell.texts(*place))
    return [_sheet(group, kept, layout) for group, kept in grouped(once, *layout.groups).items()]


def _sheet(group: tuple[str, ...], cells: Sequence[Cell], layout: TableLayout) -> Sheet:
    by_row = {name: some for (name,), some in grouped(cells, layout.row).items()}
    names = [*(n for n in layout.labels if n in by_row), *sorted(by_row.keys() - layout.labels.keys())]
    reference, rows, remarks = by_row.get(layout.reference, []), [], list[str]()
    for name in names:
        label = layout.labels.get(name, name)
        entries = []
        for measure in layout.measures:
            against = [] if name == layout.reference else reference
            entry, worse = _entry(measure, by_row[name], against, layout)
            entries.append(entry)
            if worse:
                remark = f"Made worse by more than {NOTABLE:.0f} % ({label}, {measure.title})"
                remarks.append(f"{remark}: {', '.join(worse)}.")
        failed = sum(cell.status != "ok" for cell in by_row[name])
        rows.append(SheetRow(f"{label} ({failed} failed)" if failed else label, tuple(entries)))
    rejected = [
        f"{layout.labels.get(name, name)}: {undone}" for name in names if (undone := _rejected(by_row[name]))
    ]
    if rejected:
        remarks.append(f"Cells in which the views refuted a stage: {'; '.join(rejected)}.")
    shared = zip(layout.groups, group, strict=True)
    counts = (max(len(grouped(some, by)) for some in by_row.values()) for by in (layout.pair, layout.repeat))
    objects, seeds = counts
    return Sheet(
        f"{layout.title}: {', '.join(f'{name} {value}' for name, value in shared if value)}",
        tuple(f"{measure.title} {'↓' if measure.better == 'lower' else '↑'}" for measure in layout.measures),
        tuple(rows),
        f"{count(objects, 'object')}, {count(seeds, 'seed')}",
        runs_of(cells),
        f"{EXPLANATION} {layout.explanation}".strip(),
        " ".join(remarks),
        _gallery(cells, names, layout),
    )


def _entry(
    measure: Measure, cells: Sequence[Cell], reference: Sequence[Cell], layout: TableLayout
) -> tuple[SheetCell, list[str]]:
    """Up to three lines: the mean, its change, the object that fared worst; and the objects made notably worse."""
    by_seed = _means(measure, cells, layout.repeat)
    if not by_seed:
        return NONE, []
    mean, deviation = mean_and_deviation(list(by_seed.values()))
    spread = f" ± {deviation:.{measure.digits}f}" if len(by_seed) > 1 else ""  # one seed has no deviation
    lines = [f"{mean:.{measure.digits}f}{spread}"]
    tone: Tone = ""
    ours, theirs = (_means(measure, some, layout.pair) for some in (cells, reference))
    both = [pair for pair in ours if pair in theirs]
    if not measure.compared or not both or fmean([theirs[pair] for pair in both]) == 0:
        return SheetCell(tuple(lines)), []
    change = relative_change([theirs[pair] for pair in both], [ours[pair] for pair in both])
    line = f"{change.value:+.2f} %"
    if change.count >= FEWEST:
        line += f" [{change.low:+.2f}, {change.high:+.2f}]"
        if change.low * change.high > 0:  # only an interval without zero has a colour
            tone = "better" if (change.value < 0) == (measure.better == "lower") else "worse"
    lines.append(line)
    sign = 1 if measure.better == "lower" else -1
    losses = {pair: sign * 100 * (ours[pair] / theirs[pair] - 1) for pair in both if theirs[pair] != 0}
    if any(losses.values()):  # if nothing has changed, no object is the worst
        worst = max(losses, key=losses.__getitem__)
        # The change of the measure itself, like the one of the mean: a loss of PSNR is negative.
        lines.append(f"worst {sign * losses[worst] + 0.0:+.2f} % ({worst})")
    worse = sorted((pair for pair in losses if losses[pair] > NOTABLE), key=lambda pair: -losses[pair])
    return SheetCell(tuple(lines), tone=tone), worse


def _means(measure: Measure, cells: Sequence[Cell], by: str) -> dict[str, float]:
    """The means of what was measured, grouped by a factor."""
    found = [cell for cell in cells if cell.measures.get(measure.name) is not None]
    return {group: fmean(measured(some, measure.name)) for (group,), some in grouped(found, by).items()}


def _rejected(cells: Sequence[Cell]) -> str:
    """In how many cells the input views refuted each stage: rows that differ only in such a stage are alike."""
    stages = [tuple(stage.split(": ")) for cell in cells for stage in cell.notes.get("stages", ())]
    ran, undone = Counter(stage for stage, _ in stages), Counter(stages)
    return ", ".join(
        f"{stage} {no} of {number}" for stage, number in ran.items() if (no := undone[stage, "rejected"])
    )


def _gallery(cells: Sequence[Cell], order: Sequence[str], layout: TableLayout) -> Exhibits | None:
    """One exhibit per object: the first picture of each row, in the order of the rows."""
    found = []
    pictured = [cell for cell in cells if cell.notes.get("picture")]
    for (name,), some in sorted(grouped(pictured, layout.pair).items())[:MOST_PICTURES]:
        first = {row: str(one[0].notes["picture"]) for (row,), one in grouped(some, layout.row).items()}
        found.append(Exhibit(name, tuple(first[row] for row in sorted(first, key=order.index))))
    heading = "Pictures: a held-out view, the baseline, the branch's output"
    return Exhibits(heading, "pictures", tuple(found)) if found else None
