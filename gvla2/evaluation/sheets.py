"""Any table of results as plain text cells, shared by Markdown, LaTeX, HTML and the terminal."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from gvla2.evaluation.results import Cell

Tone = Literal["", "better", "worse"]
NOT_MEASURED = "not measured"


@dataclass(frozen=True)
class SheetCell:
    """Lines of text, the first the most important; ``tone`` colours the second, or the only one."""

    lines: tuple[str, ...]
    none: bool = False
    tone: Tone = ""


NONE = SheetCell((NOT_MEASURED,), none=True)


@dataclass(frozen=True)
class SheetRow:
    """A labelled row."""

    label: str
    cells: tuple[SheetCell, ...]


@dataclass(frozen=True)
class Exhibit:
    """Something to look at: paths of pictures, side by side, and of the page that tells more, "" for none."""

    caption: str
    pictures: tuple[str, ...]
    page: str = ""


@dataclass(frozen=True)
class Exhibits:
    """Exhibits below a table; ``style`` is how a page lays them out."""

    heading: str
    style: Literal["pictures", "films", "overlays"]
    exhibits: tuple[Exhibit, ...]


@dataclass(frozen=True)
class Sheet:
    """A table as text. ``headings`` are those of the cells, without the label's.

    ``counts`` tells how much was measured in which ``runs`` of the results database; ``remarks`` follow below the
    table.
    """

    title: str
    headings: tuple[str, ...]
    rows: tuple[SheetRow, ...]
    counts: str
    runs: tuple[int, ...]
    explanation: str
    remarks: str = ""
    gallery: Exhibits | None = None

    @property
    def footnote(self) -> str:
        """Counts, sources and remarks."""
        sources = f"{self.counts}; runs {', '.join(map(str, self.runs))} of the results database."
        return f"{sources} {self.remarks}".strip()


def film(caption: str, folder: str) -> Exhibit:
    """The page of an episode or job, by its folder, with its film, or the picture from before it."""
    stills = (f"{folder}/{name}" for name in ("episode.gif", "before.png"))
    shown = next((path for path in stills if Path(path).is_file()), "")
    return Exhibit(caption, (shown,) if shown else (), f"{folder}/index.html")


def runs_of(cells: Iterable[Cell]) -> tuple[int, ...]:
    """The runs that cells come from."""
    return tuple(sorted({cell.run for cell in cells}))


def explanations(sheets: Sequence[Sheet]) -> str:
    """What the numbers of these sheets mean, each once."""
    return " ".join(dict.fromkeys(sheet.explanation for sheet in sheets))
