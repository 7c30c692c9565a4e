"""The table of a sweep of ``gvla2 run``: success with its interval, seconds and tokens by the varied options."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from itertools import groupby
from statistics import fmean, median

from gvla2.evaluation.results import Cell
from gvla2.evaluation.statistics import wilson_interval
from gvla2.evaluation.tables import NONE, Exhibits, Sheet, SheetCell, SheetRow, film, runs_of, text_cell
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
        film(_caption(cell, names), folder) for cell in cells if (folder := str(cell.notes.get("folder", "")))
    ]
    failed = sum(cell.status != "ok" for cell in cells)
    return Sheet(
        f"Runs{_shared(cells)}: {', '.join(names) or 'nothing'} varied",
        ("success", "strict", "episodes", "seconds", "tokens", "jobs"),
        tuple(SheetRow(label + _marked(members), _cells(members)) for label, members in rows.items()),
        count(len(cells), "job") + (f", {failed} of them failed" if failed else ""),
        runs_of(cells),
        EXPLANATION,
        gallery=Exhibits("Jobs", tuple(jobs)),
    )


def _shared(cells: Sequence[Cell]) -> str:
    """What all jobs ran with."""
    settings = [setting for cell in cells if (setting := cell.notes.get("setting"))]
    shared = set.intersection(*(set(setting.items()) for setting in settings)) if settings else set()
    common = [
        f"{kind} {what}" for kind, what in (settings[0].items() if settings else ()) if (kind, what) in shared
    ]
    return f" ({', '.join(common)})" if common else ""


def _caption(cell: Cell, names: Sequence[str]) -> str:
    label = label_of(cell.factors, names) or f"job {cell.factors['job']}"
    if cell.status != "ok":
        return f"{label}: {cell.notes.get('status')}"
    return f"{label}: {cell.measures['succeeded']:.0f} of {cell.measures['episodes']:.0f}{_marked([cell])}"


def _marked(members: Sequence[Cell]) -> str:
    """A mark behind the name of jobs with episodes in which memory was unavailable; "" for none."""
    well = [cell for cell in members if cell.status == "ok"]
    lost = int(sum(cell.measures.get("memory_unavailable") or 0 for cell in well))
    episodes = int(sum(cell.measures["episodes"] or 0 for cell in well))
    return f" (memory unavailable in {lost} of {episodes})" if lost else ""


def _cells(members: Sequence[Cell]) -> tuple[SheetCell, ...]:
    well = [cell for cell in members if cell.status == "ok"]
    failed = len(members) - len(well)
    count = f"{len(members)}, {failed} failed" if failed else str(len(members))
    if not well:
        return NONE, NONE, text_cell(0), NONE, NONE, text_cell(count)
    episodes = int(sum(cell.measures["episodes"] or 0 for cell in well))
    layouts = _by_layout(well)
    distinct = len(layouts) or episodes
    return (
        _success(well, "succeeded", episodes, [relaxed for relaxed, _ in layouts.values()]),
        _success(well, "succeeded_strict", episodes, [strict for _, strict in layouts.values()]),
        text_cell(str(episodes) if distinct == episodes else f"{episodes} of {distinct} layouts"),
        text_cell(f"{median(cell.measures['seconds'] or 0 for cell in well):.1f}"),
        text_cell(f"{median(cell.measures['tokens'] or 0 for cell in well):,.0f}"),
        text_cell(count),
    )


def _by_layout(cells: Sequence[Cell]) -> dict[int, tuple[float, float]]:
    """The success rates of each layout, by both rules; empty for jobs without them."""
    found: dict[int, list[tuple[float, float]]] = {}
    for cell in cells:
        for seed, relaxed, strict in cell.notes.get("layouts") or ():
            found.setdefault(seed, []).append((float(relaxed), float(strict)))
    return {seed: (fmean(r for r, _ in some), fmean(s for _, s in some)) for seed, some in found.items()}


def _success(cells: Sequence[Cell], measure: str, episodes: int, rates: Sequence[float]) -> SheetCell:
    """The share of the episodes; its interval over layouts, each with its rate, where these are known."""
    reached = sum(cell.measures[measure] or 0 for cell in cells)
    if not episodes:
        return NONE
    low, high = wilson_interval(sum(rates), len(rates)) if rates else wilson_interval(reached, episodes)
    return SheetCell((f"{100 * reached / episodes:.0f}", f"[{100 * low:.0f}, {100 * high:.0f}]"))
