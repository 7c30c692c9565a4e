"""Tables of results as text cells, and their forms: Markdown, LaTeX, CSV, and one self-contained HTML page."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from gvla2.evaluation.results import Cell, Run

Tone = Literal["", "better", "worse"]


@dataclass(frozen=True)
class SheetCell:
    """Lines of text, the first the most important; ``tone`` colours the second, or the only one."""

    lines: tuple[str, ...]
    none: bool = False
    tone: Tone = ""


NONE = SheetCell(("not measured",), none=True)


def text_cell(text: object) -> SheetCell:
    """A cell of one line."""
    return SheetCell((str(text),))


@dataclass(frozen=True)
class SheetRow:
    """A labelled row."""

    label: str
    cells: tuple[SheetCell, ...]


@dataclass(frozen=True)
class Film:
    """The ``page`` of an episode or job with its ``file``, a film or the picture from before it; "" if it has none."""

    caption: str
    file: str
    page: str
    failed: bool = False


@dataclass(frozen=True)
class Sheet:
    """A table as text. ``headings`` are those of the cells, without the label's.

    ``counts`` says how much was measured in which ``runs`` of the results database.
    """

    title: str
    headings: tuple[str, ...]
    rows: tuple[SheetRow, ...]
    counts: str
    runs: tuple[int, ...]
    explanation: str
    films: tuple[Film, ...] = ()

    @property
    def footnote(self) -> str:
        """Counts and sources."""
        return f"{self.counts}; runs {', '.join(map(str, self.runs))} of the results database."


def film(caption: str, folder: str, *, failed: bool = False) -> Film:
    """The film of an episode or job by its folder."""
    stills = (Path(folder) / name for name in ("episode.mp4", "before.png"))
    shown = next((path.as_uri() for path in stills if path.is_file()), "")
    return Film(caption, shown, (Path(folder).absolute() / "index.html").as_uri(), failed)


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
        head, *lines = _lines(sheet, "<br>".join, " | ", lambda text: text.replace("|", "\\|"))
        rule = "|".join([" --- "] * (len(sheet.headings) + 1))
        table = [f"| {head} |", f"|{rule}|", *(f"| {line} |" for line in lines)]
        blocks.append("\n".join([f"### {sheet.title}", "", *table, "", sheet.footnote]))
    return "\n\n".join([*blocks, explanations(sheets)]) + "\n"


def to_latex(sheets: Sequence[Sheet]) -> str:
    """Short tables for a LaTeX document that loads ``booktabs``.

    A cell keeps its first line, and its second one small; what the numbers mean is a comment above each table.
    """
    blocks = []
    for sheet in sheets:
        head, *lines = _lines(sheet, _small, " & ", _tex)
        columns = f"l{'c' * len(sheet.headings)}"
        blocks.append(
            "\n".join(
                [
                    f"% {sheet.footnote} {sheet.explanation}",
                    rf"\begin{{table}}[t]\centering\caption{{{_tex(sheet.title)}}}",
                    rf"\begin{{tabular}}{{{columns}}}\toprule",
                    rf"{head} \\ \midrule",
                    *(rf"{line} \\" for line in lines),
                    r"\bottomrule\end{tabular}\end{table}",
                ]
            )
        )
    return "\n\n".join(["% \\usepackage{booktabs}", *blocks]) + "\n"


def _small(lines: Sequence[str]) -> str:
    """A cell of a LaTeX table."""
    return " ".join([*lines[:1], *(rf"{{\scriptsize {line}}}" for line in lines[1:2])])


def _lines(
    sheet: Sheet, joined: Callable[[list[str]], str], between: str, escaped: Callable[[str], str]
) -> list[str]:
    """The heading and the rows of a table, cells ``between`` each other, a cell's lines ``joined``."""
    rows = [["", *map(escaped, sheet.headings)]]
    for row in sheet.rows:
        cells = (joined([escaped(line) for line in cell.lines]) for cell in row.cells)
        rows.append([escaped(row.label), *cells])
    return [between.join(row) for row in rows]


_TEX = str.maketrans(
    {
        **{mark: f"\\{mark}" for mark in "&%$#_{}"},
        **{"\\": r"\textbackslash{}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}", "[": "{[}"},
        **{
            "±": r"$\pm$",
            "↓": r"$\downarrow$",
            "↑": r"$\uparrow$",
            "×": r"$\times$",
            "³": "$^3$",
            "≤": r"$\leq$",
        },
        **{mark: f"${mark}$" for mark in "<>|"},
    }
)
"""Marks that LaTeX would read as commands; a bracket after a line's end would be read as its option."""


def _tex(text: str) -> str:
    return text.translate(_TEX)


def to_csv(cells: Sequence[Cell]) -> str:
    """One line for each cell: factors, measures, kind of failure and verdict, status, and its run's folder."""
    rows = [
        {
            **cell.factors,
            **cell.measures,
            **{name: cell.notes[name] for name in ("failure", "verdict") if name in cell.notes},
            "status": cell.status,
            "folder": cell.notes.get("folder", ""),
        }
        for cell in cells
    ]
    rows = [{_text_in_csv(name): _text_in_csv(value) for name, value in row.items()} for row in rows]
    text = io.StringIO()
    table = csv.DictWriter(
        text, list(dict.fromkeys(name for row in rows for name in row)), lineterminator="\n"
    )
    table.writeheader()
    table.writerows(rows)
    return text.getvalue()


def _text_in_csv(value: Any) -> Any:
    """A value that no spreadsheet takes for a formula: a quote stands before one that would begin so."""
    if not isinstance(value, str) or not value.startswith(("=", "+", "-", "@", "\t", "\r")):
        return value
    try:
        float(value)
    except ValueError:
        return f"'{value}"
    return value


def render_report(sheets: Sequence[Sheet], runs: Sequence[Run], title: str) -> str:
    """The page: tables, links to films, and the runs that every number comes from."""
    from jinja2 import Environment, PackageLoader, StrictUndefined

    loader = PackageLoader("gvla2.evaluation", ".")
    templates = Environment(loader=loader, autoescape=True, undefined=StrictUndefined)
    used = {number for sheet in sheets for number in sheet.runs}
    page = templates.get_template("report.html.jinja").render(
        title=title,
        explanation=explanations(sheets),
        sheets=sheets,
        runs=[(run, json.loads(run.versions)) for run in runs if run.id in used],
    )
    return f"{page}\n"
