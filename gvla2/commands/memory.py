"""``gvla2 memory VERB``: inspect a bank, import and export records, govern and forget."""

from __future__ import annotations

import json
import shutil
import sys
import textwrap
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING

from gvla2.commands.memory_words import Invocation, UsageError, as_typed, understood, wants_json
from gvla2.record.text import printable

if TYPE_CHECKING:
    from gvla2.commands.memory_answers import Answer
    from gvla2.commands.memory_config import MemoryCommandConfig
    from gvla2.plugins import Registry


@dataclass(frozen=True)
class Verb:
    """One verb: its words, what it does, its function (module:function), and notable options."""

    takes: str
    does: str
    code: str
    fewest: int = 0
    most: int | None = 0
    options: Sequence[tuple[str, str]] = ()

    def load(self) -> Callable[..., Answer]:
        """The function."""
        module, _, name = self.code.partition(":")
        return getattr(import_module(f"gvla2.commands.{module}"), name)  # type: ignore[no-any-return]


_LIMIT = ("limit=20", "at most so many (0: all); by default 50 are shown, and --json has all")
VERBS: Mapping[str, Verb] = MappingProxyType(
    {
        "list": Verb("", "the records, most recently changed first", "memory_looking:list_records",
                     options=(("states=[active,provisional]", "only these"), _LIMIT)),
        "show": Verb("ID", "everything about one record, its links and events", "memory_looking:show", 1, 1),
        "search": Verb("WORDS", "records that match the words, with all score terms", "memory_looking:search", 1, None,
                       (("retriever=semantic", "another ranking"), ("embedder=minilm", "other embeddings"),
                        ("limit=20", "how many, at most (50)"))),
        "history": Verb("ID", "what happened to a record, and why", "memory_looking:history", 1, 1, (_LIMIT,)),
        "as-of": Verb("TIME [ID]", "the records as they were: 2026-11-20, '2026-11-20 18:30', 3h, 2d",
                      "memory_looking:as_of", 1, 2, (("states=[active]", "only these"), _LIMIT)),
        "conflicts": Verb("", "pairs of records that contradict each other", "memory_looking:conflicts",
                          options=(_LIMIT,)),
        "stats": Verb("", "how many records, events and bytes", "memory_looking:stats"),
        "verify": Verb("", "check the chain of events, rows and vectors", "memory_looking:verify",
                       options=(("head=SEQ:HASH", "a head that `stats` gave once must still be in the chain"),)),
        "import": Verb("PATH", "read a memory of the released layout; - is standard input",
                       "memory_changing:import_", 1, 1,
                       (("trusted=true", "your own backup: keep its states"),)),
        "export": Verb("PATH", "write the bank as a folder that import reads", "memory_changing:export", 1, 1,
                       (("states=[active]", "only these"),)),
        "forget": Verb("ID...", "remove records for good, bytes and all", "memory_changing:forget", 1, None,
                       (("--yes", "without asking; takes only whole ids"),)),
        "compact": Verb("", "free disk space", "memory_changing:compact",
                        options=(("archived_days=90", "forget records archived for longer"),)),
        "repair": Verb("", "restore manually changed rows from the events", "memory_changing:repair"),
        "govern": Verb("", "one pass: stale, contradicting, repeated and surplus records", "memory_changing:govern"),
        "replay": Verb("", "verify stored episodes again", "memory_changing:replay",
                       options=(("verifier=llm", "another verifier, with its options verifier.NAME=VALUE"),)),
    }
)  # fmt: skip


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
        asked = understood(argv, {name: (verb.fewest, verb.most) for name, verb in VERBS.items()})
    except UsageError as error:
        print(f"gvla2: {printable(str(error))}", file=sys.stderr)
        if wants_json(argv):
            print(json.dumps({"error": str(error)}))
        return 2
    if asked.help:
        print(usage(asked.verb))
        return 0
    if not asked.verb and not asked.hydra_asks:
        print(usage(""), file=sys.stderr)
        return 2
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


def usage(verb: str) -> str:
    """The text of ``gvla2 memory [VERB] --help``."""
    common = (
        (
            "url=sqlite:///PATH",
            "the database (or postgresql://USER@HOST/NAME); the default is that of `gvla2 run`",
        ),
        ("bank=NAME", "the bank in it: letters and digits of any language and . _ - /"),
        ("--json", "one JSON document on standard output"),
        ("--cfg job", "the configuration"),
        ("--", "what follows are words, even if they look like options"),
    )
    if verb:
        chosen = VERBS[verb]
        words = f"{verb} {chosen.takes}".strip()
        head, rows = (
            [f"Usage: gvla2 memory {words} [key=value ...]", "", f"  {chosen.does}", ""],
            chosen.options,
        )
    else:
        head = ["Usage: gvla2 memory VERB [words] [key=value ...]", "", "Verbs (each has --help):"]
        head += _aligned([(f"{name} {v.takes}", v.does) for name, v in VERBS.items()])
        head, rows = [*head, "", "Options:"], ()
    return "\n".join([*head, *_aligned([*rows, *common])])


def _aligned(rows: Sequence[tuple[str, str]]) -> list[str]:
    """Two columns within the terminal's width, the right one wrapped."""
    width = max(len(left) for left, _ in rows)
    room = max(shutil.get_terminal_size((120, 24)).columns - width - 4, 24)
    lines = []
    for left, right in rows:
        first, *more = textwrap.wrap(right, room, break_long_words=False, break_on_hyphens=False)
        lines += [f"  {left:<{width}}  {first}", *(" " * (width + 4) + line for line in more)]
    return lines


def complete(words: Sequence[str]) -> list[str]:
    """Completions of the last word, besides overrides."""
    return [*VERBS, "--help"] if len(words) <= 1 else ["--json", "--help", "--yes"]
