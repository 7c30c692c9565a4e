"""Tables of results: means, deviations over seeds, paired changes with their intervals, and the runs behind them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

from gvla2.evaluation.figures import MEMORY, TRAJECTORIES, FigureLayout, FigureTable, make_figure_table
from gvla2.evaluation.perception.table import (
    PERCEPTION,
    PerceptionLayout,
    PerceptionTable,
    make_perception_tables,
)
from gvla2.evaluation.results import Cell
from gvla2.evaluation.robot.tables import ROBOT, RobotLayout, RobotTable, make_robot_tables
from gvla2.evaluation.runs import RUNS, RunLayout, RunTable, make_run_tables
from gvla2.evaluation.statistics import Change, mean_and_deviation, paired_change


@dataclass(frozen=True)
class Measure:
    """A column: the measure's name, its heading, which way is better, and its decimals."""

    name: str
    title: str
    better: Literal["lower", "higher"]
    digits: int = 2
    compared: bool = True


@dataclass(frozen=True)
class TableLayout:
    """How a suite's cells become tables.

    One table for each combination of the ``groups`` factors; one row for each value of ``row`` in the order of
    ``labels``, compared with the row ``reference`` over the ``pair`` factor; deviations are over ``repeat``;
    ``explanation`` explains this suite's rows and measures.
    """

    suite: str
    title: str
    row: str
    labels: Mapping[str, str]
    reference: str
    measures: tuple[Measure, ...]
    groups: tuple[str, ...]
    pair: str = "object"
    repeat: str = "seed"
    explanation: str = ""


@dataclass(frozen=True)
class Entry:
    """One number of a table; None if not measured.

    ``mean`` over objects, then over seeds; ``deviation`` over seeds; ``change`` against the reference row, paired by
    object; ``worst`` the change in per cent of the object that fared worst, ``worst_object`` its name, and ``worse``
    all that lost more than :data:`NOTABLE` per cent. ``deviation`` is None for one seed.
    """

    mean: float | None
    deviation: float | None = None
    change: Change | None = None
    worst: float | None = None
    worst_object: str = ""
    worse: tuple[str, ...] = ()


@dataclass(frozen=True)
class TableRow:
    """A row: its label, one entry per measure, its numbers of objects and seeds, and of failed cells.

    ``rejected``: for each stage, in how many of its cells the input views refuted it ("5 of 6"), if any: rows that
    differ only in such a stage are alike.
    """

    name: str
    label: str
    entries: tuple[Entry, ...]
    objects: int
    seeds: int
    failed: int
    rejected: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Table:
    """A finished table; ``group`` names what its cells have in common, ``runs`` the runs that they come from."""

    layout: TableLayout
    group: Mapping[str, str]
    rows: tuple[TableRow, ...]
    runs: tuple[int, ...]

    @property
    def title(self) -> str:
        """The suite's title and what the cells have in common."""
        return f"{self.layout.title}: " + ", ".join(f"{name} {value}" for name, value in self.group.items())


NOTABLE = 2.0
"""Per cent of loss above which an object is named as made worse."""

RECONSTRUCTION = TableLayout(
    suite="reconstruction",
    title="Reconstruction",
    row="variant",
    labels={
        "baseline": "G0 (baseline, no prior)",
        "carving": "carving with the same prior",
        "aligned_tsdf": "aligned TSDF with the same prior",
        "a_prior_appearance": "A: prior + appearance",
        "a_soft_hull": "A: + soft hull",
        "b_axis": "B: axis only (no prior)",
        "ab_fusion": "A + B fusion",
    },
    reference="baseline",
    measures=(
        Measure("cd_surface", "CD surface ×10³", "lower"),
        Measure("cd_official", "CD official ×10³", "lower"),
        Measure("psnr", "PSNR dB", "higher"),
        Measure("ssim", "SSIM", "higher", 4),
        Measure("lpips", "LPIPS", "lower", 4),
        Measure("seconds", "seconds", "lower", 2, compared=False),
    ),
    groups=("data", "baseline", "drift", "prior", "noise", "axis", "fusion", "renderer", "mode", "compat"),
    explanation=(
        "Every row but the first and B has the prior that the title names; noise exact is depth ray cast from the true "
        "mesh itself, the best that a prior can be. Seeds draw the drift, the prior's noise and the "
        "order of splat's views: ± 0.00 if none of them applies. CD surface is the mean distance of surface "
        "samples, both ways, with position and scale; CD official that of all vertices, each shape scaled to its own "
        "box, which a speck beside the object stretches. Seconds are wall time: the first row's for the reconstruction "
        "of G0, any other row's only for what follows."
    ),
)
AGENTS = TableLayout(
    suite="agents",
    title="Software agents",
    row="memory",
    labels={
        "off": "no memory",
        "semantic": "semantic",
        "awm": "AWM",
        "reasoning_bank": "ReasoningBank",
        "synapse": "Synapse",
        "governed": "KnowledgeBank",
        "on": "KnowledgeBank",
    },
    reference="off",
    measures=(
        Measure("solved", "SR %", "higher", 1),
        Measure("steps", "AS", "lower", 1),
        Measure("agent_tokens", "agent tokens", "lower", 0),
        Measure("extra_tokens", "extra tokens", "lower", 0, compared=False),
        Measure("tokens", "tokens", "lower", 0),
        Measure("seconds", "seconds", "lower", 1),
        Measure("overhead", "memory s", "lower", 2, compared=False),
        Measure("storage_kb", "storage kB", "lower", 0, compared=False),
    ),
    groups=("agent", "model", "verifier", "tasks", "options"),
    pair="task",
)
AnyLayout = TableLayout | FigureLayout | RobotLayout | PerceptionLayout | RunLayout
LAYOUTS: Mapping[str, AnyLayout] = {
    made.suite: made for made in (RECONSTRUCTION, MEMORY, ROBOT, PERCEPTION, AGENTS, TRAJECTORIES, RUNS)
}
"""The suites that can be reported."""


def tables_of(
    cells: Iterable[Cell], layout: AnyLayout
) -> (
    Sequence[Table]
    | Sequence[FigureTable]
    | Sequence[RobotTable]
    | Sequence[PerceptionTable]
    | Sequence[RunTable]
):
    """The tables of these cells, as their suite has them."""
    if isinstance(layout, RunLayout):
        return make_run_tables(cells, layout)
    if isinstance(layout, RobotLayout):
        return make_robot_tables(cells, layout)
    if isinstance(layout, PerceptionLayout):
        return make_perception_tables(cells, layout)
    if isinstance(layout, FigureLayout):
        return make_figure_table(cells, layout)
    return make_tables(cells, layout)


def make_tables(cells: Iterable[Cell], layout: TableLayout) -> list[Table]:
    """One table per group, in order of first appearance; if equal cells were measured twice, the later counts."""
    groups: dict[tuple[str, ...], dict[tuple[str, ...], Cell]] = {}
    for cell in sorted(cells, key=lambda cell: cell.run):
        group = tuple(str(cell.factors.get(name, "")) for name in layout.groups)
        place = tuple(str(cell.factors.get(name)) for name in (layout.row, layout.pair, layout.repeat))
        groups.setdefault(group, {})[place] = cell
    tables = []
    for group, placed in groups.items():
        kept = list(placed.values())
        present = {str(cell.factors.get(layout.row)) for cell in kept}
        names = [*(n for n in layout.labels if n in present), *sorted(present - set(layout.labels))]
        by_row = {n: [c for c in kept if str(c.factors.get(layout.row)) == n] for n in names}
        reference = by_row.get(layout.reference, [])
        rows = tuple(_row(name, by_row[name], reference, layout) for name in names)
        tables.append(
            Table(
                layout,
                dict(zip(layout.groups, group, strict=True)),
                rows,
                tuple(sorted({c.run for c in kept})),
            )
        )
    return tables


def _row(name: str, cells: Sequence[Cell], reference: Sequence[Cell], layout: TableLayout) -> TableRow:
    against = [] if name == layout.reference else reference
    entries = tuple(_entry(measure, cells, against, layout) for measure in layout.measures)
    return TableRow(
        name,
        layout.labels.get(name, name),
        entries,
        len({cell.factors.get(layout.pair) for cell in cells}),
        len({cell.factors.get(layout.repeat) for cell in cells}),
        sum(cell.notes.get("status", "ok") != "ok" for cell in cells),
        _rejected(cells),
    )


def _rejected(cells: Sequence[Cell]) -> dict[str, str]:
    ran: dict[str, list[bool]] = {}
    for cell in cells:
        for told in cell.notes.get("stages", ()):
            stage, status = told.split(": ")
            ran.setdefault(stage, []).append(status == "rejected")
    return {stage: f"{sum(undone)} of {len(undone)}" for stage, undone in ran.items() if any(undone)}


def _entry(measure: Measure, cells: Sequence[Cell], reference: Sequence[Cell], layout: TableLayout) -> Entry:
    by_seed = _values(measure, cells, layout.repeat)
    if not by_seed:
        return Entry(None)
    mean, spread = mean_and_deviation([_mean(values) for values in by_seed.values()])
    deviation = spread if len(by_seed) > 1 else None  # one seed has no deviation
    ours = {pair: _mean(v) for pair, v in _values(measure, cells, layout.pair).items()}
    theirs = {pair: _mean(v) for pair, v in _values(measure, reference, layout.pair).items()}
    both = [pair for pair in ours if pair in theirs]
    if not measure.compared or not both or _mean([theirs[pair] for pair in both]) == 0:
        return Entry(mean, deviation)
    change = paired_change([theirs[pair] for pair in both], [ours[pair] for pair in both])
    sign = 1 if measure.better == "lower" else -1
    losses = {pair: sign * 100 * (ours[pair] / theirs[pair] - 1) for pair in both if theirs[pair] != 0}
    # If nothing has changed, no object is the worst.
    worst = max(losses, key=losses.__getitem__) if any(losses.values()) else None
    # The change of the measure itself, like the one of the mean: a loss of PSNR is negative.
    changed = None if worst is None else sign * losses[worst]
    return Entry(mean, deviation, change, changed, worst or "", _worse(losses))


def _worse(losses: Mapping[str, float]) -> tuple[str, ...]:
    """Objects that lost more than :data:`NOTABLE` per cent, the worst first."""
    return tuple(sorted((n for n, loss in losses.items() if loss > NOTABLE), key=lambda n: -losses[n]))


def _values(measure: Measure, cells: Sequence[Cell], by: str) -> dict[str, list[float]]:
    """Measured values grouped by a factor."""
    grouped: dict[str, list[float]] = {}
    for cell in cells:
        value = cell.measures.get(measure.name)
        if value is not None:
            grouped.setdefault(str(cell.factors.get(by)), []).append(float(value))
    return grouped


def _mean(values: Sequence[float]) -> float:
    return sum(values) / len(values)
