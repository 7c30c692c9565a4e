"""The suite ``trajectories``: a verifier and a memory on runs that others have published, with their known outcomes.

The verifier judges a sample of the runs, a memory learns from them with those verdicts, and is asked about other runs'
tasks. The peer is a one-line rule: the fewer complaints in the last tenth of a run's transcript, the better.
"""

from __future__ import annotations

import random
import tempfile
import time
from collections.abc import Sequence
from contextlib import closing
from dataclasses import dataclass
from statistics import fmean
from typing import Any, Literal

from gvla2.agents.folders import Trial, read_trials
from gvla2.errors import ConfigurationError
from gvla2.evaluation.arms import BenchArm, chosen_memory
from gvla2.evaluation.components import configured
from gvla2.evaluation.config import TrajectoriesBench
from gvla2.evaluation.engine import Rows, Suite, Unit
from gvla2.evaluation.results import Cell, cell_key, code_digest, latest, versions
from gvla2.evaluation.statistics import auc, auc_interval, calibration_error
from gvla2.evaluation.tables import NONE, Sheet, SheetCell, SheetRow, runs_of, text_cell
from gvla2.memory.asking import verdict_of
from gvla2.memory.contracts import Evidence, MemoryEpisode, MemoryTask, Verdict
from gvla2.plugins.registry import Registry

VERSION = 1
MEASURING_CODE = (
    "gvla2.agents.folders",
    "gvla2.evaluation.suites.trajectories",
    "gvla2.memory",
    "gvla2.language",
)
ARM = BenchArm("governed", "governed")
EXPLANATION = (
    "A verifier judges runs whose outcome is known but hidden from it; a memory learns from them with those verdicts. "
    "The peer is a one-line rule on the same transcripts."
)


@dataclass(frozen=True)
class Figure:
    """A row of the table: its name, title, unit, which way is better, and its decimals."""

    name: str
    title: str
    unit: str
    better: Literal["lower", "higher"]
    digits: int = 2


FIGURES = (
    Figure("auc", "Verifier: AUC against the known outcomes", "", "higher", digits=3),
    Figure("judged", "Verifier: runs that it could judge", "%", "higher", digits=1),
    Figure("calibration", "Verifier: expected calibration error", "", "lower", digits=3),
    Figure("tokens", "Verifier: tokens a run", "", "lower", digits=0),
    Figure("seconds", "Verifier: seconds a run", "s", "lower"),
    Figure("kept", "Memory: lessons active a run", "", "higher"),
    Figure("provisional", "Memory: lessons provisional a run", "", "lower"),
    Figure("false", "Memory: active hints of runs that had failed", "%", "lower", digits=1),
    Figure("advised", "Memory: next tasks that get advice", "%", "higher", digits=1),
)


@dataclass(frozen=True)
class TrialsUnit(Unit):
    """The chosen runs, with a key for each figure."""

    trials: Sequence[Trial]
    config: TrajectoriesBench


class TrajectoriesSuite(Suite[TrajectoriesBench, TrialsUnit]):
    """All figures of one sample of runs."""

    name = "trajectories"
    title = "Published runs of software agents"
    in_process = True

    @property
    def data(self) -> str:
        """Runs that others have published."""
        return "published runs"

    def stages(self) -> Sequence[Sequence[TrialsUnit]]:
        """One unit: the sample."""
        config, registry = self.config, self.registry
        if not config.agents.trajectories:
            raise ConfigurationError(
                "agents.trajectories is not set: give a folder with Terminal-Bench's trials or mini-swe-agent's "
                "trajectories and their report."
            )
        trials = read_trials(config.agents.trajectories)
        chosen = random.Random(config.seeds[0]).sample(trials, min(config.agents.most, len(trials)))
        root = chosen_memory(config, registry, ARM, ":memory:")
        options = [str(one) for one in configured(registry, root, ("verifier", "inducer"))]
        around = (VERSION, code_digest(MEASURING_CODE), versions(), options, [trial.id for trial in chosen])
        keys = tuple(cell_key(self.name, figure.name, *around) for figure in FIGURES)
        return [[TrialsUnit(keys, f"{len(chosen)} runs", chosen, config)]]

    def known(self, units: Sequence[TrialsUnit]) -> Rows:
        """All stored rows: a figure that cannot be computed is not measured again."""
        return self.bench.results.with_keys(units[0].keys)

    @staticmethod
    def measure(unit: TrialsUnit, registry: Registry) -> list[Cell]:
        """Every figure."""
        with tempfile.TemporaryDirectory(prefix="gvla2-bench-") as place:
            root = chosen_memory(unit.config, registry, ARM, f"{place}/memory.db")
            built = registry.build_all(root, ("verifier", "memory"))
            with closing(built["memory"]):
                return _cells(unit, built["verifier"], built["memory"])

    @staticmethod
    def sheets(cells: Sequence[Cell]) -> list[Sheet]:
        """One row per figure."""
        order = {figure.name: place for place, figure in enumerate(FIGURES)}
        once = sorted(
            latest(cells, lambda cell: cell.texts("test", "n")), key=lambda c: order[str(c.factors["test"])]
        )
        rows = tuple(SheetRow(FIGURES[order[str(cell.factors["test"])]].title, _row(cell)) for cell in once)
        runs = f"{max(int(cell.factors['n']) for cell in once)} runs"
        title = TrajectoriesSuite.title
        return [Sheet(title, ("n", "value", "plain rule", ""), rows, runs, runs_of(once), EXPLANATION)]


def _row(cell: Cell) -> tuple[SheetCell, ...]:
    figure = next(one for one in FIGURES if one.name == cell.factors["test"])

    def text(measure: str) -> str:
        value = cell.measures.get(measure)
        return "" if value is None else f"{value:,.{figure.digits}f} {figure.unit}".strip()

    note = cell.notes.get("note", "") if cell.status == "ok" else cell.status.removeprefix("not measured: ")
    value = text_cell(text("value")) if text("value") else NONE
    return text_cell(cell.factors["n"]), value, text_cell(text("peer_value")), text_cell(note)


def _cells(unit: TrialsUnit, verifier: Any, memory: Any) -> list[Cell]:
    trials, verdicts, many = unit.trials, list[Verdict](), len(unit.trials)
    kept = provisional = false = advised = 0
    seconds = 0.0
    for trial in trials:
        task = MemoryTask(query=trial.instruction)
        advised += bool(memory.recall(task).text)  # before the run itself is learnt from
        began = time.monotonic()
        facts = {"exit_status": trial.exit_status} if trial.exit_status else {}
        verdict = verdict_of(verifier, Evidence(trial.instruction, trial.account, facts))
        seconds += time.monotonic() - began
        verdicts.append(verdict)
        learned = memory.learn(MemoryEpisode(task, (), trial.account, source=trial.id, facts=facts), verdict)
        active = len(learned.added) + len(learned.merged)
        kept, provisional = kept + active, provisional + len(learned.provisional)
        false += active if verdict.outcome == "verified_success" and not trial.resolved else 0
    able = [place for place, verdict in enumerate(verdicts) if verdict.outcome != "unavailable"]
    if verdicts and not able:
        why = "; ".join(verdicts[0].reasons)
        raise ConfigurationError(f"The verifier judged none of the runs: {why} Try verifier=exit_status.")
    truths = [trial.resolved for trial in trials]
    # Half a success where it could not be judged.
    scores = [0.5 if verdict.outcome == "unavailable" else verdict.quality for verdict in verdicts]
    plain = [plain_score(trial.account) for trial in trials]
    bounds = auc_interval(scores, truths, [trial.task for trial in trials])
    interval = f"95 % interval over tasks {bounds[0]:.3f} to {bounds[1]:.3f}; " if bounds else ""
    tokens = sum(v for one in verdicts for name, v in one.usage.items() if name.endswith("_tokens"))
    calibration = calibration_error([scores[i] for i in able], [truths[i] for i in able])
    values: dict[str, tuple[float | None, float | None, str]] = {
        "auc": (
            auc(scores, truths),
            auc(plain, truths),
            f"{interval}verifier {unit.config.verifier.name}; peer: complaints in the last tenth of the transcript",
        ),
        "judged": (100 * len(able) / many, 100.0, ""),
        "calibration": (
            calibration,
            calibration_error(plain, truths),
            f"{100 * fmean(truths):.0f} % of the runs had succeeded",
        ),
        "tokens": (tokens / many, 0.0, ""),
        "seconds": (seconds / many, None, "on this machine, beside its other work"),
        "kept": (kept / many, None, ""),
        "provisional": (provisional / many, None, ""),
        "false": (100 * false / kept if kept else None, None, "hints believed of runs whose tests failed"),
        "advised": (100 * advised / many, None, "asked before the run itself was learnt from"),
    }
    cells = []
    for key, figure in zip(unit.keys, FIGURES, strict=True):
        value, peer, note = values[figure.name]
        status = "ok" if value is not None else "not measured: nothing to compute it from"
        factors: dict[str, str | int] = {"test": figure.name, "n": many, "on": "published runs"}
        notes = {"status": status, "note": note, "title": figure.title, "unit": figure.unit}
        cells.append(Cell(key, factors, {"value": value, "peer_value": peer}, notes))
    return cells


def plain_score(account: str) -> float:
    """A one-line baseline: 1 minus the share of complaining lines in the transcript's last tenth."""
    lines = account.splitlines()
    last = lines[-max(20, len(lines) // 10) :]
    words = ("error", "traceback", "failed", "exception", "not found", "no such")
    complaints = sum(any(word in line.lower() for word in words) for line in last)
    return 1.0 - complaints / max(1, len(last))
