"""Does a bank match its chain of events? Finds damage and tampering."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

from gvla2.errors import MemoryStoreError
from gvla2.memory.events import GENESIS, Event, StoredEpisode, digest_of, payload_digest, row_digest
from gvla2.memory.records import Record, damage_of
from gvla2.memory.view import BankView


@dataclass(frozen=True, slots=True)
class Problem:
    """A problem of a bank: ``where`` (chain, event, record, link, episode), which ``id``."""

    where: str
    id: str
    what: str

    def __str__(self) -> str:
        return f"{self.where} {self.id}: {self.what}." if self.id else f"{self.where}: {self.what}."


@dataclass
class _Expected:
    """What the events say of the rows: digests of records by id, links, digests of episodes by source."""

    records: dict[str, str] = field(default_factory=dict)
    links: set[tuple[str, str, str]] = field(default_factory=set)
    episodes: dict[str, str] = field(default_factory=dict)
    sources: dict[str, str] = field(default_factory=dict)
    """The source of an episode by its name in the events."""

    def follow(self, event: Event) -> None:
        """Take in the next event."""
        verb, _, kind = event.action.partition(":")
        if verb == "link":
            self.links.add((event.record, kind, event.target))
        elif verb == "forget":
            self.links = {link for link in self.links if event.record not in (link[0], link[2])}
            self.episodes.pop(self.sources.get(event.record, ""), None)
        elif verb == "episode" and not event.erased:
            change = event.change_json()
            source = self.sources[event.record] = str(change.get("source"))
            self.episodes[source] = str(change.get("episode"))
        if event.state:
            self.records[event.record] = event.state


def audit(view: BankView, head: str = "") -> list[Problem]:
    """The problems of a bank: its chain, payloads, and rows against events; [] if there are none.

    ``head`` is "SEQ:HASH" of an event from earlier statistics of the bank, kept elsewhere: with it, a truncated or
    rewritten chain is found as well.
    """
    expected = _Expected()
    problems = list(_chain(view, expected))
    problems += _kept_head(view, head) if head else ()
    for row in view.rows():
        digest = expected.records.pop(str(row.id), None)
        if damage := damage_of(tuple(row)):
            problems.append(Problem("record", str(row.id), f"damaged: {damage}"))
        elif digest is None:
            problems.append(Problem("record", row.id, "no event created it"))
        elif row_digest(Record(*tuple[Any, ...](row))) != digest:
            problems.append(Problem("record", row.id, "it differs from what its last event stored"))
    links = {(link.source, link.kind, link.target) for link in view.links()}
    for link in sorted(links ^ expected.links):
        problems.append(Problem("link", " ".join(link), "it is not in both rows and events"))
    for row in view.episode_rows():
        digest = expected.episodes.pop(row.source, None)
        try:
            StoredEpisode.from_json(row.source, row.at, row.data)
            if digest != digest_of(row.at, row.data):
                problems.append(Problem("episode", str(row.source), "it is not what was stored"))
        except ValueError as error:
            problems.append(Problem("episode", str(row.source), f"damaged: {error}"))
    missing = {"record": expected.records, "episode": expected.episodes}
    for where, due in missing.items():
        problems += [Problem(where, id, "the events have it, the rows do not") for id in sorted(due)]
    return problems


def _chain(view: BankView, expected: _Expected) -> Iterator[Problem]:
    """Walk the events: numbers, hashes, digests, times."""
    prev, seq, rev, at = GENESIS, 0, 0, -math.inf
    erased: list[Event] = []
    forgotten: dict[str, int] = {}
    for event in view.events():
        where = str(event.seq)
        if event.damage:
            yield Problem("event", where, event.damage)
            prev, seq = event.hash, seq + 1
            continue
        if event.seq != seq + 1:
            yield Problem("chain", where, f"events {seq + 1} to {event.seq - 1} are missing")
        elif event.prev != prev:
            yield Problem("chain", where, "it does not follow the event before it")
        if digest_of(event.prev, *event.header, event.digest) != event.hash:
            yield Problem("event", where, "its header was changed: the hash differs")
        if event.erased:
            erased.append(event)
        elif payload_digest(event.salt, event.payload) != event.digest:
            yield Problem("event", where, "its content was changed: the digest differs")
        if event.at < at or event.rev < rev:
            yield Problem("event", where, "it is older than the event before it")
        if event.action == "forget":
            forgotten[event.record] = event.seq
        try:
            expected.follow(event)
        except (ValueError, RecursionError):
            yield Problem("event", where, "its change is not valid JSON")
        prev, seq, rev, at = event.hash, event.seq, event.rev, event.at
    for event in erased:
        if max(forgotten.get(event.record, 0), forgotten.get(event.target, 0)) <= event.seq:
            yield Problem("event", str(event.seq), "it was erased, and nothing was forgotten afterwards")
    head = view.head
    if head is None and seq:
        yield Problem("chain", "", "the bank's own row is missing")
    elif head is not None and (head.rev, head.seq, head.hash) != (rev, seq, prev):
        differs = f"event {head.seq}" if head.seq != seq else "a different hash or transaction number"
        yield Problem("chain", "", f"it ends with event {seq}, the bank's own row says {differs}")


def _kept_head(view: BankView, head: str) -> Iterator[Problem]:
    """Whether the chain still has an event that was its last once."""
    place, _, hash_ = head.strip().partition(":")
    if not place.isdecimal() or not hash_:
        why = "is not the head of a chain: give SEQ:HASH from a bank's statistics"
        raise MemoryStoreError(f"{head!r} {why}.")
    event = next(view.events(int(place) - 1), None)
    if event is None or event.seq != int(place):
        yield Problem("chain", place, "the head kept elsewhere is missing: the chain was truncated")
    elif event.hash != hash_:
        yield Problem("chain", place, "it differs from the head kept elsewhere: the chain was rewritten")
