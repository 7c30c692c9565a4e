"""Tables of results as text cells, and their forms: Markdown, LaTeX, and one self-contained HTML page."""

from __future__ import annotations

import base64
import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from gvla2.evaluation.results import Cell, Run

Tone = Literal["", "better", "worse"]
NOT_MEASURED = "not measured"


@dataclass(frozen=True)
class SheetCell:
    """Lines of text, the first the most important; ``tone`` colours the second, or the only one."""

    lines: tuple[str, ...]
    none: bool = False
    tone: Tone = ""


NONE = SheetCell((NOT_MEASURED,), none=True)


def text_cell(text: object) -> SheetCell:
    """A cell of one line."""
    return SheetCell((str(text),))


@dataclass(frozen=True)
class SheetRow:
    """A labelled row."""

    label: str
    cells: tuple[SheetCell, ...]


@dataclass(frozen=True)
class Exhibit:
    """Something to look at: paths of pictures, side by side, and of the page that explains it, "" for none."""

    caption: str
    pictures: tuple[str, ...]
    page: str = ""


@dataclass(frozen=True)
class Exhibits:
    """Exhibits below a table; ``style`` is how a page lays them out."""

    heading: str
    style: Literal["pictures", "films"]
    exhibits: tuple[Exhibit, ...]


@dataclass(frozen=True)
class Sheet:
    """A table as text. ``headings`` are those of the cells, without the label's.

    ``counts`` says how much was measured in which ``runs`` of the results database; ``remarks`` follow below the
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
    stills = (f"{folder}/{name}" for name in ("episode.mp4", "before.png"))
    shown = next((path for path in stills if Path(path).is_file()), "")
    return Exhibit(caption, (shown,) if shown else (), f"{folder}/index.html")


def runs_of(cells: Iterable[Cell]) -> tuple[int, ...]:
    """The runs that cells come from."""
    return tuple(sorted({cell.run for cell in cells}))


def explanations(sheets: Sequence[Sheet]) -> str:
    """What the numbers of these sheets mean, each once."""
    return " ".join(dict.fromkeys(sheet.explanation for sheet in sheets))


def to_markdown(sheets: Sequence[Sheet]) -> str:
    """Tables of GitHub's Markdown."""
    blocks = []
    for sheet in sheets:
        headings = ["", *sheet.headings]
        lines = [f"### {sheet.title}", "", _piped(headings), _piped(["---"] * len(headings))]
        lines += [_piped([row.label, *("<br>".join(cell.lines) for cell in row.cells)]) for row in sheet.rows]
        blocks.append("\n".join([*lines, "", sheet.footnote]))
    return "\n\n".join([*blocks, explanations(sheets)]) + "\n"


def to_latex(sheets: Sequence[Sheet]) -> str:
    """Tables for a LaTeX document that loads ``booktabs``."""
    blocks = []
    for sheet in sheets:
        lines = [
            r"\begin{table}[t]",
            r"\centering",
            rf"\caption{{{_tex(f'{sheet.title}. {sheet.footnote} {sheet.explanation}')}}}",
            rf"\begin{{tabular}}{{l{'c' * len(sheet.headings)}}}",
            r"\toprule",
            " & ".join(["", *map(_tex, sheet.headings)]) + r" \\",
            r"\midrule",
        ]
        for row in sheet.rows:
            cells = [r"\shortstack{" + r" \\ ".join(map(_tex, cell.lines)) + "}" for cell in row.cells]
            lines.append(" & ".join([_tex(row.label), *cells]) + r" \\")
        blocks.append("\n".join([*lines, r"\bottomrule", r"\end{tabular}", r"\end{table}"]))
    return "\n\n".join(blocks) + "\n"


def _piped(cells: Sequence[str]) -> str:
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"


_TEX = str.maketrans(
    {
        "\\": r"\textbackslash{}", "&": r"\&", "%": r"\%", "$": r"\$", "#": r"\#", "_": r"\_", "{": r"\{", "}": r"\}",
        "~": r"\textasciitilde{}", "^": r"\textasciicircum{}", "±": r"$\pm$", "↓": r"$\downarrow$", "↑": r"$\uparrow$",
        "×": r"$\times$", "³": r"$^3$", "<": "$<$", ">": "$>$", "|": "$|$", "≤": r"$\leq$", "≥": r"$\geq$",
        "[": "{[}",  # a bracket after \\ would be read as its option
    }
)  # fmt: skip


def _tex(text: str) -> str:
    return text.translate(_TEX)


def render_report(sheets: Sequence[Sheet], runs: Sequence[Run], title: str) -> str:
    """The page: tables, pictures, and the runs that every number comes from.

    Pictures that are still on disk are embedded, films linked: they would make it hundreds of megabytes.
    """
    from jinja2 import Environment, PackageLoader, StrictUndefined

    loader = PackageLoader("gvla2.evaluation", ".")
    templates = Environment(loader=loader, autoescape=True, undefined=StrictUndefined)
    used = {number for sheet in sheets for number in sheet.runs}
    page = templates.get_template("report.html.jinja").render(
        title=title,
        explanation=explanations(sheets),
        sheets=[(sheet, _shown(sheet)) for sheet in sheets],
        runs=[(run, _versions(run)) for run in runs if run.id in used],
    )
    return f"{page}\n"


def _shown(sheet: Sheet) -> list[dict[str, Any]]:
    """The exhibits of a table; of those without a page, only the ones with a picture."""
    found = [_exhibit(exhibit) for exhibit in sheet.gallery.exhibits] if sheet.gallery else []
    return [one for one in found if one["page"] or one["sources"]]


def _exhibit(exhibit: Exhibit) -> dict[str, Any]:
    files = [Path(path) for path in exhibit.pictures if Path(path).is_file()]
    if exhibit.page:
        sources, page = [file.as_uri() for file in files], Path(exhibit.page).as_uri()
        return {"caption": exhibit.caption, "sources": sources, "page": page}
    coded = (base64.b64encode(file.read_bytes()).decode("ascii") for file in files)
    return {"caption": exhibit.caption, "sources": [f"data:image/png;base64,{c}" for c in coded], "page": ""}


def _versions(run: Run) -> str:
    try:
        return ", ".join(f"{name} {version}" for name, version in json.loads(run.versions).items())
    except json.JSONDecodeError:
        return run.versions
