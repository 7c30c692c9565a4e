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
    from gvla2.evaluation.table_formats import AnyTable
    from gvla2.evaluation.tables import AnyLayout


def publish(
    cells: Sequence[Cell],
    runs: Sequence[Run],
    layout: AnyLayout,
    folder: Path,
    formats: Sequence[str] = FORMATS,
    out: Console | None = None,
) -> list[Path]:
    """Make the tables of these cells in every format asked for; returns the files written into ``folder``."""
    from gvla2.evaluation.noise_curve import noise_curve
    from gvla2.evaluation.report_page import render_report
    from gvla2.evaluation.robot.learning_curve import learning_curve
    from gvla2.evaluation.table_formats import to_latex, to_markdown
    from gvla2.evaluation.tables import Table, tables_of
    from gvla2.record.files import write_text

    tables = tables_of(cells, layout)
    if "terminal" in formats:
        show(tables, out or console())
    written = []
    if "markdown" in formats:
        written.append(write_text(folder / "report.md", to_markdown(tables)))
    if "latex" in formats:
        written.append(write_text(folder / "report.tex", to_latex(tables)))
    curve = noise_curve([table for table in tables if isinstance(table, Table)]) or learning_curve(cells)
    if curve and formats:
        written.append(write_text(folder / "curve.svg", curve))
    if "html" in formats:
        page = render_report(tables, cells, runs, f"gvla2: {layout.title}", curve)
        written.append(write_text(folder / "index.html", page))
    return written


def show(tables: Sequence[AnyTable], out: Console) -> None:
    """Print tables, one below the other, with what their numbers mean."""
    from gvla2.evaluation.sheets import explanations
    from gvla2.evaluation.table_formats import sheet_of

    sheets = [sheet_of(table) for table in tables]
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
