"""Tables that compare the rows of a suite: means, rates, deviations over seeds, paired changes with their intervals."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from statistics import fmean
from typing import Literal, TypeVar

from gvla2.evaluation.results import Cell, grouped, latest, measured
from gvla2.evaluation.statistics import (
    Pair,
    detectable_difference,
    exact_mcnemar,
    holm,
    mean_and_deviation,
    pooled_difference,
    relative_change,
    wilson_interval,
    won_and_lost,
)
from gvla2.evaluation.tables import NONE, Sheet, SheetCell, SheetRow, Tone, runs_of
from gvla2.record.text import count

FEWEST = 5
"""Least number of objects for an interval: a bootstrap of fewer has hardly more values than objects."""
EXPLANATION = (
    "Mean over objects ± standard deviation over seeds, if there are several; change of the mean against the first "
    "row in per cent, of a success rate in points [95 % interval, bootstrap over objects, from five objects on]; the "
    "least change that so many objects can show (p < .05, power 80 %)."
)
FULL = 0.95
"""Success rates that are all above it, or all below what it leaves, have no room for a difference."""
SATURATED = (
    "Saturated: at least 95 % of the episodes succeed in all that is compared, or at least 95 % fail, which leaves no "
    "room for a difference."
)
SURE = 0.05
"""An adjusted p below it is coloured."""
EFFECT = (
    "Difference of success rates in points, mean over tasks [95 % bootstrap over tasks, then episodes]; episodes won : "
    "lost; exact McNemar p over all pairs; the least difference that so many pairs can show (p < .05, power 80 %); "
    "tasks that differ after Holm."
)


@dataclass(frozen=True)
class Measure:
    """A column: the measure's name, its heading, which way is better, and its decimals.

    A ``rate`` is 0 or 100 in each cell: how many points its pairs can show follows from that.
    """

    name: str
    title: str
    better: Literal["lower", "higher"]
    digits: int = 2
    compared: bool = True
    rate: bool = False


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
        for measure in layout.measures if reference and not failed else ():
            if measure.rate:
                shares = [measured(some, measure.name) for some in (reference, by_row[name])]
                label += saturated([fmean(some) / 100 for some in shares if some])
        rows.append(SheetRow(f"{label} ({failed} failed)" if failed else label, entries))
    shared = zip(layout.groups, group, strict=True)
    objects, seeds = (max(len(grouped(some, by)) for some in by_row.values()) for by in (layout.pair, "seed"))
    return Sheet(
        ": ".join(
            filter(None, (layout.title, ", ".join(f"{name} {value}" for name, value in shared if value)))
        ),
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
    if not measure.compared or not both:
        return SheetCell(tuple(lines))
    if measure.rate:
        if not (by_object := _pairs(measure, reference, cells, pair)):
            return SheetCell(tuple(lines))
        change, unit = pooled_difference(by_object), "points"
        shown = least([one for pairs in by_object.values() for one in pairs])
    elif fmean([theirs[name] for name in both]) == 0:
        return SheetCell(tuple(lines))
    else:
        change, unit = relative_change([theirs[name] for name in both], [ours[name] for name in both]), "%"
        shown = f"could show {change.least:.2f} %" if change.count > 1 else ""
    line = f"{change.value:+.2f} {unit}"
    if len(both) >= FEWEST:
        line += f" [{change.low:+.2f}, {change.high:+.2f}]"
        if change.low * change.high > 0:  # only an interval without zero has a colour
            tone = "better" if (change.value < 0) == (measure.better == "lower") else "worse"
    return SheetCell((*lines, line, *filter(None, [shown])), tone=tone)


def _means(measure: Measure, cells: Sequence[Cell], by: str) -> dict[str, float]:
    """The means of what was measured, grouped by a factor."""
    found = [cell for cell in cells if cell.measures.get(measure.name) is not None]
    return {group: fmean(measured(some, measure.name)) for (group,), some in grouped(found, by).items()}


def _pairs(
    measure: Measure, first: Sequence[Cell], second: Sequence[Cell], pair: str
) -> dict[str, list[Pair]]:
    """By ``pair`` what two rows measured with the same seed."""
    one, two = (
        {c.texts(pair, "seed"): value for c in some if (value := c.measures.get(measure.name)) is not None}
        for some in (first, second)
    )
    return pairs_by_task(one, two)


Place = TypeVar("Place", bound=tuple[str, ...])


def pairs_by_task(first: Mapping[Place, float], second: Mapping[Place, float]) -> dict[str, list[Pair]]:
    """By task, the first part of a place, the places that both have: which of both did better there."""
    pairs: dict[str, list[Pair]] = {}
    for place in sorted(first.keys() & second.keys()):
        one, two = first[place], second[place]
        pairs.setdefault(place[0], []).append((one > two, two > one) if one != two else (one > 0, one > 0))
    return pairs


def least(pairs: Sequence[Pair]) -> str:
    """The least difference that these pairs could have shown, if there is one."""
    points = detectable_difference(pairs)
    return f"could show {points:.0f} points" if points <= 100 else "too few pairs to show any"


def saturated(rates: Sequence[float]) -> str:
    """A remark on success rates, shares in [0, 1], that leave no room for a difference; "" for others."""
    full = len(rates) > 1 and (min(rates) >= FULL or max(rates) <= 1 - FULL)
    return " (saturated)" if full else ""


def rate(outcomes: Sequence[float], sure: int = 0) -> SheetCell:
    """A success rate in per cent with its 95 % Wilson interval and its counts, marked by the sign of a sure change.

    An outcome between 0 and 1 is the mean of one trial that was repeated.
    """
    if not outcomes:
        return NONE
    won, trials = sum(outcomes), len(outcomes)
    low, high = wilson_interval(won, trials)
    tone: Tone = "" if not sure else "better" if sure > 0 else "worse"
    value = f"{100 * won / trials:.1f}{' *' if sure else ''}"
    return SheetCell((value, f"[{100 * low:.0f}, {100 * high:.0f}] {won:g}/{trials}"), tone=tone)


def different(pairs: Mapping[str, Sequence[Pair]]) -> dict[str, int]:
    """Tasks in which the second arm differs significantly, and whether it gained (1) or lost (-1)."""
    adjusted = holm({task: exact_mcnemar(made) for task, made in pairs.items()})
    sure = [task for task, p in adjusted.items() if p < SURE]
    return {task: 1 if (wl := won_and_lost(pairs[task]))[0] > wl[1] else -1 for task in sure}


def effect(by_task: Mapping[str, Sequence[Pair]]) -> SheetCell:
    """How much the second arm adds to the success rate, with its interval and tests."""
    if not by_task:
        return NONE
    change = pooled_difference(by_task)
    everything = [pair for pairs in by_task.values() for pair in pairs]
    (won, lost), p = won_and_lost(everything), exact_mcnemar(everything)
    sure = ", ".join(f"{task} {'+' if way > 0 else '-'}" for task, way in different(by_task).items())
    unsure = change.low <= 0 <= change.high or p >= SURE
    tone: Tone = "" if unsure else "better" if change.value > 0 else "worse"
    lines = [
        f"{change.value:+.1f} points",
        f"[{change.low:+.1f}, {change.high:+.1f}]",
        f"{won} : {lost} of {len(everything)}, p {p:.3g}",
        least(everything),
        *([sure or "no task by itself"] if len(by_task) > 1 else []),
    ]
    return SheetCell(tuple(lines), tone=tone)
