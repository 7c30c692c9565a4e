"""Tables on the terminal, alike in all commands."""

from __future__ import annotations

import sys
from collections.abc import Collection, Sequence
from dataclasses import dataclass

from rich.box import SIMPLE_HEAD
from rich.cells import cell_len
from rich.console import Console, Group
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from gvla2.record.text import printable

WIDTH_OF_PIPES = 200
_ROOM = 44
"""Cells that a column of sentences needs to be readable."""
_GAP = 3
"""Cells between two columns, at most."""


def console() -> Console:
    """Standard output: as wide as the terminal, or wide enough for `grep` when piped."""
    return Console(width=None if sys.stdout.isatty() else WIDTH_OF_PIPES, highlight=False)


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


@dataclass(frozen=True)
class Listing:
    """Rows that stay readable where the terminal is narrow, one cell a column; the first column holds names.

    The columns named in ``prose`` are sentences and are wrapped, the others short and stay whole.
    """

    columns: Sequence[str]
    rows: Sequence[Sequence[str]]
    prose: Collection[str] = ()
    style: str = "cyan"

    def laid_out(self, width: int) -> Table | Group:
        """As a table if that fits into ``width`` cells, else as blocks."""
        made, need = table(*self.columns, style=self.style), -_GAP
        for i, (name, column) in enumerate(zip(self.columns, made.columns, strict=True)):
            column.no_wrap = name not in self.prose
            longest = max(map(cell_len, (name, *(cells[i] for cells in self.rows))))
            need += _GAP + (longest if column.no_wrap else min(longest, _ROOM))
        for cells in self.rows:
            row(made, *cells)
        return made if need <= width else self._blocks()

    def _blocks(self) -> Group:
        """A line of the short cells, then the sentences below it, indented; each after the first with its name."""
        parts: list[Text | Padding] = []
        for cells in self.rows:
            told = [(n, printable(c)) for n, c in zip(self.columns, cells, strict=True) if c]
            short = [f"{n} {c}" for n, c in told[1:] if n not in self.prose]
            said = [(n, c) for n, c in told if n in self.prose]
            parts.append(Text("  ").join([Text(told[0][1], self.style), *map(Text, short)]))
            lines = [c if i == 0 else f"{n}: {c}" for i, (n, c) in enumerate(said)]
            parts += [Padding(Text(line), (0, 0, 0, 2), expand=False) for line in lines] + [Text()]
        return Group(*parts)
