"""Tables of a sweep: of ``gvla2 run`` what varied down and tasks across, of ``gvla2 reconstruct`` measures across."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from itertools import groupby
from statistics import fmean, median

from gvla2.evaluation.comparison import (
    EFFECT,
    SATURATED,
    Measure,
    TableLayout,
    comparison_sheets,
    different,
    effect,
    pairs_by_task,
    rate,
    saturated,
)
from gvla2.evaluation.results import Cell, grouped, measured
from gvla2.evaluation.tables import NONE, Sheet, SheetCell, SheetRow, film, runs_of, text_cell
from gvla2.record.text import count

REPEATED = ("job", "seed")
"""Jobs that differ only in these are one row."""
OBJECT = ("views", "views_spec", "targets", "truth", "object")
"""Options of a reconstruction that say of what it is, and not how it is made."""

EXPLANATION = (
    "Success in per cent by the simulator's success check, with its 95 % Wilson interval; the mean is over tasks. A "
    "layout that several jobs of a row ran counts once, with its mean. An episode that nobody judged counts as a "
    "failure, also one whose planner crashed; one that could not be carried out is not counted. Where memory was "
    "unavailable, episodes ran without it. Asterisk, coloured: the task differs from the first row (exact McNemar on "
    "paired layouts, Holm over tasks, p < .05). "
    f"{SATURATED} Against the first row: {EFFECT[0].lower()}{EFFECT[1:]}"
)
FAILURES = "Episodes by kind of failure, as in result.json. Seconds and tokens of an episode are medians."
RECONSTRUCTED = TableLayout(
    title="",
    row="row",
    labels={},
    reference="",
    measures=(
        Measure("symmetric_iou", "symmetric IoU", "higher", 4),
        Measure("held_out_psnr", "PSNR dB, held out", "higher"),
        Measure("held_out_ssim", "SSIM, held out", "higher", 4),
        Measure("cd_surface", "CD surface ×10³", "lower"),
        Measure("cd_official", "CD official ×10³", "lower"),
        Measure("seconds", "seconds", "lower", 2, compared=False),
    ),
    groups=(),
    explanation="Symmetric IoU is the fit to the views that it was made of, and no measure of quality.",
)

Layout = tuple[str, str]
"""A task and the seed of its layout."""


def run_sheets(cells: Iterable[Cell]) -> list[Sheet]:
    """Success, then failures and costs, for each sweep of ``gvla2 run``; cells are episodes, or jobs that failed."""
    return [sheet for sweep in _sweeps(cells) for sheet in _pivot(sweep)]


def reconstruction_sheets(cells: Iterable[Cell]) -> list[Sheet]:
    """One table for each sweep of ``gvla2 reconstruct``; cells are reconstructions, or failed jobs."""
    return [_reconstructed(sweep) for sweep in _sweeps(cells)]


def _sweeps(cells: Iterable[Cell]) -> list[list[Cell]]:
    by_run = sorted(cells, key=lambda cell: (cell.run, int(cell.factors["job"])))
    return [list(group) for _, group in groupby(by_run, key=lambda cell: cell.run)]


def _varied(cells: Sequence[Cell]) -> list[str]:
    """The options that differ between cells, in the order in which they were given."""
    given = dict.fromkeys(name for cell in cells for name in cell.factors if name != "job")
    return [name for name in given if len(grouped(cells, name)) > 1]


def _by_row(cells: Sequence[Cell], apart: Sequence[str]) -> dict[str, list[Cell]]:
    """The cells by the values of what varied, but for the options ``apart``."""
    names = [name for name in _varied(cells) if name not in apart]
    rows: dict[str, list[Cell]] = {}
    for cell in cells:
        rows.setdefault(_label(cell, names) or "all jobs", []).append(cell)
    return rows


def _label(cell: Cell, names: Sequence[str]) -> str:
    """The name of a row or an episode: its values of these options."""
    return ", ".join(f"{name}={cell.factors.get(name, '')}" for name in names)


def _pivot(cells: list[Cell]) -> list[Sheet]:
    names = _varied(cells)
    tasks = [task for (task,) in grouped(cells, "task")]
    rows = _by_row(cells, (*REPEATED, "task"))
    rates = {label: _rates(members) for label, members in rows.items()}
    first = next(iter(rates.values()))
    several, compared = len(tasks) > 1, len(rows) > 1
    by_task = {label: [_of(own, task) for task in tasks] for label, own in rates.items()}
    headings = [
        (task if several else "success") + saturated([fmean(some) for some in outcomes if some])
        for task, outcomes in zip(tasks, zip(*by_task.values(), strict=True), strict=True)
    ]
    headings += ["mean"] if several else []
    success = []
    for label, members in rows.items():
        pairs = pairs_by_task(first, rates[label])
        sure = different(pairs)
        line = [rate(some, sure.get(task, 0)) for task, some in zip(tasks, by_task[label], strict=True)]
        if several:
            means = [fmean(some) for some in by_task[label] if some]
            line.append(text_cell(f"{100 * fmean(means):.1f}") if means else NONE)
        if compared:
            line.append(text_cell("") if rates[label] is first else effect(pairs))
        success.append(SheetRow(label + _marked(members), tuple(line)))
    shown = [name for name in names if name != "seed"] or names
    title = f"Runs: {', '.join(shown) or 'nothing'} varied"
    jobs, failed = len(grouped(cells, "job")), len(grouped([c for c in cells if c.status != "ok"], "job"))
    counts = f"{count(jobs, 'job')}{f', {failed} of them failed' if failed else ''}"
    films = [
        film(_caption(cell, names), str(cell.notes["folder"]), failed=bool(cell.notes.get("failure", True)))
        for cell in cells
        if "folder" in cell.notes
    ]
    headings += ["against the first row"] if compared else []
    return [
        Sheet(title, tuple(headings), tuple(success), counts, runs_of(cells), EXPLANATION),
        replace(_failures(rows), counts=counts, runs=runs_of(cells), films=tuple(films)),
    ]


def _rates(members: Sequence[Cell]) -> dict[Layout, float]:
    """The share of successes on each layout of a row's episodes."""
    ran = [cell for cell in members if cell.status == "ok"]
    return {
        (task, seed): fmean(float(cell.measures.get("success") or 0) for cell in some)
        for (task, seed), some in grouped(ran, "task", "seed").items()
    }


def _of(rates: Mapping[Layout, float], task: str) -> list[float]:
    """The rates of a task's layouts."""
    return [share for (name, _), share in rates.items() if name == task]


def _failures(rows: Mapping[str, Sequence[Cell]]) -> Sheet:
    """Rows as in the table of successes; kinds of failure across, then counts and costs."""
    codes = {
        label: Counter(c.notes.get("failure") for c in some if c.status == "ok")
        for label, some in rows.items()
    }
    kinds = sorted({str(code) for found in codes.values() for code in found if code})
    tokens = any(measured(some, "tokens") for some in rows.values())
    lines = []
    for label, some in rows.items():
        broken = sum(cell.status != "ok" for cell in some)
        cells = [*(text_cell(codes[label][kind]) for kind in kinds), text_cell(len(some) - broken)]
        cells += [_middle(some, "seconds", 1), *([_middle(some, "tokens", 0)] if tokens else [])]
        jobs = len(grouped(some, "job"))
        cells.append(text_cell(f"{jobs}, {broken} failed" if broken else jobs))
        lines.append(SheetRow(label, tuple(cells)))
    headings = (*kinds, "episodes", "seconds", *(["tokens"] if tokens else []), "jobs")
    return Sheet("Failures and costs", headings, tuple(lines), "", (), FAILURES)


def _middle(cells: Sequence[Cell], name: str, digits: int) -> SheetCell:
    found = measured(cells, name)
    return text_cell(f"{median(found):,.{digits}f}") if found else NONE


def _caption(cell: Cell, names: Sequence[str]) -> str:
    """What the episode was and how it ended."""
    label = _label(cell, names) or f"job {cell.factors['job']}"
    ended = cell.status if cell.status != "ok" else cell.notes.get("failure") or "succeeded"
    return f"{label}: {ended}{_marked([cell])}"


def _marked(members: Sequence[Cell]) -> str:
    """A mark behind the name of episodes in which memory was unavailable; "" for none."""
    lost = sum(bool(cell.notes.get("memory_unavailable")) for cell in members)
    return f" (memory unavailable in {lost} of {len(members)})" if lost else ""


def _reconstructed(cells: list[Cell]) -> Sheet:
    names = _varied(cells)
    rows = _by_row(cells, (*REPEATED, *OBJECT))
    named = [
        replace(cell, factors={"object": "", **cell.factors, "row": label, "seed": ""})
        for label, members in rows.items()
        for cell in members
    ]
    there = tuple(one for one in RECONSTRUCTED.measures if measured(cells, one.name))
    title = f"Reconstructions: {', '.join(names) or 'nothing'} varied"
    labels = {label: label for label in rows}
    layout = replace(RECONSTRUCTED, title=title, labels=labels, reference=next(iter(rows)), measures=there)
    (sheet,) = comparison_sheets(named, layout)
    pages = (
        film(f"{_label(c, names)}: {c.status}", str(c.notes["folder"]), failed=c.status != "ok")
        for c in cells
    )
    return replace(sheet, films=tuple(pages))
