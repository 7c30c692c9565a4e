"""Tables of results as text: Markdown and LaTeX."""

from __future__ import annotations

from collections.abc import Sequence

from gvla2.evaluation.sheets import Sheet, explanations


def to_markdown(sheets: Sequence[Sheet]) -> str:
    """Tables of GitHub's Markdown."""
    parts = []
    for sheet in sheets:
        headings = ["", *sheet.headings]
        lines = [f"### {sheet.title}", "", _pipes(headings), _pipes(["---"] * len(headings))]
        lines += [_pipes([row.label, *("<br>".join(cell.lines) for cell in row.cells)]) for row in sheet.rows]
        parts.append("\n".join([*lines, "", sheet.footnote]))
    return "\n\n".join([*parts, explanations(sheets)]) + "\n"


def to_latex(sheets: Sequence[Sheet]) -> str:
    """Tables for a LaTeX document that loads ``booktabs``."""
    parts = []
    for sheet in sheets:
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
    "<": "$<$", ">": "$>$", "|": "$|$", "≤": r"$\leq$", "≥": r"$\geq$",
}  # fmt: skip


def _tex(text: str) -> str:
    # A bracket after \\ would be read as its option.
    return "".join(_TEX.get(letter, letter) for letter in text)
