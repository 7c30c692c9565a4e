"""The suite ``agents``: software agents on folders of tasks, with one memory or another.

One memory goes through one order of tasks: lessons from a task are available to the next ones. An interrupted sequence
is measured anew, complete ones are not.
"""

from __future__ import annotations

import hashlib
import json
import logging
import os
import random
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from gvla2.agents.contracts import AgentTask, EnvironmentFailedError
from gvla2.agents.sandbox import bubblewrap
from gvla2.agents.tasks import Attempt, attempt, read_tasks
from gvla2.component import described
from gvla2.errors import ConfigurationError
from gvla2.evaluation.arms import MEMORY, BenchArm, chosen_arms, chosen_memory, has_bank
from gvla2.evaluation.comparison import SATURATED, Measure, TableLayout, comparison_sheets
from gvla2.evaluation.components import configured, model_label
from gvla2.evaluation.config import AgentsBench
from gvla2.evaluation.engine import Suite, Unit
from gvla2.evaluation.results import Cell, Run, cell_key, code_digest, versions
from gvla2.evaluation.tables import Sheet
from gvla2.language.contracts import LanguageModelError, Ledger
from gvla2.plugins.registry import Registry

VERSION = 1
MEASURING_CODE = ("gvla2.agents", "gvla2.evaluation.suites.agents", "gvla2.memory", "gvla2.language")
LAYOUT = TableLayout(
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
        Measure("solved", "SR %", "higher", 1, rate=True),
        Measure("steps", "AS", "lower", 1),
        Measure("agent_tokens", "agent tokens", "lower", 0),
        Measure("extra_tokens", "extra tokens", "lower", 0, compared=False),
        Measure("tokens", "tokens", "lower", 0),
        Measure("seconds", "seconds", "lower", 1),
        Measure("overhead", "memory s", "lower", 2, compared=False),
        Measure("storage_kb", "storage kB", "lower", 0, compared=False),
    ),
    groups=("agent", "model", "verifier", "tasks"),
    pair="task",
    explanation=SATURATED,
)
UNKNOWN = dict.fromkeys(measure.name for measure in LAYOUT.measures)
"""The measures of a task that was not measured."""

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class SequenceUnit(Unit):
    """An arm, a seed and the tasks in their order, with a key for each task's row.

    ``folder`` holds the memory; ``factors`` are what the rows have in common.
    """

    arm: BenchArm
    seed: int
    tasks: Sequence[AgentTask]
    factors: Mapping[str, str | int]
    folder: Path
    config: AgentsBench

    def unknown(self, place: int, status: str) -> Cell:
        """The row of the task at a place without measures, with why there are none."""
        task = self.tasks[place]
        own: dict[str, str | int] = {
            "seed": self.seed,
            "task": task.name,
            "family": task.family,
            "place": place,
        }
        return Cell(self.keys[place], {**self.factors, **own}, UNKNOWN, {"status": status})


class AgentsSuite(Suite[AgentsBench, SequenceUnit]):
    """One sequence of tasks for each seed and arm."""

    name = "agents"
    title = LAYOUT.title
    in_process = True

    def stages(self) -> Sequence[Sequence[SequenceUnit]]:
        """Every sequence with the keys of its rows."""
        config = self.config
        if not config.agents.tasks:
            raise ConfigurationError(
                "agents.tasks is not set: give a folder of tasks in Terminal-Bench's layout, such as "
                "agents.tasks=examples/agent_tasks."
            )
        tasks, arms = read_tasks(config.agents.tasks, config.agents.names), chosen_arms(config, self.registry)
        for arm in arms:
            if arm.source == "shuffled" or arm.replan is not None:
                raise ConfigurationError(
                    f"The arm '{arm.name}' ({arm.source}, {arm.variant or 'plain'}) is one of the robot bench: "
                    "software agents have no exploration and no replanning. Arms here are memories and off."
                )
        return [[self._sequence(tasks, arm, seed) for seed in config.seeds for arm in arms]]

    @staticmethod
    def measure(unit: SequenceUnit, registry: Registry) -> Iterator[Cell]:
        """The rows of the tasks, each when it is measured."""
        return work(unit, registry)

    @staticmethod
    def sheets(cells: Sequence[Cell], runs: Sequence[Run] = ()) -> list[Sheet]:
        """The memories compared with none, task by task."""
        return comparison_sheets(cells, LAYOUT)

    def _sequence(self, tasks: Sequence[AgentTask], arm: BenchArm, seed: int) -> SequenceUnit:
        config, agents = self.config, self.config.agents
        ordered = random.Random(seed).sample(list(tasks), len(tasks))  # every memory gets the same order
        helpers = MEMORY[1:] if has_bank(self.registry, arm) else ()
        root = {"agent": config.agent, **chosen_memory(config, self.registry, arm, "")}
        typed = configured(self.registry, root, ("agent", "verifier", "memory", *helpers))
        options, code = list(map(str, typed)), code_digest(MEASURING_CODE)
        around = (VERSION, code, versions(), options, seed, arm.name)
        files = [_digest_of(task) for task in ordered]
        # Earlier tasks affect later ones through memory, so each key holds the whole order.
        keys = tuple(cell_key(self.name, *around, files[: i + 1]) for i in range(len(ordered)))
        factors: dict[str, str | int] = {
            "agent": described(config.agent),
            "model": model_label(config.language),
            "verifier": described(config.verifier),
            "tasks": Path(agents.tasks).name,
            "memory": f"{arm.name} ({arm.variant})" if arm.variant else arm.name,
        }
        folder = (self.folder / "agents" / keys[-1][:16]).absolute()
        return SequenceUnit(keys, f"{arm.name}, seed {seed}", arm, seed, ordered, factors, folder, config)


def _digest_of(task: AgentTask) -> str:
    """The task's files, by content, and its links by their targets: a changed test is another task."""
    digest = hashlib.sha256()
    for file in sorted(path for path in task.folder.rglob("*") if path.is_symlink() or path.is_file()):
        content = os.fsencode(file.readlink()) if file.is_symlink() else file.read_bytes()
        digest.update(os.fsencode(file.relative_to(task.folder)) + b"\0")
        digest.update(hashlib.sha256(content).digest())
    return digest.hexdigest()


def work(unit: SequenceUnit, registry: Registry) -> Iterator[Cell]:
    """The rows of the sequence, from a memory that knows nothing.

    A task whose environment cannot be set up is "not measured", nor is any task from the first one on that found no
    language model: later tasks would have the wrong memory.
    """
    config, arm = unit.config, unit.arm
    unit.folder.mkdir(parents=True, exist_ok=True)
    bank = unit.folder / "memory.db"
    for file in unit.folder.glob("memory.db*"):
        file.unlink()
    built: dict[str, Any] = {}
    root = {"agent": config.agent, **chosen_memory(config, registry, arm, str(bank))}
    registry.build_all(root, ("agent", "verifier", "memory"), built)
    language, memory = built.get("language"), built["memory"]
    ledger = Ledger() if language is None else language.ledger
    level = logging.DEBUG if config.quiet else logging.INFO
    with closing(memory):
        for place, task in enumerate(unit.tasks):
            before = ledger.totals()
            row = f"{arm.name}/{unit.seed}/{task.name}"
            try:
                with bubblewrap(task) as box:
                    made = attempt(
                        task,
                        built["agent"],
                        box,
                        memory,
                        built["verifier"],
                        source=row,
                        show_tests=config.verifier.name == "exit_status",
                        seed=unit.seed,
                        report=partial(log.log, level, "%s %s", row),
                    )
            except EnvironmentFailedError as error:
                cell = unit.unknown(place, f"not measured: {error}")
            except LanguageModelError as error:
                for later in range(place, len(unit.tasks)):
                    yield unit.unknown(
                        later, f"not measured: the language model could not be asked ({error})"
                    )
                return
            else:
                if made.verdict.outcome == "unavailable" and arm.source != "off":
                    why = "; ".join(made.verdict.reasons)
                    log.warning("%s: no verdict, so memory learns nothing from it: %s", row, why)
                cell = _measured(unit.unknown(place, "ok"), made, ledger.totals(before))
            if cell.status == "ok" and bank.is_file():
                cell = replace(cell, measures={**cell.measures, "storage_kb": bank.stat().st_size / 1000})
            yield cell


def _measured(cell: Cell, made: Attempt, spent: Mapping[str, Mapping[str, float]]) -> Cell:
    """The row of an attempt; ``spent`` are the tokens by purpose."""
    agent = _tokens(made.run.usage)  # a cached answer counts too: the agents' work is compared
    extra = sum(_tokens(tally) for purpose, tally in spent.items() if purpose != "agent")
    measures: dict[str, float | None] = {
        "solved": 100.0 * made.solved,
        "steps": float(made.run.steps),
        "agent_tokens": agent,
        "extra_tokens": extra,
        "tokens": agent + extra,
        "seconds": made.run.seconds,
        "overhead": made.overhead,
        "storage_kb": 0.0,
    }
    notes: dict[str, Any] = {
        "status": "ok",
        "exit_status": made.run.exit_status,
        "verdict": made.verdict.outcome,
        "recalled": len(made.recalled.items),
        "recalled_text": made.recalled.text[:2000],
        "learned": [len(made.learned.added), len(made.learned.merged), len(made.learned.provisional)],
        "tests": made.tests.text[-1000:],
        "conversation": json.dumps(list(made.run.messages))[:200_000],
    }
    return replace(cell, measures=measures, notes=notes)


def _tokens(tally: Mapping[str, float]) -> float:
    return tally.get("prompt_tokens", 0.0) + tally.get("completion_tokens", 0.0)
