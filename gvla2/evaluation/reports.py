"""The suites that can be reported: how each one's cells become tables, and a picture."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

from gvla2.evaluation.comparison import Measure, TableLayout, comparison_sheets, make_tables
from gvla2.evaluation.figures import figure_sheets
from gvla2.evaluation.noise_curve import noise_curve
from gvla2.evaluation.perception.table import perception_sheets
from gvla2.evaluation.results import Cell
from gvla2.evaluation.robot.learning_curve import learning_curve
from gvla2.evaluation.robot.tables import robot_sheets
from gvla2.evaluation.runs import run_sheets
from gvla2.evaluation.sheets import Sheet


def _no_curve(cells: Sequence[Cell]) -> str:
    return ""


@dataclass(frozen=True)
class SuiteReport:
    """What a report of a suite shows: its title, its tables, and a curve as SVG ("" for none)."""

    title: str
    sheets: Callable[[Sequence[Cell]], list[Sheet]]
    curve: Callable[[Sequence[Cell]], str] = _no_curve


RECONSTRUCTION = TableLayout(
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
    groups=(
        "data",
        "baseline",
        "drift",
        "prior",
        "noise",
        "axis",
        "fusion",
        "renderer",
        "branch",
        "protocol",
    ),
    explanation=(
        "Every row but the first and B has the prior that the title names; noise exact is depth ray cast from the true "
        "mesh itself, the best that a prior can be. Seeds draw the drift, the prior's noise and the "
        "order of splat's views: ± 0.00 if none of them applies. CD surface is the mean distance of surface "
        "samples, both ways, with position and scale, and never 0: the truth sampled twice lies some thousandths from "
        "itself, more with fewer samples; CD official that of all vertices, each shape scaled to its own "
        "box, which a speck beside the object stretches. Seconds are wall time: the first row's for the reconstruction "
        "of G0, any other row's only for what follows."
    ),
)
AGENTS = TableLayout(
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
    groups=("agent", "model", "verifier", "sandbox", "tasks"),
    pair="task",
)
MEMORY = (
    "Each value beside its goal and a plain peer's in the same run: JSON lines scored one by one, as in the released "
    "code. Times are this machine's; unmeasured values say so."
)
TRAJECTORIES = (
    "A verifier judges runs whose outcome is known but hidden from it; a memory learns from them with those verdicts. "
    "The peer is a one-line rule on the same transcripts."
)

REPORTS: Mapping[str, SuiteReport] = {
    "reconstruction": SuiteReport(
        RECONSTRUCTION.title,
        partial(comparison_sheets, layout=RECONSTRUCTION),
        lambda cells: noise_curve(make_tables(cells, RECONSTRUCTION)),
    ),
    "memory": SuiteReport("Memory", partial(figure_sheets, title="Memory", explanation=MEMORY)),
    "robot": SuiteReport("Robot", robot_sheets, learning_curve),
    "perception": SuiteReport("Perception", perception_sheets),
    "agents": SuiteReport(AGENTS.title, partial(comparison_sheets, layout=AGENTS)),
    "trajectories": SuiteReport(
        "Published runs of software agents",
        partial(figure_sheets, title="Published runs of software agents", explanation=TRAJECTORIES),
    ),
    "run": SuiteReport("Runs", run_sheets),
}
"""The suites by name, in the order in which a message lists them."""
