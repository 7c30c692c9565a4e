"""``gvla2 memory VERB``: search and list a bank, verify it, import, export and forget records."""

from __future__ import annotations

import argparse
import dataclasses
import json
import os
import re
import sys
import time
import unicodedata
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

from omegaconf import OmegaConf

from gvla2.errors import ConfigurationError, Gvla2Error, MemoryStoreError, did_you_mean
from gvla2.plugins.registry import Registry, load_plugins
from gvla2.record.text import count, listing, one_line, printable

if TYPE_CHECKING:
    from rich.table import Table

    from gvla2.memory.bank import KnowledgeBank
    from gvla2.memory.records import Record
    from gvla2.memory.store import Store
    from gvla2.memory.view import BankView

ACTOR = "gvla2 memory"
_TIMES = ("created", "updated", "used")
"""A record's fields that are seconds since the epoch."""


@dataclass
class MemoryCommandConfig:
    """A bank and how to look at it.

    ``url`` is the database, "" the default one; ``bank`` the bank in it; ``busy_seconds`` how long to wait for other
    processes. ``limit`` is the maximum number of rows (0: all). ``trusted`` vouches for your own export.
    ``head`` is an earlier head of the chain to `verify` against, SEQ:HASH. ``retriever`` and ``embedder`` are names, or
    names with options: ``retriever={name: hybrid, OPTION: VALUE}``.
    """

    url: str = ""
    bank: str = "default"
    busy_seconds: float = 5.0
    limit: int = 50
    trusted: bool = False
    head: str = ""
    retriever: Any = "hybrid"
    embedder: Any = "auto"

    def __post_init__(self) -> None:
        if self.limit < 0:
            raise ConfigurationError(f"limit is {self.limit}; it must not be negative (0 shows all).")
        self.bank = unicodedata.normalize("NFC", self.bank)


class NotFoundError(Gvla2Error):
    """The bank has no such record, or the database no such bank."""


@dataclass(frozen=True)
class MemoryRequest:
    """A verb's words and the configuration; with ``yes`` `forget` does not ask."""

    words: Sequence[str]
    config: MemoryCommandConfig
    yes: bool = False

    @property
    def url(self) -> str:
        """The database's address."""
        from gvla2.memory.store import resolved_address

        return resolved_address(self.config.url, os.environ)

    @contextmanager
    def store(self, *, create: bool = False) -> Iterator[Store]:
        """The store; only ``create`` makes a database, or accepts a bank that does not exist yet.

        Raises :class:`MemoryStoreError` for a database that is absent, locked or corrupt, :class:`NotFoundError` for a
        missing bank.
        """
        from gvla2.memory.store import Store, check_bank

        path = Path(self.url.partition(":///")[2].partition("?")[0])
        if not create and self.url.startswith("sqlite") and not os.path.exists(path):  # noqa: PTH110  # too long names
            raise MemoryStoreError(
                f"There is no memory at {path} yet: `gvla2 run` and `gvla2 memory import` make one; url= names another."
            )
        check_bank(self.config.bank)
        with Store.open(self.url, busy_seconds=self.config.busy_seconds, create=create) as store:
            banks = store.banks()
            if self.config.bank not in banks and not create:
                hint = did_you_mean(self.config.bank, banks)
                raise NotFoundError(
                    f"No bank '{self.config.bank}' in {store.name}.{hint} Banks: {', '.join(banks) or 'none yet'}."
                )
            yield store

    @contextmanager
    def knowledge_bank(self, *, create: bool = False) -> Iterator[KnowledgeBank]:
        """The bank with the chosen retriever and embedder; errors as those of :meth:`store`."""
        from gvla2.memory.bank import KnowledgeBank

        with self.store(create=create):  # its errors come before those of components
            pass
        kinds = ("retriever", "embedder")
        registry: Registry = load_plugins(kinds)
        built = registry.build_all(vars(self.config), kinds)
        with KnowledgeBank(
            self.url, bank=self.config.bank, busy_seconds=self.config.busy_seconds, **built
        ) as bank:
            yield bank


@dataclass(frozen=True)
class Answer:
    """``data`` is one JSON document; ``shown`` the same for a person: tables and lines. ``status``: the exit status."""

    data: Any
    shown: Sequence[Table | str]
    status: int = 0


def find_record(view: BankView, word: str, *, whole: bool = False) -> Record:
    """The record with that id, or (unless ``whole``) the only one whose id begins so; raises :class:`NotFoundError`."""
    if found := view.get(word):
        return found
    if any(event.action == "forget" for event in view.history(word)):
        raise NotFoundError(f"The record '{word}' of bank '{view.bank}' was forgotten.")
    records = {record.id: record for record in view.records()}
    starting = [id for id in records if id.startswith(word)]
    if len(starting) == 1 and not whole:
        return records[starting[0]]
    hint = did_you_mean(word, records) or " `gvla2 memory list` shows what is there."
    if starting:
        hint = f" Its ids that begin so: {listing(starting)}. Give a whole one."
    raise NotFoundError(f"No record '{word}' in bank '{view.bank}'.{hint}")


def _said(record: Record) -> str:
    """The record on one line, with its numbers."""
    from gvla2.memory.rendering import effect_words

    return one_line(record.content) + effect_words(record.effect_json())


def list_records(request: MemoryRequest) -> Answer:
    """The records, most recently changed first."""
    with request.store() as store, store.reading(request.config.bank) as view:
        records = view.records()
    shown = sorted(records, key=lambda record: (-record.updated, record.id))
    shown = shown[: request.config.limit or len(records)]
    rows = [(r.id, r.state, r.outcome, f"{r.confidence:.2f}", _said(r)) for r in shown]
    columns = ("id", "state", "outcome", "confidence", "content")
    lines: list[Table | str] = [_table(columns, rows) if rows else "The bank has no records."]
    if len(shown) < len(records):
        lines.append(f"{len(shown)} of {len(records)} are shown; limit=0 shows all.")
    return Answer([_columns(record) for record in shown], lines)


def show(request: MemoryRequest) -> Answer:
    """Everything about one record: its fields, links and events, oldest first."""
    with request.store() as store, store.reading(request.config.bank) as view:
        record = find_record(view, request.words[0])
        links, events = view.links([record.id]), view.history(record.id)
    rows = [(name, _value(name, value)) for name, value in _columns(record).items()]
    for link in links:
        forward = link.source == record.id
        rows.append(("link", f"{link.kind} {link.target}" if forward else f"{link.kind} of {link.source}"))
    changes = [_parsed(event._asdict(), "scores", "change") | {"erased": not event.salt} for event in events]
    return Answer(
        {"record": _columns(record), "links": [link._asdict() for link in links], "events": changes},
        [_table(("field", "value"), rows), _events_table(changes)],
    )


def search(request: MemoryRequest) -> Answer:
    """The records that match the words, best first, with every term of their scores."""
    words = " ".join(request.words)
    with request.knowledge_bank() as bank:
        hits = bank.search(words, request.config.limit or len(bank.records()))
    rows = []
    for hit in hits:
        terms = " ".join(f"{name} {round(value, 2) + 0.0:+.2f}" for name, value in hit.terms.items())
        state = "recalled" if hit.reliable else "passed over"
        rows.append((hit.record.id, state, f"{hit.score:.3f}", f"{_said(hit.record)}\n{terms}"))
    found = [
        {"record": _columns(h.record), "score": h.score, "terms": dict(h.terms), "reliable": h.reliable}
        for h in hits
    ]
    recalled = sum(hit.reliable for hit in hits) or "none"
    columns = ("id", "would be", "score", "content and score terms")
    lines: list[Table | str] = [
        _table(columns, rows),
        f"A recall for these words would show {recalled} of them.",
    ]
    if recalled != len(hits):
        lines.append(
            "Passed over: provisional, too little evidence, a repeat, or beyond the retriever's limits."
        )
    return Answer({"query": words, "found": found}, lines if rows else ["Nothing is similar."])


def verify(request: MemoryRequest) -> Answer:
    """Count what the bank holds, and check its chain of events, rows and vectors; the exit status is 1 for damage."""
    with request.knowledge_bank() as bank:
        problems, counts = bank.verify(head=request.config.head), bank.stats()
        banks = bank.store.banks()
    head = f"{counts.pop('seq')}:{counts.pop('hash')}"
    data = {"bank": request.config.bank, "banks": banks, **counts, "head": head}
    lines: list[Table | str] = [
        _table(("what", "value"), [(n, _value(n, value)) for n, value in data.items()])
    ]
    if problems:
        rows = [(problem.where, problem.id, problem.what) for problem in problems]
        advice = "Unreadable rows are not recalled; rows edited outside gvla2 are used as they are."
        lines += [_table(("where", "id", "what"), rows), f"{count(len(problems), 'problem')}. {advice}"]
    else:
        lines.append(f"The bank '{request.config.bank}' is sound: all rows agree with its events.")
    return Answer({**data, "sound": not problems, "problems": problems}, lines, int(bool(problems)))


def import_records(request: MemoryRequest) -> Answer:
    """Read JSON lines; the exit status is 1 when lines could not be read (the others are stored)."""
    from gvla2.memory.transfer import import_jsonl

    config = request.config
    path = Path("/dev/stdin" if request.words[0] == "-" else request.words[0]).expanduser()
    if not os.path.exists(path):  # noqa: PTH110  # too long names; before a database is made for nothing
        raise MemoryStoreError(f"There is nothing at {path}. Give a .jsonl file.")
    with request.knowledge_bank(create=True) as bank:
        done = import_jsonl(bank, path, trusted=config.trusted)
    new = count(len(done.added) + len(done.held_back), "record")
    lines = [f"New in the bank '{config.bank}': {new}; known already: {done.known}."]
    if done.held_back:
        lines.append(f"Provisional until verified episodes confirm them: {len(done.held_back)}.")
        lines += (
            [] if config.trusted else ["trusted=true makes the active lessons of your own export active."]
        )
    if done.left_out:
        lines.append(f"Left out: {count(done.left_out, 'archived record')}.")
    if done.broken:
        lines.append(f"{count(len(done.broken), 'line')} could not be read.")
    return Answer(done, [*lines, *done.broken[: config.limit or None]], status=int(bool(done.broken)))


def export(request: MemoryRequest) -> Answer:
    """Write the bank as a file of JSON lines that import reads."""
    from gvla2.memory.transfer import export_jsonl

    path = Path(request.words[0]).expanduser()
    with request.store() as store:
        records = export_jsonl(store, request.config.bank, path)
    return Answer({"file": path, "records": records}, [f"{count(records, 'record')}: {path}."])


def forget(request: MemoryRequest) -> Answer:
    """Remove records permanently, after asking."""
    with request.store() as store:
        with store.reading(request.config.bank) as view:
            records = [find_record(view, word, whole=request.yes) for word in dict.fromkeys(request.words)]
        if not request.yes:
            for record in records:
                print(f"{printable(record.id)}: {one_line(record.content, 200)}", file=sys.stderr)
            if not _confirmed():
                return Answer({"forgotten": []}, ["Nothing was forgotten."], status=1)
        with store.writing(request.config.bank, actor=ACTOR, now=time.time()) as transaction:
            gone = transaction.forget(*(record.id for record in records), why="asked for")
    return Answer({"forgotten": gone}, [f"Forgotten: {', '.join(gone) or 'nothing'}."])


def _confirmed() -> bool:
    if not sys.stdin.isatty():
        raise ConfigurationError(
            "Forgetting cannot be undone, and there is no terminal to ask on: add --yes."
        )
    print("Forget permanently? It cannot be undone. [y/N] ", end="", file=sys.stderr, flush=True)
    return sys.stdin.readline().strip().casefold() in ("y", "yes")


VERBS: Mapping[str, tuple[Callable[[MemoryRequest], Answer], Mapping[str, str | None], Sequence[str]]] = {
    "list": (list_records, {}, ("limit=20",)),
    "show": (show, {"ID": None}, ()),
    "search": (search, {"WORDS": "+"}, ("retriever={name: hybrid, top_k: 9}", "embedder=minilm", "limit=20")),
    "verify": (verify, {}, ("head=SEQ:HASH",)),
    "import": (import_records, {"PATH": None}, ("trusted=true",)),
    "export": (export, {"PATH": None}, ()),
    "forget": (forget, {"ID": "+"}, ()),
}
"""The verbs: function, words as argparse takes them, notable options."""

_OVERRIDE = re.compile(r"[A-Za-z_]\w*=.*", re.DOTALL)
_NAMES = ("bank", "url", "head")
"""Options that are taken as typed: as YAML, bank=2026_11 would be a number."""


def main(argv: Sequence[str]) -> int:
    """Entry of ``gvla2 memory``: 0 success, 1 not found, problems found or an error, 2 wrong usage."""
    end = list(argv).index("--") if "--" in argv else len(argv)
    overrides = [word for word in argv[:end] if _OVERRIDE.fullmatch(word)]
    words = [word for word in argv[:end] if not _OVERRIDE.fullmatch(word)]
    asked = parser().parse_args([*words, *argv[end:]])
    if asked.verb == "forget" and asked.json and not asked.yes:
        parser().error("--json cannot ask for consent: it needs --yes")
    function, arguments, _ = VERBS[asked.verb]
    given = [getattr(asked, name) for name in arguments]
    given = given[0] if given and isinstance(given[0], list) else given
    try:
        config = read_options(overrides)
        answer = function(MemoryRequest(given, config, getattr(asked, "yes", False)))
    except Exception as error:
        from gvla2.commands.hydra_job import report

        status = report(error)
        if asked.json:
            print(json.dumps({"error": printable(str(error))}))
        return status
    _print(answer, as_json=asked.json)
    return answer.status


def read_options(overrides: Sequence[str]) -> MemoryCommandConfig:
    """The options, from words such as ``limit=20``; raises :class:`omegaconf.OmegaConfBaseException` for wrong ones."""
    pairs = [word.partition("=")[::2] for word in overrides]
    typed = OmegaConf.from_dotlist([f"{name}={text}" for name, text in pairs if name not in _NAMES])
    as_typed = {name: text for name, text in pairs if name in _NAMES}
    made = OmegaConf.to_object(OmegaConf.merge(MemoryCommandConfig, typed, as_typed))
    assert isinstance(made, MemoryCommandConfig)
    return made


def parser() -> argparse.ArgumentParser:
    """The command line of ``gvla2 memory``, besides options such as ``limit=20``."""
    made = argparse.ArgumentParser("gvla2 memory", description=__doc__, allow_abbrev=False)
    verbs = made.add_subparsers(dest="verb", metavar="VERB", required=True)
    common = "url=sqlite:///PATH (the database; by default that of `gvla2 run`), bank=NAME"
    for name, (function, arguments, options) in VERBS.items():
        about = (function.__doc__ or "").strip()
        verb = verbs.add_parser(
            name, help=about, description=about, epilog=f"Options: {', '.join((*options, common))}"
        )
        for word, nargs in arguments.items():
            verb.add_argument(word, nargs=nargs)
        verb.add_argument("--json", action="store_true", help="one JSON document on standard output")
        if name == "forget":
            verb.add_argument("-y", "--yes", action="store_true", help="without asking; takes only whole ids")
    return made


def _print(answer: Answer, *, as_json: bool) -> None:
    if as_json:
        from gvla2.io.files import plain

        text = json.dumps(plain(answer.data), indent=2, ensure_ascii=False, allow_nan=False)
        sys.stdout.write(text.encode("utf-8", "replace").decode() + "\n")
        return
    from rich.text import Text

    from gvla2.commands.tables import console

    out = console()
    for part in answer.shown:
        out.print(Text(printable(part)) if isinstance(part, str) else part, soft_wrap=isinstance(part, str))


def _table(columns: Sequence[str], rows: Sequence[Sequence[str]]) -> Table:
    from gvla2.commands.tables import row, table

    made = table(*columns)
    for cells in rows:
        row(made, *cells)
    return made


def _events_table(events: Sequence[Mapping[str, Any]]) -> Table:
    rows = []
    for event in events:
        action = f"{event['action']} {event['target'] or ''}".strip()
        why = "(forgotten)" if event["erased"] else one_line(event["why"])
        rows.append((str(event["seq"]), _date(event["at"]), event["actor"], action, why))
    return _table(("event", "time", "who", "action", "why"), rows)


def _columns(record: Record) -> dict[str, Any]:
    """A record's fields with JSON columns parsed."""
    return _parsed(dataclasses.asdict(record), "verifier", "effect", "provenance")


def _parsed(columns: Mapping[str, Any], *names: str) -> dict[str, Any]:
    """The columns, those of these names as the JSON that they hold; a damaged one stays text."""
    data = dict(columns)
    for name in names:
        with suppress(ValueError):
            data[name] = json.loads(data[name]) if data[name] else None
    return data


def _value(name: str, value: Any) -> str:
    if name in _TIMES and isinstance(value, int | float):
        return _date(value) if value else "never"
    if isinstance(value, dict):
        return ", ".join(f"{key} {_value(key, item)}" for key, item in value.items())[:4000]
    if isinstance(value, list):
        return ", ".join(_value("", item) for item in value)[:4000]
    return f"{value:.6g}" if isinstance(value, float) else "" if value is None else str(value)


def _date(seconds: float) -> str:
    """Local date and time."""
    return datetime.fromtimestamp(seconds).astimezone().strftime("%Y-%m-%d %H:%M:%S")
