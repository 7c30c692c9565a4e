"""Tables on the terminal, alike in all commands."""

from __future__ import annotations

import sys

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table
from rich.text import Text

from gvla2.record.text import printable

WIDTH_OF_PIPES = 200


class _Console(Console):
    """Leaves a reader that went away (`gvla2 run --help | head`) to the command line, where Rich would exit with 1."""

    def on_broken_pipe(self) -> None:
        raise BrokenPipeError


def console() -> Console:
    """Standard output: as wide as the terminal, or wide enough for `grep` when piped."""
    return _Console(width=None if sys.stdout.isatty() else WIDTH_OF_PIPES, highlight=False)


def table(first: str, *columns: str, style: str = "cyan") -> Table:
    """An empty table; the first column holds names, which are never broken."""
    made = Table(box=SIMPLE_HEAD, title_justify="left", pad_edge=False, header_style="bold")
    made.add_column(first, style=style, no_wrap=True)
    for column in columns:
        made.add_column(column, overflow="fold")
    return made


def row(listing: Table, *cells: str) -> None:
    """Add a row of plain text: markup in it is escaped, and control characters are removed."""
    listing.add_row(*(Text(printable(cell)) for cell in cells))
