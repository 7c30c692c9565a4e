"""The table of a suite of single figures: each beside its goal and a peer's value."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from gvla2.evaluation.results import Cell


@dataclass(frozen=True)
class FigureLayout:
    """A suite whose cells are single figures: test, n, value, unit, goal, peers."""

    suite: str
    title: str
    explanation: str


@dataclass(frozen=True)
class FigureTable:
    """The figures of a suite, in the order of the table, and the runs that they come from."""

    layout: FigureLayout
    cells: tuple[Cell, ...]
    runs: tuple[int, ...]

    @property
    def title(self) -> str:
        """The suite's title."""
        return self.layout.title


MEMORY = FigureLayout(
    suite="memory",
    title="Memory",
    explanation=(
        "Each value beside its goal and a plain peer's in the same run: JSON lines scored one by one, as in the "
        "released code. Times are this machine's; unmeasured values say so."
    ),
)

TRAJECTORIES = FigureLayout(
    suite="trajectories",
    title="Published runs of software agents",
    explanation=(
        "A verifier judges runs whose outcome is known but hidden from it; a memory learns from them with those "
        "verdicts. The peer is a one-line rule on the same transcripts."
    ),
)


def make_figure_table(cells: Iterable[Cell], layout: FigureLayout) -> list[FigureTable]:
    """One table, or none for no cells; if a figure was measured twice, the later one counts."""
    latest: dict[tuple[str, ...], Cell] = {}
    for cell in sorted(cells, key=lambda cell: cell.run):
        # By the requested size: an unmeasured figure has no other.
        size = cell.notes.get("size", cell.factors.get("n"))
        latest[str(cell.factors["test"]), str(cell.factors.get("on", "")), str(size)] = cell
    kept = sorted(latest.values(), key=lambda cell: cell.notes.get("order", []))
    if not kept:
        return []
    return [FigureTable(layout, tuple(kept), tuple(sorted({cell.run for cell in kept})))]


def value_text(cell: Cell, name: str = "value") -> str:
    """A measure of a figure with its unit; "" where there is none."""
    value = cell.measures.get(name)
    if value is None:
        return ""
    digits, unit = int(cell.notes.get("digits", 2)), str(cell.notes.get("unit", ""))
    text = f"{value:,.{digits}f}" if abs(value) < 1e6 else f"{value:,.0f}"
    return f"{text}{unit}" if unit.startswith("/") else f"{text} {unit}".strip()


def goal_text(cell: Cell) -> str:
    """The goal with its direction."""
    text = value_text(cell, "goal")
    return f"{'≤' if cell.notes.get('better') == 'lower' else '≥'} {text}" if text else ""


def passed_text(cell: Cell) -> str:
    """Whether the goal is reached: yes, no, or "" for no goal."""
    return {True: "yes", False: "NO"}.get(cell.notes.get("passed"), "")  # type: ignore[arg-type]
