"""Tables of results on the terminal and in files, for ``gvla2 bench`` and ``gvla2 report``."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console
from rich.text import Text

from gvla2.commands.report import FORMATS
from gvla2.commands.tables import console, row, table

if TYPE_CHECKING:
    from gvla2.evaluation.results import Cell, Run
    from gvla2.evaluation.sheets import Sheet


def publish(
    cells: Sequence[Cell],
    runs: Sequence[Run],
    suite: str,
    folder: Path,
    formats: Sequence[str] = FORMATS,
    out: Console | None = None,
) -> list[Path]:
    """Make the suite's tables of these cells in every format asked for; returns the files written into ``folder``."""
    from gvla2.evaluation.report_page import render_report
    from gvla2.evaluation.reports import REPORTS
    from gvla2.evaluation.table_formats import to_latex, to_markdown
    from gvla2.record.files import write_text

    report = REPORTS[suite]
    sheets, curve = report.sheets(cells), report.curve(cells)
    if "terminal" in formats:
        show(sheets, out or console())
    written = []
    if "markdown" in formats:
        written.append(write_text(folder / "report.md", to_markdown(sheets)))
    if "latex" in formats:
        written.append(write_text(folder / "report.tex", to_latex(sheets)))
    if curve and formats:
        written.append(write_text(folder / "curve.svg", curve))
    if "html" in formats:
        page = render_report(sheets, runs, f"gvla2: {report.title}", curve)
        written.append(write_text(folder / "index.html", page))
    return written


def show(sheets: Sequence[Sheet], out: Console) -> None:
    """Print tables, one below the other, with what their numbers mean."""
    from gvla2.evaluation.sheets import explanations

    for sheet in sheets:
        listing = table("", *sheet.headings)
        for line in sheet.rows:
            row(listing, line.label, *("\n".join(cell.lines) for cell in line.cells))
        out.print(Text(sheet.title, style="bold"), soft_wrap=True)
        out.print(listing)
        out.print(Text(sheet.footnote, style="dim"), soft_wrap=True)
        out.print()
    if sheets:
        out.print(Text(explanations(sheets), style="dim"), soft_wrap=True)
