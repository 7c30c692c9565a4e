"""Listings that stay readable where the terminal is narrow: columns go first, then each row becomes a block."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from rich.cells import cell_len
from rich.console import Group
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from gvla2.commands.tables import row, table

_GAP = 3
"""Cells between two columns, at most."""
_ROOM = 44
"""Cells that a column of sentences needs to be read with ease."""


@dataclass(frozen=True)
class Column:
    """A column of a listing: ``prose`` is of sentences and is wrapped; the others are short and stay whole.

    Where there is too little room, columns with a rank in ``spare`` are left out, the highest first.
    """

    name: str
    prose: bool = False
    spare: int = 0


@dataclass(frozen=True)
class Listing:
    """Rows of printable text, one cell a column; the first column holds names."""

    columns: Sequence[Column]
    rows: Sequence[Sequence[str]]
    style: str = "cyan"

    def laid_out(self, width: int) -> Table | Group:
        """As a table where it fits into ``width`` cells, if need be without spare columns, else as blocks."""
        needs = [self._need(i) for i in range(len(self.columns))]
        kept = list(range(len(self.columns)))
        spare = sorted((i for i in kept if self.columns[i].spare), key=lambda i: self.columns[i].spare)
        while sum(needs[i] for i in kept) + _GAP * (len(kept) - 1) > width:
            if not spare:
                return self._blocks()
            kept.remove(spare.pop())
        return self._table(kept)

    def _need(self, i: int) -> int:
        """How many cells a column cannot do without."""
        longest = max(cell_len(text) for text in (self.columns[i].name, *(cells[i] for cells in self.rows)))
        return min(longest, _ROOM) if self.columns[i].prose else longest

    def _table(self, kept: Sequence[int]) -> Table:
        first, *others = (self.columns[i] for i in kept)
        made = table(first.name, *(column.name for column in others), style=self.style)
        for place, column in enumerate(others, 1):
            made.columns[place].no_wrap = not column.prose
        for cells in self.rows:
            row(made, *(cells[i] for i in kept))
        return made

    def _blocks(self) -> Group:
        """A line of the short cells, then the sentences below it, indented; each after the first with its name."""
        parts: list[Text | Padding] = []
        for cells in self.rows:
            line, sentences = Text(), 0
            parts.append(line)
            for i, (column, cell) in enumerate(zip(self.columns, cells, strict=True)):
                if column.prose:
                    said = Text(f"{column.name}: {cell}" if sentences else cell)
                    sentences += 1
                    parts += [Padding(said, (0, 0, 0, 2), expand=False)] if cell else []
                    continue
                if sentences:  # they stand between: the line begins anew
                    line, sentences = Text(), 0
                    parts.append(line)
                anew = i > 0 and not line
                label = f"{column.name} " if anew or not cell[:1].isalpha() else ""
                line.append("  " if line else "").append(f"{label}{cell}", style="" if i else self.style)
            parts.append(Text())
        return Group(*parts)
