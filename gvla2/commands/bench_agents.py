"""``gvla2 bench agents``: software agents on folders of tasks, with one memory or another."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gvla2.commands.bench_arms import arm_named, check_arms, chosen_memory, configured, has_bank
from gvla2.commands.bench_config import BenchConfig
from gvla2.commands.bench_frame import BenchRun, model_label
from gvla2.component import described
from gvla2.errors import ConfigurationError
from gvla2.evaluation.results import Cell, cell_key

if TYPE_CHECKING:
    from gvla2.agents.contracts import AgentTask, TestedSandbox
    from gvla2.commands.bench_progress import BenchProgress
    from gvla2.evaluation.agents.sequence import Crew, TaskSequence

DATA = "task folders"
SUITE = "agents"
VERSION = 1
USUAL_ARMS = ("off", "awm", "reasoning_bank", "governed")
MEASURING_CODE = ("gvla2.agents", "gvla2.evaluation.agents", "gvla2.memory", "gvla2.language")

log = logging.getLogger(__name__)


def run(bench: BenchRun) -> list[Cell]:
    """Measure what the database lacks, one sequence of tasks after another; all rows in the design's order.

    Rows are stored one by one; an interrupted sequence resumes where it was, with the memory that it had.
    """
    from gvla2.agents.folders import read_tasks

    config = bench.config
    if not config.agents.tasks:
        raise ConfigurationError(
            "agents.tasks is not set: give a folder of tasks in Terminal-Bench's layout, such as "
            "agents.tasks=examples/agent_tasks."
        )
    tasks = read_tasks(config.agents.tasks, config.agents.names)
    arms = list(dict.fromkeys([*(config.arms or USUAL_ARMS), *config.own_arms]))
    _check_arms(bench, arms)
    planned = [_sequence(bench, tasks, arm, seed) for seed in config.seeds for arm in arms]
    keys = [key for one in planned for key in one.keys]
    known = bench.known(keys, well=False)
    with bench.progress(sum(key not in known for key in keys)) as progress:
        for sequence in planned:
            _work_off(bench, sequence, known, progress)
    return [known[key] if key in known else _missing(planned, key) for key in keys]


def _check_arms(bench: BenchRun, arms: Sequence[str]) -> None:
    """Raises :class:`ConfigurationError` for arms of the robot bench that mean nothing here, or wrong options."""
    check_arms(replace(bench.config, arms=list(arms)), bench.registry)
    for arm in (arm_named(bench.config, name) for name in arms):
        if arm.source in ("shuffled", "best_theta") or (arm.replan, arm.explored) != (None, None):
            raise ConfigurationError(
                f"The arm '{arm.name}' ({arm.source}, {arm.variant or 'plain'}) is one of the robot bench: software "
                "agents have no exploration and no replanning. Arms here are memories and off."
            )


def _work_off(
    bench: BenchRun, sequence: TaskSequence, known: dict[str, Cell], progress: BenchProgress
) -> None:
    from gvla2.evaluation.agents.sequence import work

    done = 0
    while done < len(sequence.keys) and sequence.keys[done] in known:
        done += 1
    if done == len(sequence.keys):
        return
    if done and not (sequence.folder / f"after-{done}.db").is_file() and sequence.memory != "off":
        log.warning("The memory in %s is gone: its tasks are measured again.", sequence.folder)
        done = 0
    cells = work(
        sequence,
        done,
        partial(_crew, bench, sequence.memory),
        _sandboxes(bench.config),
        show_tests=getattr(bench.config.verifier, "name", "") == "exit_status",
        report=(lambda line: None) if bench.config.quiet else log.info,
    )
    for cell in cells:
        known |= bench.store([cell])
        solved = {None: "not measured", 0.0: "not solved", 100.0: "solved"}[cell.measures["solved"]]
        progress.done(1, f"{cell.factors['memory']} {cell.factors['task']}: {solved}")


def _sequence(bench: BenchRun, tasks: Sequence[AgentTask], arm: str, seed: int) -> TaskSequence:
    from gvla2.evaluation.agents.sequence import TaskSequence, in_order
    from gvla2.evaluation.provenance import code_digest, versions

    ordered = in_order(tasks, seed)
    config = bench.config
    root = _root(bench, arm, "")
    options = [str(one) for one in configured(bench.registry, root, _kinds(bench, arm))]
    files = [_digest_of(task) for task in ordered]
    around = (VERSION, code_digest(MEASURING_CODE), versions(), options, config.agents.sandbox, seed, arm)
    limits = (config.agents.disk_mb, config.agents.memory_mb, config.agents.output)
    # Earlier tasks affect later ones through memory, so each key holds the whole order.
    keys = [cell_key(SUITE, *around, limits, files[: i + 1]) for i in range(len(ordered))]
    factors: dict[str, str | int] = {
        "agent": described(config.agent),
        "model": model_label(config.language),
        "verifier": described(config.verifier),
        "sandbox": config.agents.sandbox,
        "tasks": Path(config.agents.tasks).name,
        "memory": f"{arm} ({variant})" if (variant := arm_named(config, arm).variant) else arm,
    }
    state = Path(config.agents.state or bench.folder / "agents") / keys[-1][:16]
    return TaskSequence(arm, seed, ordered, keys, factors, state)


def _kinds(bench: BenchRun, arm: str) -> tuple[str, ...]:
    kept = has_bank(bench.registry, arm_named(bench.config, arm))
    helped = ("retriever", "embedder", "inducer", "judge") if kept else ()
    return ("agent", "verifier", "memory", *helped)


def _root(bench: BenchRun, arm: str, bank: str) -> dict[str, Any]:
    return {
        "agent": bench.config.agent,
        **chosen_memory(bench.config, bench.registry, arm_named(bench.config, arm), bank),
    }


def _crew(bench: BenchRun, arm: str, bank: Path) -> Crew:
    from gvla2.evaluation.agents.sequence import Crew
    from gvla2.language.ledger import Ledger

    built: dict[str, Any] = {}
    bench.registry.build_all(_root(bench, arm, str(bank)), ("agent", "verifier", "memory"), built)
    language = built.get("language")
    ledger = Ledger() if language is None else language.ledger
    return Crew(built["agent"], built["memory"], built["verifier"], ledger)


def _sandboxes(config: BenchConfig) -> Callable[[AgentTask], AbstractContextManager[TestedSandbox]]:
    from gvla2.agents.sandbox import SandboxLimits, bubblewrap, docker

    agents = config.agents
    limits = SandboxLimits(agents.disk_mb, agents.memory_mb, agents.output)
    return partial(docker if agents.sandbox == "docker" else bubblewrap, limits=limits)


def _digest_of(task: AgentTask) -> str:
    """The task's files, by content: a changed test is another task."""
    import hashlib

    digest = hashlib.sha256()
    for file in sorted(path for path in task.folder.rglob("*") if path.is_file()):
        digest.update(str(file.relative_to(task.folder)).encode() + b"\0")
        digest.update(hashlib.sha256(file.read_bytes()).digest())
    return digest.hexdigest()


def _missing(planned: Sequence[TaskSequence], key: str) -> Cell:
    """A row that could not be measured because the sequence ended before it."""
    from gvla2.evaluation.agents.sequence import MEASURES

    sequence = next(one for one in planned if key in one.keys)
    place = sequence.keys.index(key)
    factors = {
        **sequence.factors,
        "seed": sequence.seed,
        "task": sequence.tasks[place].name,
    }
    status = "not measured: the language model could not be asked"
    return Cell(key, factors, dict.fromkeys(MEASURES), {"status": status})
