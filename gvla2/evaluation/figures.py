"""The table of a suite of single figures: each beside its goal and a peer's value."""

from __future__ import annotations

from collections.abc import Iterable

from gvla2.evaluation.results import Cell, latest
from gvla2.evaluation.sheets import NONE, Sheet, SheetCell, SheetRow, Tone, runs_of

HEADINGS = ("n", "value", "goal", "reached", "plain peer", "")


def figure_sheets(cells: Iterable[Cell], title: str, explanation: str) -> list[Sheet]:
    """One table with a row per figure, in the order of the suite; none for no cells."""
    # By the requested size: an unmeasured figure has no other.
    once = latest(cells, lambda c: (*c.told("test", "on"), str(c.notes.get("size", c.factors.get("n")))))
    kept = sorted(once, key=lambda cell: cell.notes.get("order", []))
    if not kept:
        return []
    rows = tuple(SheetRow(_label(cell), _figure(cell)) for cell in kept)
    reached = [cell.notes["passed"] for cell in kept if cell.notes.get("passed") is not None]
    counts = f"{sum(reached)} of {len(reached)} goals reached"
    return [Sheet(title, HEADINGS, rows, counts, runs_of(kept), explanation)]


def _label(cell: Cell) -> str:
    title, on = str(cell.notes.get("title", cell.factors.get("test"))), cell.factors.get("on")
    return f"{title} ({on})" if on else title


def _figure(cell: Cell) -> tuple[SheetCell, ...]:
    value, goal, peer = (_text(cell, name) for name in ("value", "goal", "peer_value"))
    status, n = str(cell.notes.get("status", "ok")), cell.factors.get("n", "")
    better = "≤" if cell.notes.get("better") == "lower" else "≥"
    outcomes: dict[object, tuple[str, Tone]] = {True: ("yes", "better"), False: ("NO", "worse")}
    reached, tone = outcomes.get(cell.notes.get("passed"), ("", ""))
    return (
        SheetCell((f"{n:,}" if isinstance(n, int) and value else "",)),
        SheetCell((value,)) if value else NONE,
        SheetCell((f"{better} {goal}" if goal else "",)),
        SheetCell((reached,), tone=tone),
        SheetCell((peer, str(cell.notes.get("peer", ""))) if peer else ("",)),
        SheetCell(
            (str(cell.notes.get("note", "")) if status == "ok" else status.removeprefix("not measured: "),)
        ),
    )


def _text(cell: Cell, name: str) -> str:
    """A measure of a figure with its unit; "" where there is none."""
    value = cell.measures.get(name)
    if value is None:
        return ""
    digits, unit = int(cell.notes.get("digits", 2)), str(cell.notes.get("unit", ""))
    text = f"{value:,.{digits}f}" if abs(value) < 1e6 else f"{value:,.0f}"
    return f"{text}{unit}" if unit.startswith("/") else f"{text} {unit}".strip()
