"""Tables of results on the terminal and in files, for ``gvla2 bench`` and ``gvla2 report``."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console
from rich.text import Text

from gvla2.commands.tables import console, row, table

if TYPE_CHECKING:
    from gvla2.evaluation.results import Cell, Run
    from gvla2.evaluation.tables import Layout, Table

FORMATS = ("terminal", "markdown", "latex", "html")


def publish(
    cells: Sequence[Cell],
    runs: Sequence[Run],
    layout: Layout,
    folder: Path,
    formats: Sequence[str] = FORMATS,
    out: Console | None = None,
) -> list[Path]:
    """Make the tables of these cells in every format asked for; returns the files written into ``folder``."""
    from gvla2.evaluation.report_page import render_report
    from gvla2.evaluation.table_formats import to_latex, to_markdown
    from gvla2.evaluation.tables import make_tables
    from gvla2.record.files import write_text

    tables = make_tables(cells, layout)
    if "terminal" in formats:
        show(tables, out or console())
    written = []
    if "markdown" in formats:
        written.append(write_text(folder / "report.md", to_markdown(tables)))
    if "latex" in formats:
        written.append(write_text(folder / "report.tex", to_latex(tables)))
    if "html" in formats:
        page = render_report(tables, cells, runs, f"gvla2: {layout.title}")
        written.append(write_text(folder / "index.html", page))
    return written


def show(tables: Sequence[Table], out: Console) -> None:
    """Print tables, one below the other, with what their numbers mean."""
    from gvla2.evaluation.table_formats import EXPLANATION, footnote, heading, label, lines_of

    for made in tables:
        listing = table("", *(heading(measure) for measure in made.layout.measures))
        for line in made.rows:
            pairs = zip(line.entries, made.layout.measures, strict=True)
            row(listing, label(line), *("\n".join(lines_of(*pair)) for pair in pairs))
        out.print(Text(made.title, style="bold"), soft_wrap=True)
        out.print(listing)
        out.print(Text(footnote(made), style="dim"), soft_wrap=True)
        out.print()
    if tables:
        out.print(Text(EXPLANATION, style="dim"), soft_wrap=True)
