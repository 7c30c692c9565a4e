"""The table of a sweep of ``gvla2 run``: success with its interval, seconds and tokens by the varied options."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from itertools import groupby
from statistics import fmean, median

from gvla2.evaluation.results import Cell, measured
from gvla2.evaluation.statistics import wilson_interval
from gvla2.evaluation.tables import NONE, Sheet, SheetCell, SheetRow, film, runs_of, text_cell
from gvla2.record.text import count

SUITE = "run"
REPEATED = "seed"
"""Jobs that differ only in this are one row."""

EXPLANATION = (
    "Success in per cent of the episodes by the simulator's success check, with its 95 % Wilson interval; an unjudged "
    "episode counts as a failure, also one whose planner crashed; one that could not be carried out is not counted. "
    "Where memory was unavailable, episodes ran without it. A layout that several jobs of a row ran counts once in the "
    "interval. Seconds and tokens are medians over jobs, a job's episodes taken together."
)


def run_sheets(cells: Iterable[Cell]) -> list[Sheet]:
    """One table per sweep; cells are jobs, with the overrides as factors."""
    by_run = sorted(cells, key=lambda cell: (cell.run, int(cell.factors["job"])))
    return [_sheet(list(group)) for _, group in groupby(by_run, key=lambda cell: cell.run)]


def varied(factors: Sequence[Mapping[str, str | int]]) -> list[str]:
    """The names of options that vary over the jobs, in the given order."""
    names = dict.fromkeys(name for each in factors for name in each if name != "job")
    return [name for name in names if len({str(each.get(name, "")) for each in factors}) > 1]


def label_of(factors: Mapping[str, str | int], names: Sequence[str]) -> str:
    """The name of a job or row: its values of the varied options."""
    return ", ".join(f"{name}={factors.get(name, '')}" for name in names)


def _sheet(cells: list[Cell]) -> Sheet:
    names = varied([cell.factors for cell in cells])
    rows: dict[str, list[Cell]] = {}
    for cell in cells:
        label = label_of(cell.factors, [name for name in names if name != REPEATED]) or "all jobs"
        rows.setdefault(label, []).append(cell)
    jobs = [
        film(_caption(cell, names), str(cell.notes["folder"])) for cell in cells if cell.notes.get("folder")
    ]
    failed = sum(cell.status != "ok" for cell in cells)
    return Sheet(
        f"Runs: {', '.join(names) or 'nothing'} varied",
        ("success", "strict", "episodes", "seconds", "tokens", "jobs"),
        tuple(SheetRow(label + _marked(members), _cells(members)) for label, members in rows.items()),
        count(len(cells), "job") + (f", {failed} of them failed" if failed else ""),
        runs_of(cells),
        EXPLANATION,
        tuple(jobs),
    )


def _caption(cell: Cell, names: Sequence[str]) -> str:
    label = label_of(cell.factors, names) or f"job {cell.factors['job']}"
    if cell.status != "ok":
        return f"{label}: {cell.status}"
    return f"{label}: {cell.measures['succeeded']:.0f} of {cell.measures['episodes']:.0f}{_marked([cell])}"


def _marked(members: Sequence[Cell]) -> str:
    """A mark behind the name of jobs with episodes in which memory was unavailable; "" for none."""
    well = [cell for cell in members if cell.status == "ok"]
    lost, episodes = sum(measured(well, "memory_unavailable")), sum(measured(well, "episodes"))
    return f" (memory unavailable in {lost:.0f} of {episodes:.0f})" if lost else ""


def _cells(members: Sequence[Cell]) -> tuple[SheetCell, ...]:
    well = [cell for cell in members if cell.status == "ok"]
    failed = len(members) - len(well)
    jobs = text_cell(f"{len(members)}, {failed} failed" if failed else len(members))
    if not well:
        return NONE, NONE, text_cell(0), NONE, NONE, jobs
    episodes = int(sum(measured(well, "episodes")))
    by_layout: dict[int, list[tuple[float, float]]] = {}
    for seed, relaxed, strict in (one for cell in well for one in cell.notes.get("layouts") or ()):
        by_layout.setdefault(seed, []).append((float(relaxed), float(strict)))
    rates = [tuple(map(fmean, zip(*some, strict=True))) for some in by_layout.values()]
    distinct = len(rates) or episodes
    return (
        _success(well, "succeeded", episodes, [rate[0] for rate in rates]),
        _success(well, "succeeded_strict", episodes, [rate[1] for rate in rates]),
        text_cell(episodes if distinct == episodes else f"{episodes} of {distinct} layouts"),
        text_cell(f"{median(measured(well, 'seconds')):.1f}"),
        text_cell(f"{median(measured(well, 'tokens')):,.0f}"),
        jobs,
    )


def _success(cells: Sequence[Cell], measure: str, episodes: int, rates: Sequence[float]) -> SheetCell:
    """The share of the episodes; its interval over layouts, each with its rate, where these are known."""
    reached = sum(measured(cells, measure))
    if not episodes:
        return NONE
    low, high = wilson_interval(sum(rates), len(rates)) if rates else wilson_interval(reached, episodes)
    return SheetCell((f"{100 * reached / episodes:.0f}", f"[{100 * low:.0f}, {100 * high:.0f}]"))
