"""One memory through one order of tasks: lessons from a task are available to the next ones."""

from __future__ import annotations

import json
import logging
import random
import shutil
import sqlite3
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from gvla2.agents.contracts import Agent, AgentTask, EnvironmentFailedError, TestedSandbox
from gvla2.agents.solving import Attempt, attempt
from gvla2.evaluation.results import Cell
from gvla2.language.failures import LanguageModelError
from gvla2.language.ledger import Ledger
from gvla2.memory.contracts import Memory, Verifier

DATABASE = "memory.db"
CANNOT_BE = "not measured"
"""Prefix of the status of a task whose environment cannot be set up on this machine."""

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Crew:
    """The components at work: an agent, a memory with its own file, a verifier, and the ledger of their model calls."""

    agent: Agent
    memory: Memory
    verifier: Verifier
    ledger: Ledger


@dataclass(frozen=True)
class TaskSequence:
    """A memory, a seed and the tasks; ``keys`` and ``factors`` of each task's row, in the order of ``tasks``.

    ``folder`` keeps the memory between the tasks, so that an interrupted sequence can resume.
    """

    memory: str
    seed: int
    tasks: Sequence[AgentTask]
    keys: Sequence[str]
    factors: Mapping[str, str | int]
    folder: Path


def in_order(tasks: Sequence[AgentTask], seed: int) -> list[AgentTask]:
    """The tasks, shuffled by a seed: every memory gets them in the same order."""
    return random.Random(seed).sample(list(tasks), len(tasks))


def work(
    sequence: TaskSequence,
    done: int,
    crew_of: Callable[[Path], Crew],
    sandbox_of: Callable[[AgentTask], AbstractContextManager[TestedSandbox]],
    *,
    show_tests: bool,
    report: Callable[[str], None],
) -> Iterator[Cell]:
    """The rows of the tasks after the first ``done``, each when it is measured.

    The memory is restored to its state after task ``done``, without traces of an interrupted task. A task whose
    environment cannot be set up is "not measured"; if the language model is unavailable, the sequence ends: later tasks
    would have the wrong memory.
    """
    folder = sequence.folder
    folder.mkdir(parents=True, exist_ok=True)
    bank = folder / DATABASE
    _restore(folder, done)
    crew = crew_of(bank)
    with closing(crew.memory):
        for place in range(done, len(sequence.tasks)):
            task = sequence.tasks[place]
            before = crew.ledger.totals()
            row = f"{sequence.memory}/{sequence.seed}/{task.name}"
            made: Attempt | None = None
            try:
                with sandbox_of(task) as sandbox:
                    made = attempt(
                        task,
                        crew.agent,
                        sandbox,
                        crew.memory,
                        crew.verifier,
                        source=row,
                        show_tests=show_tests,
                        seed=sequence.seed,
                        report=lambda line, row=row: report(f"{row} {line}"),  # type: ignore[misc]
                    )
                status = "ok"
            except EnvironmentFailedError as error:
                status = f"{CANNOT_BE}: {error}"
            except LanguageModelError as error:
                log.warning(
                    "%s: the language model cannot be asked (%s); this sequence ends here.", row, error
                )
                return
            if made is not None and made.verdict.outcome == "unavailable" and sequence.memory != "off":
                why = "; ".join(made.verdict.reasons)
                log.warning("%s: no verdict, so that memory learns nothing from it: %s", row, why)
            _keep(folder, place + 1)
            yield _cell(sequence, place, made, status, crew.ledger.totals(before))


def _after(folder: Path, done: int) -> Path:
    return folder / f"after-{done}.db"


def _restore(folder: Path, done: int) -> None:
    """The memory as it was after ``done`` tasks."""
    for file in folder.glob(f"{DATABASE}*"):
        file.unlink()
    kept = _after(folder, done)
    if done and kept.is_file():
        shutil.copyfile(kept, folder / DATABASE)


def _keep(folder: Path, done: int) -> None:
    """Copy the memory after ``done`` tasks; the previous copy stays, in case the row is not stored."""
    bank, aside = folder / DATABASE, folder / f"after-{done}.part"
    if bank.is_file():
        aside.unlink(missing_ok=True)
        with closing(sqlite3.connect(bank)) as connection:
            connection.execute("VACUUM INTO ?", (str(aside),))
        aside.replace(_after(folder, done))
    for old in folder.glob("after-*.db"):
        if int(old.stem.removeprefix("after-")) < done - 1:
            old.unlink()


def _cell(
    sequence: TaskSequence,
    place: int,
    made: Attempt | None,
    status: str,
    spent: Mapping[str, Mapping[str, float]],
) -> Cell:
    task, kept = sequence.tasks[place], _after(sequence.folder, place + 1)
    factors = {
        **sequence.factors,
        "seed": sequence.seed,
        "task": task.name,
        "family": task.family,
        "place": place,
    }
    if made is None:
        empty: dict[str, float | None] = dict.fromkeys(MEASURES)
        return Cell(sequence.keys[place], factors, empty, {"status": status})
    agent = _tokens(made.run.usage)  # a cached answer counts too: what is compared is the agents' work
    extra = sum(_tokens(tally) for purpose, tally in spent.items() if purpose != "agent")
    measures: dict[str, float | None] = {
        "solved": 100.0 * made.solved,
        "steps": float(made.run.steps),
        "agent_tokens": agent,
        "extra_tokens": extra,
        "tokens": agent + extra,
        "seconds": made.run.seconds,
        "overhead": sum(made.seconds[name] for name in ("recall", "verify", "learn")),
        "storage_kb": kept.stat().st_size / 1000 if kept.is_file() else 0.0,
    }
    notes: dict[str, Any] = {
        "status": status,
        "exit_status": made.run.exit_status,
        "verdict": made.verdict.outcome,
        "quality": made.verdict.quality if made.verdict.outcome != "unavailable" else None,
        "recalled": len(made.recalled.items),
        "recalled_text": made.recalled.text[:2000],
        "learned": [len(made.learned.added), len(made.learned.merged), len(made.learned.provisional)],
        "tests": made.tests.text[-1000:],
        "conversation": json.dumps(list(made.run.messages))[:200_000],
    }
    return Cell(sequence.keys[place], factors, measures, notes)


MEASURES = (
    "solved", "steps", "agent_tokens", "extra_tokens", "tokens", "seconds", "overhead", "storage_kb",
)  # fmt: skip


def _tokens(tally: Mapping[str, float]) -> float:
    return tally.get("prompt_tokens", 0.0) + tally.get("completion_tokens", 0.0)
