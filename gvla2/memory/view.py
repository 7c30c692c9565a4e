"""Reading a bank at one instant: its valid rows, and whether they match its chain of events."""

from __future__ import annotations

import math
from collections import Counter, defaultdict
from collections.abc import Collection, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from sqlalchemy import Connection, Row, Select, func, select

from gvla2.errors import MemoryStoreError
from gvla2.memory.records import COLUMNS, FORGOTTEN, Record, damage_of, load_object
from gvla2.memory.tables import (
    BANK,
    EPISODE,
    EVENT,
    GENESIS,
    HEADER,
    LINK,
    PAYLOAD,
    RECORD,
    VECTOR,
    Link,
    StoredEpisode,
    digest_of,
    event_damage,
    payload_digest,
    row_digest,
)

Wanted = Collection[str] | None
"""Names to select; None for all."""
_STATE = COLUMNS.index("state")
_TOGETHER = 500
"""How many ids one query names, and how many rows of a stream are held at once."""


class Embedded(NamedTuple):
    """A record with its (D,) float32 ``vector`` made by ``model``, read-only; None if it is damaged or missing.

    ``conflicts`` is how many others contradict the record.
    """

    record: Record
    vector: NDArray[np.float32] | None
    model: str
    conflicts: int


class BankView:
    """A bank at one instant. Damaged rows are skipped; :func:`audit` reports them."""

    def __init__(self, sql: Connection, bank: str) -> None:
        self.sql, self.bank = sql, bank

    @cached_property
    def head(self) -> Row[Any] | None:
        """The bank's own row (a damaged one raises). Its seq and hash, kept elsewhere, prove a whole chain."""
        row = self.sql.execute(select(BANK).where(BANK.c.bank == self.bank)).one_or_none()
        if row is not None and tuple(map(type, row)) != (str, int, int, str, float):
            raise MemoryStoreError(
                f"The bank '{self.bank}' has a damaged row: restore the database from a copy."
            )
        return row

    @property
    def rev(self) -> int:
        """The number of the bank's last transaction, 0 for none."""
        return int(self.head.rev) if self.head else 0

    def get(self, id: str) -> Record | None:
        """The record, None if it is missing, damaged or forgotten."""
        return next(iter(self.records(ids=[id])), None)

    def by_key(self, key: str) -> Record | None:
        """The record of a dedup key."""
        row = self.sql.execute(self._of(RECORD).where(RECORD.c.dedup_key == key)).one_or_none()
        return None if row is None else valid_record(row)

    def records(self, states: Wanted = None, ids: Wanted = None) -> list[Record]:
        """The records in these states, with these ids (all by default; never forgotten ones), by id."""
        found = [record for row in self.rows(states, ids) if (record := valid_record(row)) is not None]
        return sorted(found, key=lambda record: record.id)

    def rows(self, states: Wanted = None, ids: Wanted = None) -> Iterator[Row[Any]]:
        """The stored rows, damaged or not, including tombstones."""
        query = self._of(RECORD)
        query = query if states is None else query.where(RECORD.c.state.in_(states))
        return self._named(query, RECORD.c.id, ids)

    def embedded(self, states: Collection[str]) -> list[Embedded]:
        """The records in these states with their vectors; a conflict with one that is in no such state is settled."""
        joined = RECORD.outerjoin(VECTOR, (VECTOR.c.bank == RECORD.c.bank) & (VECTOR.c.id == RECORD.c.id))
        query = select(VECTOR.c.model, VECTOR.c.dimension, VECTOR.c.vector, RECORD)
        query = query.select_from(joined).where(RECORD.c.bank == self.bank, RECORD.c.state.in_(states))
        found = [
            (record, vector_of(dimension, stored), model or "")
            for model, dimension, stored, *row in self.sql.execute(query)
            if (record := valid_record(row)) is not None
        ]
        held, pairs = {record.id for record, *_ in found}, pairs_of(self.links())["conflict"]
        against = Counter(id for pair in pairs if held.issuperset(pair) for id in pair)
        return [Embedded(record, vector, model, against[record.id]) for record, vector, model in found]

    def links(self, ids: Wanted = None) -> list[Link]:
        """The links of the bank, or those with one of these records at either end; by source, kind, target."""
        query = self._of(LINK, LINK.c.source, LINK.c.kind, LINK.c.target, LINK.c.at)
        ends = (LINK.c.source, LINK.c.target) if ids is not None else (LINK.c.source,)
        found = {tuple(row) for end in ends for row in self._named(query, end, ids)}
        return [Link(*row) for row in sorted(row for row in found if set(map(type, row[:3])) == {str})]

    def events(self) -> Iterator[Row[Any]]:
        """The rows of the events, damaged or not, oldest first, a few at a time."""
        return self._named(self._of(EVENT).order_by(EVENT.c.seq), EVENT.c.record, None)

    def history(self, id: str) -> list[Row[Any]]:
        """The events about one record, oldest first."""
        query = self._of(EVENT).where(EVENT.c.record == id).order_by(EVENT.c.seq)
        return [event for event in self.sql.execute(query) if not event_damage(event)]

    def episodes(self, sources: Wanted = None) -> dict[str, StoredEpisode]:
        """The stored episodes by source, of these sources or all."""
        found = {}
        for row in self.episode_rows(sources):
            with suppress(ValueError):  # damaged: the audit reports it
                found[row.source] = StoredEpisode.from_json(row.source, row.at, row.data)
        return found

    def episode_rows(self, sources: Wanted = None) -> Iterator[Row[Any]]:
        """The rows of the stored episodes, damaged or not."""
        return self._named(self._of(EPISODE), EPISODE.c.source, sources)

    def counts(self) -> dict[str, Any]:
        """Numbers about the bank: records by state and type, counts of everything else, and the head of its chain."""
        tables = {"vectors": VECTOR, "links": LINK, "events": EVENT, "episodes": EPISODE}
        counted = {name: self.sql.scalar(self._of(table, func.count())) for name, table in tables.items()}
        for name, column in (("states", RECORD.c.state), ("types", RECORD.c.type)):
            query = self._of(RECORD, column, func.count()).group_by(column)
            counted[name] = {str(key): n for key, n in self.sql.execute(query) if key}
        seq, hash_ = (self.head.seq, self.head.hash) if self.head else (0, "")
        return {**counted, "rev": self.rev, "seq": seq, "hash": hash_}

    def _of(self, table: Any, *columns: Any) -> Select[Any]:
        """The bank's rows of a table, all columns or these."""
        return select(*columns or (table,)).where(table.c.bank == self.bank)

    def _named(self, query: Select[Any], column: Any, wanted: Wanted) -> Iterator[Row[Any]]:
        """The rows of a query, those whose ``column`` is among the ``wanted``, asked for a few at a time."""
        if wanted is None:
            options = {"stream_results": True, "max_row_buffer": _TOGETHER}
            yield from self.sql.execute(query, execution_options=options)
        for some in batches(wanted or ()):
            yield from self.sql.execute(query.where(column.in_(some))).all()


def pairs_of(links: Iterable[Link]) -> dict[str, set[tuple[str, str]]]:
    """The linked pairs of records by kind of link, in either direction.

    ``conflict``: they contradict each other; ``dismissed``: a judge found that they don't.
    """
    pairs: dict[str, set[tuple[str, str]]] = defaultdict(set)
    for link in links:
        pairs[link.kind].add((min(link.source, link.target), max(link.source, link.target)))
    return pairs


def batches(values: Iterable[Any]) -> Iterator[list[Any]]:
    """Distinct values in order, as many at a time as one statement allows."""
    ordered = sorted(set(values), key=str)
    return (ordered[start : start + _TOGETHER] for start in range(0, len(ordered), _TOGETHER))


def valid_record(row: Sequence[Any]) -> Record | None:
    """The record of a stored row; None for a damaged row and a tombstone."""
    return None if row[_STATE] == FORGOTTEN or damage_of(tuple(row)) else Record(*row)


def vector_of(length: object, stored: object) -> NDArray[np.float32] | None:
    """The (D,) vector of stored bytes, None if they are damaged: wrong length, or not finite."""
    if not isinstance(stored, bytes) or not stored or type(length) is not int or len(stored) != 4 * length:
        return None
    vector = np.frombuffer(stored, dtype="<f4")
    return vector if np.isfinite(vector).all() else None


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

    def follow(self, event: Row[Any]) -> None:
        """Take in the next event."""
        verb, _, kind = event.action.partition(":")
        if verb == "link":
            self.links.add((event.record, kind, event.target))
        elif verb == "forget":
            self.links = {link for link in self.links if event.record not in (link[0], link[2])}
            self.episodes.pop(self.sources.get(event.record, ""), None)
        elif verb == "episode" and event.salt:
            change = load_object(event.change)
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
    problems = list(_chain(view, expected, head.strip()))
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
        try:
            stored = digest_of(row.at, row.data)
        except (TypeError, ValueError):
            stored = "damaged"
        if expected.episodes.pop(row.source, "") != stored:
            problems.append(Problem("episode", str(row.source), "it is not what was stored"))
    missing = {"record": expected.records, "episode": expected.episodes}
    for where, due in missing.items():
        problems += [Problem(where, id, "the events have it, the rows do not") for id in sorted(due)]
    return problems


def _chain(view: BankView, expected: _Expected, kept: str) -> Iterator[Problem]:
    """Walk the events: numbers, hashes, digests, times; and whether ``kept`` "SEQ:HASH" is one of them."""
    prev, seq, rev, at = GENESIS, 0, 0, -math.inf
    erased: list[Row[Any]] = []
    forgotten: dict[str, int] = {}
    heads = set[str]()
    for event in view.events():
        where = str(event.seq)
        if damage := event_damage(event):
            yield Problem("event", where, damage)
            prev, seq = event.hash, seq + 1
            continue
        if event.seq != seq + 1:
            yield Problem("chain", where, f"events {seq + 1} to {event.seq - 1} are missing")
        elif event.prev != prev:
            yield Problem("chain", where, "it does not follow the event before it")
        header, payload = ([getattr(event, name) for name in names] for names in (HEADER, PAYLOAD))
        if digest_of(event.prev, *header, event.digest) != event.hash:
            yield Problem("event", where, "its header was changed: the hash differs")
        if not event.salt:
            erased.append(event)
        elif payload_digest(event.salt, payload) != event.digest:
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
        heads.add(f"{seq}:{prev}")
    for event in erased:
        if max(forgotten.get(event.record, 0), forgotten.get(event.target, 0)) <= event.seq:
            yield Problem("event", str(event.seq), "it was erased, and nothing was forgotten afterwards")
    head = view.head
    if head is None and seq:
        yield Problem("chain", "", "the bank's own row is missing")
    elif head is not None and (head.rev, head.seq, head.hash) != (rev, seq, prev):
        differs = f"event {head.seq}" if head.seq != seq else "a different hash or transaction number"
        yield Problem("chain", "", f"it ends with event {seq}, the bank's own row says {differs}")
    if kept and kept not in heads:
        yield Problem("chain", "", f"it lacks the event {kept} kept elsewhere: it was truncated or rewritten")
