"""``gvla2 memory VERB``: inspect a bank, import and export records, govern and forget."""

from __future__ import annotations

import json
import math
import re
import sys
import unicodedata
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from gvla2.commands.memory_line import VERBS, Invocation, UsageError, as_typed, parser_of, understood
from gvla2.component import ComponentConfig
from gvla2.errors import ConfigurationError
from gvla2.record.text import printable

if TYPE_CHECKING:
    from gvla2.commands.memory_answers import Answer
    from gvla2.plugins.registry import Registry


STATES = ("active", "provisional", "summary", "archive")
_HEAD = re.compile(r"\d{1,18}:[0-9a-f]{64}")


@dataclass
class MemoryCommandConfig:
    """A bank and what to do with it.

    ``url`` is the database, "" the default one; ``bank`` the bank in it; ``busy_seconds`` how long to wait for other
    processes. ``limit`` bounds how many rows are shown (0: all; None: 50, and all as JSON). ``states`` keeps records of
    these states in `list` and `export` (default: all). ``trusted`` imports your own backup unchanged. ``head`` is a
    head of the chain to `verify` against, SEQ:HASH. ``archived_days`` lets `compact` forget records archived for longer
    than that.
    """

    url: str = ""
    bank: str = "default"
    busy_seconds: float = 5.0
    limit: int | None = None
    states: list[str] = field(default_factory=list)
    trusted: bool = False
    head: str = ""
    archived_days: float | None = None
    retriever: ComponentConfig = field(default_factory=ComponentConfig)
    embedder: ComponentConfig = field(default_factory=ComponentConfig)
    verifier: ComponentConfig = field(default_factory=ComponentConfig)
    language: ComponentConfig = field(default_factory=ComponentConfig)

    def __post_init__(self) -> None:
        unknown = [state for state in self.states if state not in STATES]
        if unknown:
            raise ConfigurationError(f"No state '{unknown[0]}'. States: {', '.join(STATES)}.")
        if not self.bank:
            raise ConfigurationError("A bank needs a name: bank=NAME.")
        self.bank = unicodedata.normalize("NFC", self.bank)
        if self.head and not _HEAD.fullmatch(self.head):
            raise ConfigurationError(
                f"'{self.head}' is not the head of a chain: give head=SEQ:HASH as `gvla2 memory stats` has it."
            )
        if self.limit is not None and self.limit < 0:
            raise ConfigurationError(f"limit is {self.limit}; it must not be negative (0 shows all).")
        if self.archived_days is not None and not 0 <= self.archived_days < math.inf:
            raise ConfigurationError(
                f"archived_days is {self.archived_days}; it must be a finite number, and not negative."
            )


@dataclass
class VerbJob:
    """A verb as Hydra calls it; keeps the answer, which is printed when Hydra has finished."""

    invocation: Invocation
    answer: Answer | None = None
    error: Exception | None = None

    def __call__(self, config: MemoryCommandConfig, registry: Registry, folder: Path) -> None:
        """Run the verb."""
        from gvla2.commands.memory_access import VerbRequest

        asked = self.invocation
        request = VerbRequest(tuple(asked.words), asked.yes, config, registry, asked.json)
        try:
            self.answer = VERBS[asked.verb].load()(request)
        except Exception as error:  # reported by main, with the exit status for a wrong word if it is one
            self.error = error


def main(argv: Sequence[str]) -> int:
    """Entry of ``gvla2 memory``: 0 success, 1 not found, problems found or an error, 2 wrong usage."""
    try:
        asked = understood(argv)
    except UsageError as error:
        print(f"gvla2: {printable(str(error))}", file=sys.stderr)
        if "--json" in (argv[: list(argv).index("--")] if "--" in argv else argv):
            print(json.dumps({"error": str(error)}))
        return 2
    if asked.help or not (asked.verb or asked.asks_hydra):
        parser_of(asked.verb).print_help(sys.stdout if asked.help else sys.stderr)
        return 0 if asked.help else 2
    from gvla2.commands.hydra_job import launch

    job, errors = VerbJob(asked), list[str]()
    return tell(job, launch("memory", job, [as_typed(o) for o in asked.overrides], errors), errors)


def tell(job: VerbJob, status: int, errors: Sequence[str] = ()) -> int:
    """Print the answer, or what went wrong; ``status`` and ``errors`` are Hydra's. The exit status."""
    from gvla2.commands.hydra_job import report
    from gvla2.commands.memory_access import WrongWordError
    from gvla2.commands.memory_answers import give

    if job.error is not None:
        status = report(job.error)
        status = 2 if isinstance(job.error, WrongWordError) else status
    if job.invocation.json and status:
        said = str(job.error) if job.error is not None else " ".join(errors)
        print(json.dumps({"error": said or "It failed: see standard error."}))
    return give(job.answer, as_json=job.invocation.json) if job.answer is not None else status


def complete(words: Sequence[str]) -> list[str]:
    """Completions of the last word, besides overrides."""
    return [*VERBS, "--help"] if len(words) <= 1 else ["--json", "--help", "--yes"]
