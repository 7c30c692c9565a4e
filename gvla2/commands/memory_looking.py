"""The read-only verbs of `gvla2 memory`: list, show, search, history, as-of, conflicts, stats, verify."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any, TypeVar

from gvla2.commands.memory_access import NotFoundError, VerbRequest, opened, opened_bank, record_of, time_of
from gvla2.commands.memory_answers import Answer, clock, read_columns, record_data, records_listing, shortened
from gvla2.commands.tables import Listing, row, table
from gvla2.memory.records import Record
from gvla2.memory.storage.events import Event
from gvla2.memory.storage.view import pairs_of
from gvla2.record.text import count, listing, one_line

T = TypeVar("T")
_TIMES = ("created", "updated", "used")
"""A record's fields that are seconds since the epoch."""
MOST_SUSPECTED = 5
"""Pairs that are named by `conflicts` though nothing is decided about them."""
_SERVED = (
    "Unreadable rows are not recalled; rows edited outside gvla2 are used as they are, "
    "until `gvla2 memory repair` restores them from the events."
)


def list_records(request: VerbRequest) -> Answer:
    """The records of the bank."""
    with opened(request) as store, store.reading(request.bank) as view:
        records = view.records(request.config.states or None)
    return _listing(
        sorted(records, key=lambda r: (-r.updated, r.id)), request, "The bank has no such records."
    )


def show(request: VerbRequest) -> Answer:
    """Everything about one record, its links and its last events."""
    with opened(request) as store, store.reading(request.bank) as view:
        record = record_of(view, request.words[0])
        links, events = view.links([record.id]), view.history(record.id)
    listing = table("field", "value")
    for name, value in record_data(record).items():
        row(listing, name, _value(name, value))
    for link in links:
        way = f"{link.kind} {link.target}" if link.source == record.id else f"{link.kind} of {link.source}"
        row(listing, "link", way)
    data = {"record": record_data(record), "links": links, "events": [_event_data(e) for e in events]}
    return Answer(data, [listing, events_listing(events[-10:])])


def search(request: VerbRequest) -> Answer:
    """The records that match the words, best first, with every term of their scores."""
    words = " ".join(request.words)
    with opened_bank(request) as bank:
        hits = bank.search(words, request.limit or len(bank.records()))
    data = {
        "query": words,
        "found": [
            {
                "record": record_data(h.record),
                "score": h.score,
                "terms": dict(h.terms),
                "reliable": h.reliable,
            }
            for h in hits
        ],
    }
    if not hits:
        return Answer(data, ["Nothing is similar."])
    rows = [
        (
            hit.record.id,
            "recalled" if hit.reliable else "passed over",
            f"{hit.score:.3f}",
            one_line(hit.record.content, 120),
            " ".join(f"{name} {round(value, 2) + 0.0:+.2f}" for name, value in hit.terms.items()),
        )
        for hit in hits
    ]
    columns = ("id", "would be", "score", "content", "terms")
    reliable = sum(hit.reliable for hit in hits)
    told = f"A recall for these words would show {reliable or 'none'} of them."
    return Answer(data, [Listing(columns, rows, prose=columns[3:]), told])


def history(request: VerbRequest) -> Answer:
    """A record's events, oldest first; forgotten records too."""
    with opened(request) as store, store.reading(request.bank) as view:
        events = view.history(request.words[0]) or view.history(record_of(view, request.words[0]).id)
    return _bounded(events, request, events_listing, _event_data)


def as_of(request: VerbRequest) -> Answer:
    """The records as they were at a time, or one of them."""
    at = time_of(request.words[0])
    with opened(request) as store, store.reading(request.bank) as view:
        records = list(view.rebuilt(at).records)
    if len(request.words) > 1:
        records = [record for record in records if record.id.startswith(request.words[1])]
        if not records:
            raise NotFoundError(
                f"The bank '{request.bank}' had no record '{request.words[1]}' at {clock(at)}."
            )
    if request.config.states:
        records = [record for record in records if record.state in request.config.states]
    return _listing(records, request, f"The bank had no records at {clock(at)}.")


def conflicts(request: VerbRequest) -> Answer:
    """Pairs of records that contradict each other; those only suspected of it are named."""
    with opened(request) as store, store.reading(request.bank) as view:
        linked = pairs_of(view.links())
        there = {record.id: record for record in view.records()}
    pairs = [(there[a], there[b]) for a, b in sorted(linked["conflict"]) if a in there and b in there]
    suspected = sorted(linked["suspicion"] - linked["conflict"] - linked["dismissed"])
    named = listing((f"{a} with {b}" for a, b in suspected), MOST_SUSPECTED)
    more = [f"Suspected of it, and not yet judged: {named}."] if suspected else []
    if not pairs:
        return Answer([], ["No records contradict each other.", *more])
    columns = ("id", "state", "says", "against", "its state", "which says")
    answer = _bounded(
        pairs,
        request,
        lambda shown: Listing(
            columns,
            [[w for r in p for w in (r.id, r.state, one_line(r.content, 90))] for p in shown],
            prose=("says", "which says"),
        ),
        lambda pair: {"records": [record_data(record) for record in pair]},
    )
    return replace(answer, shown=[*answer.shown, *more])


def stats(request: VerbRequest) -> Answer:
    """How many records there are of each state and type, and how large everything is; for every bank without one."""
    with opened(request) as store:
        counts = store.stats(request.bank)
        data = {
            "database": store.name,
            "banks": store.banks(),
            "bank": request.bank,
            **counts,
            "head": _head(counts),
        }
    listing = table("what", "how many")
    for name, value in data.items():
        if name in ("seq", "hash", "head"):
            continue  # below, in one piece
        told = ", ".join(f"{k} {v}" for k, v in value.items()) if isinstance(value, dict) else value
        row(listing, name, ", ".join(told) if isinstance(told, list) else str(told))
    return Answer(data, [listing, f"Head of the chain: {data['head']}"])


def verify(request: VerbRequest) -> Answer:
    """Check the chain of events, the rows and the vectors; returns 1 when something is wrong."""
    with opened_bank(request) as bank:
        problems = bank.verify(head=request.config.head)
        counts = bank.stats()
    data = {"bank": request.bank, "sound": not problems, "problems": problems, "head": _head(counts)}
    if not problems:
        told = f"The bank '{request.bank}' is sound: {count(counts['events'], 'event')}, and all rows agree."
        return Answer(data, [told])
    rows = [(p.where, p.id, p.what) for p in problems]
    told = f"{count(len(problems), 'problem')}."
    if any(problem.where == "record" for problem in problems):
        told += f" {_SERVED}"
    return Answer(data, [Listing(("where", "id", "what"), rows, ("what",), "red"), told], status=1)


def _head(counts: Mapping[str, Any]) -> str:
    """The head of the chain as `verify head=` takes it."""
    return f"{counts['seq']}:{counts['hash']}"


def events_listing(events: Sequence[Event]) -> Listing:
    """One row per event."""
    rows = [
        (
            str(event.seq),
            clock(event.at),
            event.actor,
            event.action + (f" {event.target}" if event.target else ""),
            "(forgotten)" if event.erased else one_line(event.why, 120),
            one_line(_change_words(event), 200),
        )
        for event in events
    ]
    return Listing(("event", "time", "who", "what", "why", "change"), rows, prose=("why", "change"))


def _change_words(event: Event) -> str:
    if event.action.partition(":")[0] == "forget":
        return ""
    try:
        change = event.change_json()
    except ValueError:
        return "(damaged)"
    parts = []
    for name, value in change.items():
        if isinstance(value, list) and len(value) == 2:
            before, after = (one_line(_short(name, v), 40) for v in value)
            parts.append(f"{name}: {before} -> {after}")
    return "; ".join(parts) if parts else ("created" if "content" in change else "")


def _short(name: str, value: Any) -> str:
    if name in _TIMES and isinstance(value, int | float):
        return clock(value) if value else "never"
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def _event_data(event: Event) -> dict[str, Any]:
    return read_columns(event, "scores", "change") | {"erased": event.erased}


def _listing(records: Sequence[Record], request: VerbRequest, nothing: str) -> Answer:
    if not records:
        return Answer([], [nothing])
    return _bounded(records, request, records_listing, record_data)


def _bounded(
    items: Sequence[T],
    request: VerbRequest,
    laid_out: Callable[[Sequence[T]], Listing],
    data_of: Callable[[T], Any],
) -> Answer:
    """The requested number of items: a listing, and a JSON document with its own bound."""
    shown, more = shortened(items, request.limit)
    data = [data_of(item) for item in shortened(items, request.data_limit)[0]] if request.json else []
    return Answer(data, [laid_out(shown), *([more] if more else [])])


def _value(name: str, value: Any) -> str:
    if isinstance(value, dict | list):
        return json.dumps(value, ensure_ascii=False)[:4000]
    return "" if value is None else _short(name, value)
