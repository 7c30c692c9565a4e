"""Any table of results as plain text cells, shared by Markdown, LaTeX, HTML and the terminal."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from gvla2.evaluation.figures import FigureTable, goal_text, passed_text, value_text
from gvla2.evaluation.results import Cell

Tone = Literal["", "better", "worse"]


@dataclass(frozen=True)
class SheetCell:
    """Lines of text, the first the most important; ``tone`` colours the second, or the only one."""

    lines: tuple[str, ...]
    none: bool = False
    tone: Tone = ""


@dataclass(frozen=True)
class SheetRow:
    """A labelled row."""

    label: str
    cells: tuple[SheetCell, ...]


@dataclass(frozen=True)
class Sheet:
    """A table as text. ``headings`` are those of the cells, without the label's."""

    title: str
    headings: tuple[str, ...]
    rows: tuple[SheetRow, ...]
    footnote: str
    explanation: str


def sheet_of_figures(table: FigureTable) -> Sheet:
    """One row per figure."""
    headings = ("n", "value", "goal", "reached", "plain peer", "")
    rows = tuple(SheetRow(_label(cell), _figure(cell)) for cell in table.cells)
    reached = [cell.notes["passed"] for cell in table.cells if cell.notes.get("passed") is not None]
    runs = ", ".join(map(str, table.runs))
    footnote = f"{sum(reached)} of {len(reached)} goals reached; runs {runs} of the results database."
    return Sheet(table.title, headings, rows, footnote, table.layout.explanation)


def _label(cell: Cell) -> str:
    title, on = str(cell.notes.get("title", cell.factors.get("test"))), cell.factors.get("on")
    return f"{title} ({on})" if on else title


def _figure(cell: Cell) -> tuple[SheetCell, ...]:
    value, status = value_text(cell), str(cell.notes.get("status", "ok"))
    tone: dict[object, Tone] = {True: "better", False: "worse"}
    peer = value_text(cell, "peer_value")
    n = cell.factors.get("n", "")
    cells = [
        SheetCell((f"{n:,}" if isinstance(n, int) and value else "",)),
        SheetCell((value or "not measured",), none=not value),
        SheetCell((goal_text(cell),)),
        SheetCell((passed_text(cell),), tone=tone.get(cell.notes.get("passed"), "")),
        SheetCell((peer, str(cell.notes.get("peer", ""))) if peer else ("",)),
    ]
    note = str(cell.notes.get("note", "")) if status == "ok" else status.removeprefix("not measured: ")
    return (*cells, SheetCell((note,)))


def explanations(sheets: Sequence[Sheet]) -> str:
    """What the numbers of these sheets mean, each once."""
    return " ".join(dict.fromkeys(sheet.explanation for sheet in sheets))
