"""``gvla2 bench trajectories``: verifier and memory on runs that others have published, with their known outcomes."""

from __future__ import annotations

import logging
import random
import tempfile
import time
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from gvla2.commands.bench_arms import BenchArm, chosen_memory, configured
from gvla2.commands.bench_frame import BenchRun
from gvla2.commands.bench_memory import figure_cell
from gvla2.errors import ConfigurationError
from gvla2.evaluation.memory.figure import Figure, FigureRow
from gvla2.evaluation.results import Cell, cell_key

if TYPE_CHECKING:
    from gvla2.agents.folders import Trial

DATA = "published runs"
SUITE = "trajectories"
VERSION = 1
MEASURING_CODE = ("gvla2.agents.folders", "gvla2.evaluation.agents", "gvla2.memory", "gvla2.language")

log = logging.getLogger(__name__)


def run(bench: BenchRun) -> list[Cell]:
    """Judge a sample of the runs, let a memory learn from them with those verdicts, and ask it about other runs' tasks.

    The plain peer is a one-line rule: the fewer complaints in the last tenth of a run's transcript, the better.
    """
    from gvla2.agents.folders import read_trials
    from gvla2.evaluation.provenance import code_digest, versions

    config, registry = bench.config, bench.registry
    if not config.agents.trajectories:
        raise ConfigurationError(
            "agents.trajectories is not set: give a folder with Terminal-Bench's trials or mini-swe-agent's "
            "trajectories and their report."
        )
    trials = read_trials(config.agents.trajectories)
    chosen = random.Random(config.seeds[0]).sample(trials, min(config.agents.most, len(trials)))
    root = chosen_memory(config, registry, BenchArm("governed", "governed"), ":memory:")
    options = [str(one) for one in configured(registry, root, ("verifier", "inducer"))]
    around = (VERSION, code_digest(MEASURING_CODE), versions(), options, [trial.id for trial in chosen])
    keys = {row.name: cell_key(SUITE, row.name, *around) for row in _ROWS}
    known = bench.known(list(keys.values()), well=False)
    if len(known) == len(keys):
        return [known[key] for key in keys.values()]
    with tempfile.TemporaryDirectory(prefix="gvla2-bench-") as place:
        root = chosen_memory(config, registry, BenchArm("governed", "governed"), f"{place}/memory.db")
        built = registry.build_all(root, ("verifier", "memory"))
        try:
            figures = _measured(chosen, built, bench)
        finally:
            built["memory"].close()
    cells = []
    for order, row in enumerate(_ROWS):
        figure, n = figures[row.name], len(chosen)
        status = "ok" if figure.value is not None else "not measured: nothing to compute it from"
        cells.append(
            figure_cell(keys[row.name], row, figure, size=n, on=DATA, order=[order, n, 0], status=status)
        )
    bench.store(cells)
    return cells


_ROWS = (
    FigureRow("auc", "Verifier: AUC against the known outcomes", "", "higher", digits=3),
    FigureRow("judged", "Verifier: runs that it could judge", "%", "higher", digits=1),
    FigureRow("calibration", "Verifier: expected calibration error", "", "lower", digits=3),
    FigureRow("tokens", "Verifier: tokens a run", "", "lower", digits=0),
    FigureRow("seconds", "Verifier: seconds a run", "s", "lower"),
    FigureRow("kept", "Memory: lessons active a run", "", "higher"),
    FigureRow("provisional", "Memory: lessons provisional a run", "", "lower"),
    FigureRow("false", "Memory: active hints of runs that had failed", "%", "lower", digits=1),
    FigureRow("told", "Memory: next tasks that get advice", "%", "higher", digits=1),
)
PEER = "plain rule"


def _measured(trials: Sequence[Trial], built: Mapping[str, Any], bench: BenchRun) -> dict[str, Figure]:
    from gvla2.evaluation.agents.discrimination import auc, auc_interval, calibration_error
    from gvla2.memory.asking import verdict_of
    from gvla2.memory.contracts import Evidence, MemoryEpisode, MemoryTask, Verdict

    memory, verdicts = built["memory"], list[Verdict]()
    kept = provisional = false = told = 0
    spent, asked = 0.0, 0
    began = time.monotonic()
    with bench.progress(len(trials)) as progress:
        for trial in trials:
            task = MemoryTask(query=trial.instruction)
            told += bool(memory.recall(task).text)
            before = time.monotonic()
            facts = {"exit_status": trial.exit_status} if trial.exit_status else {}
            verdict = verdict_of(built["verifier"], Evidence(trial.instruction, trial.account, facts))
            spent += time.monotonic() - before
            asked += int(sum(v for k, v in verdict.usage.items() if k.endswith("_tokens")))
            verdicts.append(verdict)
            learned = memory.learn(
                MemoryEpisode(task, (), trial.account, source=trial.id, facts=facts), verdict
            )
            active = len(learned.added) + len(learned.merged)
            kept, provisional = kept + active, provisional + len(learned.provisional)
            false += active if verdict.outcome == "verified_success" and not trial.resolved else 0
            progress.done(1, trial.id)
    log.info("%d runs in %.0f s", len(trials), time.monotonic() - began)
    if verdicts and all(verdict.outcome == "unavailable" for verdict in verdicts):
        why = "; ".join(verdicts[0].reasons)
        raise ConfigurationError(f"The verifier judged none of the runs: {why} Try verifier=exit_status.")
    truths = [trial.resolved for trial in trials]
    # Half a success where it could not be judged.
    scores = [0.5 if verdict.outcome == "unavailable" else verdict.quality for verdict in verdicts]
    plain = [plain_score(trial.account) for trial in trials]
    able = [place for place, verdict in enumerate(verdicts) if verdict.outcome != "unavailable"]
    bounds = auc_interval(scores, truths, [trial.task for trial in trials])
    told_of = f"95 % interval over tasks {bounds[0]:.3f} to {bounds[1]:.3f}; " if bounds else ""
    verifier = getattr(bench.config.verifier, "name", "")
    peer = f"{told_of}verifier {verifier}; peer: complaints in the last tenth of the transcript"
    sure = calibration_error([scores[i] for i in able], [truths[i] for i in able])
    succeeded = f"{100 * sum(truths) / len(truths):.0f} % of the runs had succeeded"
    many = len(trials)
    return {
        "auc": Figure(auc(scores, truths), PEER, auc(plain, truths), note=peer),
        "judged": Figure(100 * len(able) / many, PEER, 100.0),
        "calibration": Figure(sure, PEER, calibration_error(plain, truths), note=succeeded),
        "tokens": Figure(asked / many, PEER, 0.0),
        "seconds": Figure(spent / many, note="on this machine, beside its other work"),
        "kept": Figure(kept / many),
        "provisional": Figure(provisional / many),
        "false": Figure(
            100 * false / kept if kept else None, note="hints believed of runs whose tests failed"
        ),
        "told": Figure(100 * told / many, note="asked before the run itself was learnt from"),
    }


def plain_score(account: str) -> float:
    """A one-line baseline: 1 minus the share of complaining lines in the transcript's last tenth."""
    lines = account.splitlines()
    last = lines[-max(20, len(lines) // 10) :]
    words = ("error", "traceback", "failed", "exception", "not found", "no such")
    complaints = sum(any(word in line.lower() for word in words) for line in last)
    return 1.0 - complaints / max(1, len(last))
