"""``gvla2 memory VERB``: search and list a bank, import and export records, govern and forget."""

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
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gvla2.component import ComponentConfig
from gvla2.errors import ConfigurationError, Gvla2Error, MemoryStoreError, did_you_mean
from gvla2.record.text import count, listing, one_line, printable

if TYPE_CHECKING:
    from rich.table import Table

    from gvla2.memory.bank import KnowledgeBank
    from gvla2.memory.events import Event
    from gvla2.memory.records import Record
    from gvla2.memory.store import Store
    from gvla2.memory.view import BankView
    from gvla2.plugins.registry import Registry

ACTOR = "gvla2 memory"
STATES = ("active", "provisional", "archive")
ROWS_SHOWN = 50
"""Rows that the terminal shows unless ``limit`` says otherwise; JSON has all."""
_TIMES = ("created", "updated", "used")
"""A record's fields that are seconds since the epoch."""


@dataclass
class MemoryCommandConfig:
    """A bank and how to look at it.

    ``url`` is the database, "" the default one; ``bank`` the bank in it; ``busy_seconds`` how long to wait for other
    processes. ``limit`` is the maximum number of rows (0: all; null: 50 on the terminal, all as JSON). ``states`` keeps
    records of these states in `list` and `export` (default: all). ``trusted`` vouches for your own export.
    ``head`` is an earlier head of the chain to `verify` against, SEQ:HASH.
    """

    url: str = ""
    bank: str = "default"
    busy_seconds: float = 5.0
    limit: int | None = None
    states: list[str] = field(default_factory=list)
    trusted: bool = False
    head: str = ""
    retriever: ComponentConfig = field(default_factory=ComponentConfig)
    embedder: ComponentConfig = field(default_factory=ComponentConfig)

    def __post_init__(self) -> None:
        unknown = [state for state in self.states if state not in STATES]
        if unknown:
            raise ConfigurationError(f"No state '{unknown[0]}'. States: {', '.join(STATES)}.")
        if self.limit is not None and self.limit < 0:
            raise ConfigurationError(f"limit is {self.limit}; it must not be negative (0 shows all).")
        self.bank = unicodedata.normalize("NFC", self.bank)


class NotFoundError(Gvla2Error):
    """The bank has no such record, or the database no such bank."""


@dataclass(frozen=True)
class Request:
    """A verb's words, the configuration, and the plugins. ``yes``: `forget` does not ask."""

    words: Sequence[str]
    config: MemoryCommandConfig
    registry: Registry
    yes: bool = False

    @property
    def url(self) -> str:
        """The database's address."""
        from gvla2.memory.store import settled

        return settled(self.config.url, os.environ)

    @contextmanager
    def store(self, *, create: bool = False) -> Iterator[Store]:
        """The store; only ``create`` makes a database, or accepts a bank that does not exist yet.

        Raises :class:`MemoryStoreError` for a database that is absent, locked or corrupt, :class:`NotFoundError` for a
        missing bank.
        """
        from gvla2.memory.store import Store, wrong_bank_name

        path = Path(self.url.partition(":///")[2].partition("?")[0])
        if not create and self.url.startswith("sqlite") and not os.path.exists(path):  # noqa: PTH110  # too long names
            raise MemoryStoreError(
                f"There is no memory at {path} yet: `gvla2 run` and `gvla2 memory import` make one; url= names another."
            )
        if wrong := wrong_bank_name(self.config.bank):
            raise ConfigurationError(wrong)
        with Store.open(self.url, busy_seconds=self.config.busy_seconds, create=create) as store:
            banks = store.banks()
            if self.config.bank not in banks and not create:
                hint = did_you_mean(self.config.bank, banks)
                raise NotFoundError(
                    f"No bank '{self.config.bank}' in {store.name}.{hint} Banks: {', '.join(banks) or 'none yet'}."
                )
            yield store

    @contextmanager
    def view(self) -> Iterator[BankView]:
        """The bank for reading."""
        with self.store() as store, store.reading(self.config.bank) as view:
            yield view

    @contextmanager
    def knowledge_bank(self, *, create: bool = False) -> Iterator[KnowledgeBank]:
        """The bank with the chosen retriever and embedder; errors as those of :meth:`store`."""
        from gvla2.memory.bank import KnowledgeBank

        with self.store(create=create):  # its errors come before those of components
            pass
        built = self.registry.build_all(self.config, ("retriever", "embedder"))
        with KnowledgeBank(
            self.url, bank=self.config.bank, busy_seconds=self.config.busy_seconds, **built
        ) as bank:
            yield bank


@dataclass(frozen=True)
class Answer:
    """``data`` is one JSON document, a list where it is a listing; ``show`` makes tables and lines of it.

    ``show`` gets the rows to show where ``data`` is a list. ``status`` is the exit status.
    """

    data: Any
    show: Callable[[Any], Sequence[Table | str]]
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
    if starting:
        raise NotFoundError(
            f"'{word}' is the beginning of {count(len(starting), 'id')} of bank '{view.bank}': {listing(starting)}. "
            "Give the whole id."
        )
    hint = did_you_mean(word, records) or " `gvla2 memory list` shows what is there."
    raise NotFoundError(f"No record '{word}' in bank '{view.bank}'.{hint}")


def list_records(request: Request) -> Answer:
    """The records, most recently changed first."""
    with request.view() as view:
        records = view.records(request.config.states or None)
    records = sorted(records, key=lambda record: (-record.updated, record.id))
    return Answer([_columns(record) for record in records], _records_table)


def show(request: Request) -> Answer:
    """Everything about one record: its fields, links and events, oldest first."""
    with request.view() as view:
        record = find_record(view, request.words[0])
        links, events = view.links([record.id]), view.history(record.id)

    def shown(data: Mapping[str, Any]) -> Sequence[Table | str]:
        rows = [(name, _value(name, value)) for name, value in data["record"].items()]
        for link in links:
            forward = link.source == record.id
            rows.append(
                ("link", f"{link.kind} {link.target}" if forward else f"{link.kind} of {link.source}")
            )
        return [_table(("field", "value"), rows), _events_table(data["events"])]

    return Answer({"record": _columns(record), "links": links, "events": [*map(_event, events)]}, shown)


def search(request: Request) -> Answer:
    """The records that match the words, best first, with every term of their scores."""
    words = " ".join(request.words)
    with request.knowledge_bank() as bank:
        limit = ROWS_SHOWN if request.config.limit is None else request.config.limit
        hits = bank.search(words, limit or len(bank.records()))
    found = [
        {"record": _columns(h.record), "score": h.score, "terms": dict(h.terms), "reliable": h.reliable}
        for h in hits
    ]

    def shown(data: Mapping[str, Any]) -> Sequence[Table | str]:
        rows = []
        for hit in data["found"]:
            terms = " ".join(f"{name} {round(value, 2) + 0.0:+.2f}" for name, value in hit["terms"].items())
            state = "recalled" if hit["reliable"] else "passed over"
            content = f"{one_line(hit['record']['content'])}\n{terms}"
            rows.append((hit["record"]["id"], state, f"{hit['score']:.3f}", content))
        if not rows:
            return ["Nothing is similar."]
        recalled = sum(hit["reliable"] for hit in data["found"]) or "none"
        columns = ("id", "would be", "score", "content and score terms")
        return [_table(columns, rows), f"A recall for these words would show {recalled} of them."]

    return Answer({"query": words, "found": found}, shown)


def stats(request: Request) -> Answer:
    """The numbers of records by state and type, of events and bytes, and the head of the chain."""
    with request.store() as store:
        counts = store.stats(request.config.bank)
        data = {"database": store.name, "banks": store.banks(), "bank": request.config.bank, **counts}
    data["head"] = f"{counts['seq']}:{counts['hash']}"
    rows = [
        (name, _value(name, value)) for name, value in data.items() if name not in ("seq", "hash", "head")
    ]
    return Answer(data, lambda data: [_table(("what", "value"), rows), f"Head of the chain: {data['head']}"])


def verify(request: Request) -> Answer:
    """Check the chain of events, the rows and the vectors; the exit status is 1 when something is wrong."""
    with request.knowledge_bank() as bank:
        problems = bank.verify(head=request.config.head)
        counts = bank.stats()

    def shown(data: Mapping[str, Any]) -> Sequence[Table | str]:
        if not problems:
            events = count(counts["events"], "event")
            return [f"The bank '{request.config.bank}' is sound: {events}, and all rows agree."]
        rows = [(problem.where, problem.id, problem.what) for problem in problems]
        advice = "Unreadable rows are not recalled; rows edited outside gvla2 are used as they are."
        return [_table(("where", "id", "what"), rows), f"{count(len(problems), 'problem')}. {advice}"]

    head = f"{counts['seq']}:{counts['hash']}"
    data = {"bank": request.config.bank, "sound": not problems, "problems": problems, "head": head}
    return Answer(data, shown, status=int(bool(problems)))


def import_records(request: Request) -> Answer:
    """Read JSON lines; the exit status is 1 when lines could not be read (the others are stored)."""
    config = request.config
    path = Path("/dev/stdin" if request.words[0] == "-" else request.words[0]).expanduser()
    if not os.path.exists(path):  # noqa: PTH110  # too long names; before a database is made for nothing
        raise MemoryStoreError(f"There is nothing at {path}. Give a .jsonl file.")
    with request.knowledge_bank(create=True) as bank:
        done = bank.import_(path, trusted=config.trusted)
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
    lines += done.broken[:ROWS_SHOWN]
    return Answer(done, lambda _: lines, status=int(bool(done.broken)))


def export(request: Request) -> Answer:
    """Write the bank as a file of JSON lines that import reads."""
    from gvla2.memory.transfer import export_jsonl

    config = request.config
    with request.store() as store:
        done = export_jsonl(
            store, config.bank, Path(request.words[0]).expanduser(), states=config.states or None
        )
    line = f"{count(done.records, 'record')}: {done.file}."
    left_out = f" Left out: {count(done.left_out, 'record')} of other states." if done.left_out else ""
    return Answer(done, lambda _: [line + left_out])


def forget(request: Request) -> Answer:
    """Remove records permanently, after asking."""
    with request.store() as store:
        with store.reading(request.config.bank) as view:
            records = [find_record(view, word, whole=request.yes) for word in dict.fromkeys(request.words)]
        if not request.yes:
            for record in records:
                print(f"{printable(record.id)}: {one_line(record.content, 200)}", file=sys.stderr)
            if not _confirmed():
                return Answer({"forgotten": []}, lambda _: ["Nothing was forgotten."], status=1)
        with store.writing(request.config.bank, actor=ACTOR, now=time.time()) as transaction:
            gone = transaction.forget(*(record.id for record in records), why="asked for")
    return Answer({"forgotten": gone}, lambda _: [f"Forgotten: {', '.join(gone) or 'nothing'}."])


def _confirmed() -> bool:
    if not sys.stdin.isatty():
        raise ConfigurationError(
            "Forgetting cannot be undone, and there is no terminal to ask on: add --yes."
        )
    print("Forget permanently? It cannot be undone. [y/N] ", end="", file=sys.stderr, flush=True)
    return sys.stdin.readline().strip().casefold() in ("y", "yes")


def govern(request: Request) -> Answer:
    """One pass over the bank: stale failures, contradictions, the budget."""
    with request.knowledge_bank() as bank:
        return Answer(bank.govern(), _changes)


VERBS: Mapping[str, tuple[Callable[[Request], Answer], Mapping[str, str | None], Sequence[str]]] = {
    "list": (list_records, {}, ("states=[active]", "limit=20")),
    "show": (show, {"ID": None}, ()),
    "search": (search, {"WORDS": "+"}, ("retriever=semantic", "embedder=minilm", "limit=20")),
    "stats": (stats, {}, ()),
    "verify": (verify, {}, ("head=SEQ:HASH",)),
    "import": (import_records, {"PATH": None}, ("trusted=true",)),
    "export": (export, {"PATH": None}, ("states=[active]",)),
    "forget": (forget, {"ID": "+"}, ()),
    "govern": (govern, {}, ()),
}
"""The verbs: function, words as argparse takes them, notable options."""

_OVERRIDE = re.compile(r"[+~]{0,2}[A-Za-z_][\w./@:-]*=.*", re.DOTALL)
_NAMES = ("bank", "url", "head")
"""Options that are taken as typed: to Hydra bank=2026_11 would be a number, and bank=a,b a sweep."""


def main(argv: Sequence[str]) -> int:
    """Entry of ``gvla2 memory``: 0 success, 1 not found, problems found or an error, 2 wrong usage."""
    from gvla2.commands.hydra_job import composed, report

    end = list(argv).index("--") if "--" in argv else len(argv)
    overrides = [word for word in argv[:end] if _OVERRIDE.fullmatch(word)]
    names = {name: text for name, _, text in (word.partition("=") for word in overrides) if name in _NAMES}
    words = [word for word in argv[:end] if not _OVERRIDE.fullmatch(word)]
    asked = parser().parse_args([*words, *argv[end:]])
    if asked.verb == "forget" and asked.json and not asked.yes:
        parser().error("--json cannot ask for consent: it needs --yes")
    function, arguments, _ = VERBS[asked.verb]
    given = [getattr(asked, name) for name in arguments]
    given = given[0] if given and isinstance(given[0], list) else given
    try:
        config, registry = composed("memory", [o for o in overrides if o.partition("=")[0] not in _NAMES])
        config = dataclasses.replace(config, **names)
        answer = function(Request(given, config, registry, getattr(asked, "yes", False)))
    except Exception as error:
        status = report(error)
        if asked.json:
            print(json.dumps({"error": printable(str(error))}))
        return status
    return _print(answer, config.limit, as_json=asked.json)


def parser() -> argparse.ArgumentParser:
    """The command line of ``gvla2 memory``, besides overrides."""
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


def _print(answer: Answer, limit: int | None, *, as_json: bool) -> int:
    from rich.text import Text

    from gvla2.commands.tables import console
    from gvla2.io.files import plain

    data = plain(answer.data)
    rows = ROWS_SHOWN if limit is None and not as_json else limit or None
    left_out = max(0, len(data) - rows) if isinstance(data, list) and rows else 0
    if isinstance(data, list):
        data = data[:rows]
    if as_json:
        text = json.dumps(data, indent=2, ensure_ascii=False, allow_nan=False)
        sys.stdout.write(text.encode("utf-8", "replace").decode() + "\n")
        return answer.status
    out = console()
    for part in answer.show(data):
        if isinstance(part, str):
            out.print(Text(printable(part)), soft_wrap=True)
        else:
            out.print(part)
    if left_out:
        out.print(f"{len(data)} of {len(data) + left_out} are shown; limit=0 shows all.")
    return answer.status


def _table(columns: Sequence[str], rows: Sequence[Sequence[str]]) -> Table:
    from gvla2.commands.tables import row, table

    made = table(*columns)
    for cells in rows:
        row(made, *cells)
    return made


def _records_table(records: Sequence[Mapping[str, Any]]) -> Sequence[Table | str]:
    rows = [
        (r["id"], r["state"], r["outcome"], f"{r['confidence']:.2f}", one_line(r["content"])) for r in records
    ]
    columns = ("id", "state", "outcome", "confidence", "content")
    return [_table(columns, rows) if rows else "The bank has no such records."]


def _events_table(events: Sequence[Mapping[str, Any]]) -> Table:
    rows = []
    for event in events:
        changes = event["change"] if isinstance(event["change"], dict) else {}
        pairs = {k: v for k, v in changes.items() if isinstance(v, list) and len(v) == 2}
        change = "; ".join(f"{k}: {_value(k, old)} -> {_value(k, new)}" for k, (old, new) in pairs.items())
        action = f"{event['action']} {event['target'] or ''}".strip()
        why = "(forgotten)" if event["erased"] else one_line(event["why"])
        rows.append((str(event["seq"]), _date(event["at"]), event["actor"], action, why, one_line(change)))
    return _table(("event", "time", "who", "action", "why", "change"), rows)


def _changes(data: Mapping[str, Any]) -> Sequence[Table | str]:
    """A row for each change of a pass."""
    rows = [
        (name, one_line(_value(name, item), 300))
        for name, value in data.items()
        for item in (value if isinstance(value, list) else [value])
        if item not in (0, None, "", {}, [])
    ]
    return [_table(("what", "which"), rows) if rows else "Nothing needed a change."]


def _columns(row: Any, *names: str) -> dict[str, Any]:
    """A record's or event's fields with JSON columns parsed; a damaged one stays text."""
    data: dict[str, Any] = {f.name: getattr(row, f.name) for f in dataclasses.fields(row)}
    for name in names or ("verifier", "signature", "effect", "provenance"):
        with suppress(ValueError):
            data[name] = json.loads(data[name]) if data[name] else None
    return data


def _event(event: Event) -> dict[str, Any]:
    return _columns(event, "scores", "change") | {"erased": event.erased}


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
