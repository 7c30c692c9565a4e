"""Tables of results as text: Markdown, LaTeX, and for the terminal."""

from __future__ import annotations

from collections.abc import Sequence

from gvla2.evaluation.figures import FigureTable
from gvla2.evaluation.perception.table import PerceptionTable, sheet_of_perception
from gvla2.evaluation.robot.tables import RobotTable
from gvla2.evaluation.runs import RunTable
from gvla2.evaluation.sheets import Sheet, SheetCell, SheetRow, Tone, explanations, sheet_of_figures
from gvla2.evaluation.tables import NOTABLE, Entry, Measure, Table, TableRow

NOT_MEASURED = "not measured"
FEWEST = 5
"""Least objects for an interval: a bootstrap of fewer has hardly more values than objects."""
EXPLANATION = (
    "Mean over objects ± standard deviation over seeds, if there are several; change of the mean against the first "
    "row in per cent [95 % interval, bootstrap over objects, from five objects on]; worst: the change of the object "
    "that fared worst."
)


def lines_of(entry: Entry, measure: Measure) -> list[str]:
    """An entry as up to three lines: the number, its change, the worst object."""
    if entry.mean is None:
        return [NOT_MEASURED]
    spread = "" if entry.deviation is None else f" ± {entry.deviation:.{measure.digits}f}"
    lines = [f"{entry.mean:.{measure.digits}f}{spread}"]
    if entry.change is not None:
        change = entry.change
        interval = f" [{change.low:+.2f}, {change.high:+.2f}]" if change.count >= FEWEST else ""
        lines.append(f"{change.percent:+.2f} %{interval}")
    if entry.worst is not None:
        lines.append(f"worst {entry.worst + 0.0:+.2f} % ({entry.worst_object})")
    return lines


def heading(measure: Measure) -> str:
    """A column's heading, with an arrow in the better direction."""
    return f"{measure.title} {'↓' if measure.better == 'lower' else '↑'}"


def label(row: TableRow) -> str:
    """A row's label, with the number of cells that failed."""
    return f"{row.label} ({row.failed} failed)" if row.failed else row.label


def footnote(table: Table) -> str:
    """A table's counts and sources."""
    objects = max((row.objects for row in table.rows), default=0)
    seeds = max((row.seeds for row in table.rows), default=0)
    runs = ", ".join(map(str, table.runs))
    told = f"{objects} objects, {seeds} {'seed' if seeds == 1 else 'seeds'}; runs {runs} of the results database."
    for row in table.rows:
        for entry, measure in zip(row.entries, table.layout.measures, strict=True):
            if entry.worse:
                names = ", ".join(entry.worse)
                told += f" Made worse by more than {NOTABLE:.0f} % ({row.label}, {measure.title}): {names}."
    undone = [
        f"{row.label}: {', '.join(f'{stage} {count}' for stage, count in row.rejected.items())}"
        for row in table.rows
        if row.rejected
    ]
    return f"{told} Cells in which the views refuted a stage: {'; '.join(undone)}." if undone else told


AnyTable = Table | FigureTable | RobotTable | PerceptionTable | RunTable


def sheet_of(table: AnyTable) -> Sheet:
    """Any table as cells of text."""
    if isinstance(table, RobotTable | RunTable):
        return table.sheet
    if isinstance(table, PerceptionTable):
        return sheet_of_perception(table)
    if isinstance(table, FigureTable):
        return sheet_of_figures(table)
    measures = table.layout.measures
    return Sheet(
        table.title,
        tuple(heading(measure) for measure in measures),
        tuple(
            SheetRow(label(row), tuple(_cell(*pair) for pair in zip(row.entries, measures, strict=True)))
            for row in table.rows
        ),
        footnote(table),
        f"{EXPLANATION} {table.layout.explanation}".strip(),
    )


def _cell(entry: Entry, measure: Measure) -> SheetCell:
    tone: Tone = ""
    # Only a change whose interval leaves out zero has a colour.
    changed = entry.change
    if changed is not None and changed.count >= FEWEST and changed.low * changed.high > 0:
        gained = (changed.percent < 0) == (measure.better == "lower")
        tone = "better" if gained else "worse"
    return SheetCell(tuple(lines_of(entry, measure)), entry.mean is None, tone)


def to_markdown(tables: Sequence[AnyTable]) -> str:
    """Tables of GitHub's Markdown."""
    parts = []
    sheets = [sheet_of(table) for table in tables]
    for sheet in sheets:
        headings = ["", *sheet.headings]
        lines = [f"### {sheet.title}", "", _pipes(headings), _pipes(["---"] * len(headings))]
        lines += [_pipes([row.label, *("<br>".join(cell.lines) for cell in row.cells)]) for row in sheet.rows]
        parts.append("\n".join([*lines, "", sheet.footnote]))
    return "\n\n".join([*parts, explanations(sheets) or EXPLANATION]) + "\n"


def to_latex(tables: Sequence[AnyTable]) -> str:
    """Tables for a LaTeX document that loads ``booktabs``."""
    parts = []
    for sheet in map(sheet_of, tables):
        columns = "l" + "c" * len(sheet.headings)
        headings = ["", *(_tex(heading) for heading in sheet.headings)]
        lines = [
            r"\begin{table}[t]",
            r"\centering",
            rf"\caption{{{_tex(sheet.title)}. {_tex(sheet.footnote)} {_tex(sheet.explanation)}}}",
            rf"\begin{{tabular}}{{{columns}}}",
            r"\toprule",
            " & ".join(headings) + r" \\",
            r"\midrule",
        ]
        for row in sheet.rows:
            cells = [
                r"\shortstack{" + r" \\ ".join(_tex(line) for line in cell.lines) + "}" for cell in row.cells
            ]
            lines.append(" & ".join([_tex(row.label), *cells]) + r" \\")
        lines += [r"\bottomrule", r"\end{tabular}", r"\end{table}"]
        parts.append("\n".join(lines))
    return "\n\n".join(parts) + "\n"


def _pipes(cells: Sequence[str]) -> str:
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"


_TEX = {
    "\\": r"\textbackslash{}", "&": r"\&", "%": r"\%", "$": r"\$", "#": r"\#", "_": r"\_", "{": r"\{", "}": r"\}",
    "~": r"\textasciitilde{}", "^": r"\textasciicircum{}", "±": r"$\pm$", "↓": r"$\downarrow$", "↑": r"$\uparrow$",
    "×": r"$\times$", "³": r"$^3$", "[": "{[}",
    "≤": r"$\leq$", "≥": r"$\geq$",
}  # fmt: skip


def _tex(text: str) -> str:
    # A bracket after \\ would be read as its option.
    return "".join(_TEX.get(letter, letter) for letter in text)
