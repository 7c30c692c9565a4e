"""The table of a sweep of ``gvla2 run``: success with its interval, seconds and tokens by the varied options."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import groupby
from statistics import fmean, median

from gvla2.evaluation.results import Cell, grouped, measured
from gvla2.evaluation.statistics import wilson_interval
from gvla2.evaluation.tables import NONE, Sheet, SheetCell, SheetRow, film, runs_of, text_cell
from gvla2.record.text import count

SUITE = "run"
REPEATED = "seed"
"""Jobs that differ only in this are one row."""

EXPLANATION = (
    "Success in per cent by the simulator's success check, with its 95 % Wilson interval; a layout that several jobs "
    "of a row ran counts once, with its mean. An unjudged episode counts as a failure, also one whose planner crashed; "
    "one that could not be carried out is not counted. Where memory was unavailable, episodes ran without it. Seconds "
    "and tokens are medians over jobs, a job's episodes taken together."
)


def run_sheets(cells: Iterable[Cell]) -> list[Sheet]:
    """One table per sweep; cells are jobs, with the overrides as factors and each episode's success in their notes."""
    by_run = sorted(cells, key=lambda cell: (cell.run, int(cell.factors["job"])))
    return [_sheet(list(group)) for _, group in groupby(by_run, key=lambda cell: cell.run)]


def _sheet(cells: list[Cell]) -> Sheet:
    given = dict.fromkeys(name for cell in cells for name in cell.factors if name != "job")
    names = [name for name in given if len(grouped(cells, name)) > 1]
    rows: dict[str, list[Cell]] = {}
    for cell in cells:
        label = _label(cell, [name for name in names if name != REPEATED]) or "all jobs"
        rows.setdefault(label, []).append(cell)
    folders = [(cell, cell.notes.get("folder")) for cell in cells]
    failed = sum(cell.status != "ok" for cell in cells)
    return Sheet(
        f"Runs: {', '.join(names) or 'nothing'} varied",
        ("success", "strict", "episodes", "seconds", "tokens", "jobs"),
        tuple(SheetRow(label + _marked(members), _cells(members)) for label, members in rows.items()),
        count(len(cells), "job") + (f", {failed} of them failed" if failed else ""),
        runs_of(cells),
        EXPLANATION,
        tuple(film(_caption(cell, names), str(folder)) for cell, folder in folders if folder),
    )


def _label(cell: Cell, names: Sequence[str]) -> str:
    """The name of a job or row: its values of these options."""
    return ", ".join(f"{name}={cell.factors.get(name, '')}" for name in names)


def _caption(cell: Cell, names: Sequence[str]) -> str:
    label = _label(cell, names) or f"job {cell.factors['job']}"
    if cell.status != "ok":
        return f"{label}: {cell.status}"
    return f"{label}: {cell.measures['succeeded']:.0f} of {cell.measures['episodes']:.0f}{_marked([cell])}"


def _marked(members: Sequence[Cell]) -> str:
    """A mark behind the name of jobs with episodes in which memory was unavailable; "" for none."""
    lost, episodes = (sum(measured(members, name)) for name in ("memory_unavailable", "episodes"))
    return f" (memory unavailable in {lost:.0f} of {episodes:.0f})" if lost else ""


def _cells(members: Sequence[Cell]) -> tuple[SheetCell, ...]:
    well = [cell for cell in members if cell.status == "ok"]
    failed = len(members) - len(well)
    jobs = text_cell(f"{len(members)}, {failed} failed" if failed else len(members))
    if not well:
        return NONE, NONE, text_cell(0), NONE, NONE, jobs
    by_layout: dict[int, list[tuple[float, float]]] = {}
    for seed, relaxed, strict in (episode for cell in well for episode in cell.notes.get("layouts") or ()):
        by_layout.setdefault(seed, []).append((relaxed, strict))
    rates = [tuple(map(fmean, zip(*some, strict=True))) for some in by_layout.values()]
    episodes = sum(map(len, by_layout.values()))
    return (
        _success([relaxed for relaxed, _ in rates]),
        _success([strict for _, strict in rates]),
        text_cell(episodes if len(rates) == episodes else f"{episodes} of {len(rates)} layouts"),
        text_cell(f"{median(measured(well, 'seconds')):.1f}"),
        text_cell(f"{median(measured(well, 'tokens')):,.0f}"),
        jobs,
    )


def _success(rates: Sequence[float]) -> SheetCell:
    """The share of successes in per cent, and its interval, of the layouts' rates; earlier versions stored none."""
    if not rates:
        return NONE
    low, high = wilson_interval(sum(rates), len(rates))
    return SheetCell((f"{100 * fmean(rates):.0f}", f"[{100 * low:.0f}, {100 * high:.0f}]"))
