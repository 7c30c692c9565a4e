"""The command line of `gvla2 memory`: its verbs, their words and flags, and overrides for Hydra."""

from __future__ import annotations

import argparse
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from importlib import import_module
from types import MappingProxyType
from typing import TYPE_CHECKING, NoReturn

from gvla2.discovery import closest

if TYPE_CHECKING:
    from gvla2.commands.memory_answers import Answer


@dataclass(frozen=True)
class Verb:
    """One verb: what it does, its function (module:function), its words as argparse takes them, notable options."""

    does: str
    code: str
    words: Sequence[tuple[str, str | None]] = ()
    options: Sequence[tuple[str, str]] = ()

    def load(self) -> Callable[..., Answer]:
        """The function."""
        module, _, name = self.code.partition(":")
        return getattr(import_module(f"gvla2.commands.{module}"), name)  # type: ignore[no-any-return]


_ID, _PATH = (("ID", None),), (("PATH", None),)
_LIMIT = ("limit=20", "at most so many (0: all); by default 50 are shown, and --json has all")
VERBS: Mapping[str, Verb] = MappingProxyType(
    {
        "list": Verb("the records, most recently changed first", "memory_looking:list_records",
                     options=(("states=[active,provisional]", "only these"), _LIMIT)),
        "show": Verb("everything about one record, its links and events", "memory_looking:show", _ID),
        "search": Verb("records that match the words, with all score terms", "memory_looking:search",
                       (("WORDS", "+"),),
                       (("retriever=semantic", "another ranking"), ("embedder=minilm", "other embeddings"),
                        ("limit=20", "how many, at most (50)"))),
        "history": Verb("what happened to a record, and why", "memory_looking:history", _ID, (_LIMIT,)),
        "as-of": Verb("the records as they were: 2026-11-20, '2026-11-20 18:30', 3h, 2d",
                      "memory_looking:as_of", (("TIME", None), ("ID", "?")),
                      (("states=[active]", "only these"), _LIMIT)),
        "conflicts": Verb("pairs of records that contradict each other", "memory_looking:conflicts",
                          options=(_LIMIT,)),
        "stats": Verb("how many records, events and bytes", "memory_looking:stats"),
        "verify": Verb("check the chain of events, rows and vectors", "memory_looking:verify",
                       options=(("head=SEQ:HASH", "a head that `stats` gave once must still be in the chain"),)),
        "import": Verb("read a memory of the released layout; - is standard input",
                       "memory_changing:import_", _PATH,
                       (("trusted=true", "your own backup: keep its states"),)),
        "export": Verb("write the bank as a folder that import reads", "memory_changing:export", _PATH,
                       (("states=[active]", "only these"),)),
        "forget": Verb("remove records for good, bytes and all", "memory_changing:forget", (("ID", "+"),)),
        "compact": Verb("free disk space", "memory_changing:compact",
                        options=(("archived_days=90", "forget records archived for longer"),)),
        "repair": Verb("restore manually changed rows from the events", "memory_changing:repair"),
        "govern": Verb("one pass: stale, contradicting, repeated and surplus records", "memory_changing:govern"),
        "replay": Verb("verify stored episodes again", "memory_changing:replay",
                       options=(("verifier=llm", "another verifier, with its options verifier.NAME=VALUE"),)),
    }
)  # fmt: skip


_COMMON = (
    ("url=sqlite:///PATH", "the database, or postgresql://USER@HOST/NAME; by default that of `gvla2 run`"),
    ("bank=NAME", "the bank in it: letters and digits of any language and . _ - /"),
)
_OVERRIDE = re.compile(r"[+~]{0,2}[A-Za-z_][\w./@:-]*=.*", re.DOTALL)
_VERBATIM = re.compile(r"(bank|url|head)=(?!'.*'$|\".*\"$)(.*)", re.DOTALL)


class UsageError(Exception):
    """The command line cannot be understood; the message says how it is used."""


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        raise UsageError(f"{message}. See `{self.prog} --help`.")


@dataclass(frozen=True)
class Invocation:
    """What was asked; ``overrides`` go to Hydra."""

    verb: str
    words: Sequence[str] = ()
    overrides: Sequence[str] = ()
    json: bool = False
    yes: bool = False
    help: bool = False

    @property
    def asks_hydra(self) -> bool:
        """Whether Hydra itself is asked, for the configuration."""
        return "--cfg" in self.overrides


def understood(argv: Sequence[str]) -> Invocation:
    """Read the command line: a verb, words, flags and overrides in any order; what follows "--" are words.

    Raises :class:`UsageError`.
    """
    end = list(argv).index("--") if "--" in argv else len(argv)
    overrides = [word for word in argv[:end] if _OVERRIDE.fullmatch(word)]
    first = _Parser("gvla2 memory", add_help=False, allow_abbrev=False)
    first.add_argument("verb", nargs="?", default="")
    first.add_argument("-h", "--help", action="store_true")
    first.add_argument("--json", action="store_true")
    first.add_argument("-c", "--cfg")
    plain = [word for word in argv[:end] if not _OVERRIDE.fullmatch(word)]
    given, left = first.parse_known_intermixed_args(plain)
    asked = Invocation(given.verb, (), overrides, given.json, help=given.help)
    if asked.verb and asked.verb not in VERBS:
        first.error(f"no verb '{asked.verb}'.{closest(asked.verb, VERBS)} Verbs: {', '.join(VERBS)}")
    if given.cfg:
        return replace(asked, overrides=[*overrides, "--cfg", given.cfg, *left])
    if asked.help or not asked.verb:
        return asked
    own = parser_of(asked.verb)
    found = vars(own.parse_intermixed_args([*left, *argv[end:]]))
    values = (found[name] for name, _ in VERBS[asked.verb].words)
    words = [word for value in values if value for word in (value if isinstance(value, list) else [value])]
    if (not words and VERBS[asked.verb].words) or not all(word.strip() for word in words):
        own.error("an argument is empty")
    if asked.verb == "forget" and asked.json and not found["yes"]:
        own.error("--json cannot ask for consent: it needs --yes")
    return replace(asked, words=words, yes=found.get("yes", False))


def parser_of(name: str) -> argparse.ArgumentParser:
    """The parser, and the help, of ``gvla2 memory NAME``, or for "" of the command itself."""
    listed = [(word, verb.does) for word, verb in VERBS.items()] if not name else VERBS[name].options
    made = _Parser(
        f"gvla2 memory {name}".strip(),
        description=VERBS[name].does if name else None,
        usage=None if name else "gvla2 memory VERB [words] [key=value ...]",
        epilog="\n".join(f"  {left:<29} {right}" for left, right in (*listed, *_COMMON)),
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    for word, nargs in VERBS[name].words if name else ():
        made.add_argument(word, nargs=nargs)
    made.add_argument("--json", action="store_true", help="one JSON document on standard output")
    made.add_argument("--cfg", metavar="job", help="show the configuration")
    if name == "forget":
        made.add_argument("-y", "--yes", action="store_true", help="without asking; takes only whole ids")
    return made


def as_typed(override: str) -> str:
    """The override with quotes for Hydra where its value is a name: 2026_11 is not a number, true not a boolean.

    A quoted value stays as it is.
    """
    found = _VERBATIM.fullmatch(override)
    if not found:
        return override
    value = re.sub(r"(\\*)('|$)", lambda m: m[1] * 2 + ("\\'" if m[2] else ""), found[2])
    return f"{found[1]}='{value}'"
