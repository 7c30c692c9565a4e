"""Writing to a bank, atomically: rows, and the events that explain them, at the head of its chain."""

from __future__ import annotations

import math
import os
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sqlalchemy import Connection, Row, Table, bindparam, delete, insert, update

from gvla2.errors import MemoryStoreError
from gvla2.memory.events import (
    BANK,
    EPISODE,
    EVENT,
    EVENT_COLUMNS,
    GENESIS,
    LINK,
    RECORD,
    VECTOR,
    Link,
    StoredEpisode,
    chain_hash,
    episode_digest,
    payload_digest,
    row_digest,
)
from gvla2.memory.records import COLUMNS, FORGOTTEN, TYPES, Record, as_json, clean, damage_of, dump, finite
from gvla2.memory.view import BankView, batches, sound

MAX_WHY = 2000
MAX_TEXT = 2_000_000
"""Characters that one column may hold."""
LATEST = 253402300799.0
"""The last second of the year 9999: calendars end there, and later times could not follow it."""
RESERVED = frozenset({"link", "forget", "episode"})
"""Actions that the store itself writes."""
_UPDATE = update(RECORD).where((RECORD.c.bank == bindparam("b_bank")) & (RECORD.c.id == bindparam("b_id")))


@dataclass(frozen=True)
class Put:
    """One record to be stored and the decision behind it, see :meth:`Writing.put_many`."""

    record: Record
    action: str
    vector: NDArray[np.floating[Any]] | None = None
    model: str = ""
    why: str = ""
    scores: Mapping[str, float] = field(default_factory=dict)
    origin: str = ""


class StaleRecordError(MemoryStoreError):
    """A record was changed by another process after it was read: read it again and decide again."""


class Writing(BankView):
    """Changes of one bank under one ``rev``, made by ``actor`` at ``now`` (never before the bank's last change).

    It holds the bank's write lock, so reads stay valid until the end. Reasons (``why``) and a record's ``note`` may
    name other records by id, but must not quote them: forgetting a record does not search for its words in the reasons
    of others (except of links to it).
    """

    def __init__(self, sql: Connection, bank: str, actor: str, now: float) -> None:
        if not abs(now) <= LATEST:
            due = "a finite number of seconds, before the year 10000"
            raise MemoryStoreError(f"The time of a change must be {due}, not {now}.")
        super().__init__(sql, bank)
        head, self._actor = self.head, clean(actor, 200)
        self._rev = super().rev + 1
        self.now = max(float(now), head.at) if head else float(now)
        self._seq, self._hash = (int(head.seq), str(head.hash)) if head else (0, GENESIS)
        self._began, self._half = self._seq, False

    @property
    def rev(self) -> int:
        """The number of this transaction."""
        return self._rev

    # Records ------------------------------------------------------------------------------------------------------

    def put(
        self,
        record: Record,
        action: str,
        *,
        vector: NDArray[np.floating[Any]] | None = None,
        model: str = "",
        why: str = "",
        origin: str = "",
    ) -> Record:
        """Store one record, see :meth:`put_many`."""
        return self.put_many([Put(record, action, vector, model, why, origin=origin)])[0]

    def put_many(self, puts: Sequence[Put]) -> list[Record]:
        """Store records, each id once, and the events that explain them; returns them as stored.

        A record of version 0 is new; any other must be of the version that is stored, or :class:`StaleRecordError` is
        raised. A ``vector`` (D,) is the embedding of its text by ``model``; without one the stored vector stays, unless
        the text changed. ``origin`` is the source of the evidence, "" for none. Raises :class:`MemoryStoreError` for
        what :func:`checked` and :func:`vector_row` refuse, before anything is written.
        """
        stored = {row.id: row for row in self.rows(ids=[put.record.id for put in puts])}
        rows: list[tuple[Put, Record, Record | None]] = []
        vectors, outdated = list[dict[str, Any]](), list[str]()
        for put in puts:
            _check_action(put.action)
            record, old = self._next(put.record, stored.get(put.record.id))
            if put.vector is not None:
                vectors.append(vector_row(put.vector, put.model, record.id, self.bank))
            elif record.id in stored and (old is None or old.text != record.text):
                outdated.append(record.id)
            rows.append((put, record, old))
        self.replace_rows([record for _, record, _ in rows if record.id in stored])
        self._do(insert(RECORD), [as_json(record) for _, record, _ in rows if record.id not in stored])
        self.delete(VECTOR, "id", outdated)
        self._do(upsert(self.sql, VECTOR, ("bank", "id")), vectors)
        self.tell(
            self.event(
                put.action,
                record.id,
                why=put.why,
                scores=put.scores or {"quality": record.quality, "confidence": record.confidence},
                change=_difference(old, record) if old else as_json(record),
                origin=put.origin,
                row=record,
            )
            for put, record, old in rows
        )
        return [record for _, record, _ in rows]

    def _next(self, record: Record, row: Row[Any] | None) -> tuple[Record, Record | None]:
        """The record to be stored, and the one that is; a tombstone and a damaged row are replaced."""
        old = sound(row) if row is not None else None
        if record.version != (expected := old.version if old else 0):
            now = f"is of version {expected} by now, not {record.version}: read it again"
            raise StaleRecordError(f"Record '{record.id}' of bank '{self.bank}' {now}.")
        kept = row.version if row is not None and type(row.version) is int else 0
        return checked(record, self.bank, kept + 1, self.rev), old

    def save_vectors(self, model: str, vectors: Sequence[tuple[Record, NDArray[np.floating[Any]]]]) -> None:
        """Store embeddings of records that did not change since they were read.

        Vectors are derived data: this is not an event, and changes no record.
        """
        stored = {row.id: row.version for row in self.rows(ids=[record.id for record, _ in vectors])}
        current = [(one, vector) for one, vector in vectors if stored.get(one.id) == one.version]
        rows = [vector_row(vector, model, one.id, self.bank) for one, vector in current]
        self._do(upsert(self.sql, VECTOR, ("bank", "id")), rows)

    def replace_rows(self, records: Sequence[Record]) -> None:
        """Replace the stored rows of these records' ids, without an event."""
        changed = [name for name in COLUMNS if name not in ("id", "bank")]
        self._do(
            _UPDATE,
            [
                {"b_bank": self.bank, "b_id": one.id, **{name: getattr(one, name) for name in changed}}
                for one in records
            ],
        )

    # Links, decisions, episodes -----------------------------------------------------------------------------------

    def link(self, source: str, kind: str, target: str, why: str = "") -> None:
        """Link two records, unless they are linked so already. Both ends count as changed (rev)."""
        if source == target or not kind or len(self.records(ids=[source, target])) < 2:
            needed = f"it needs two different records of bank '{self.bank}' and a kind"
            raise MemoryStoreError(f"Cannot link '{source}' to '{target}' as '{kind}': {needed}.")
        kind = clean(kind, 64)
        if any((one.source, one.kind, one.target) == (source, kind, target) for one in self.links([source])):
            return
        self._do(insert(LINK), [{"bank": self.bank, **asdict(Link(source, kind, target, self.now))}])
        self.touch([source, target])
        self.tell([self.event(f"link:{kind}", source, target, why)])

    def decide(self, action: str, record: str = "", *, why: str = "") -> None:
        """An event for a decision that changes no row (a lesson was discarded)."""
        _check_action(action)
        self.tell([self.event(action, clean(record, 200), why=why)])

    def save_episodes(self, episodes: Iterable[StoredEpisode]) -> None:
        """Store episodes for replay, each replacing its source's earlier one; digests go on the chain."""
        rows: dict[str, dict[str, Any]] = {}
        for episode in episodes:
            source = clean(episode.source, 200)
            if not source or not math.isfinite(episode.at):
                raise MemoryStoreError("An episode can be stored under a source and with a finite time only.")
            try:
                data = episode.to_json()
            except (ValueError, TypeError, RecursionError) as error:
                raise MemoryStoreError(f"The episode '{source}' is not valid JSON: {error}.") from error
            name, at = f"episode-{os.urandom(8).hex()}", float(episode.at)
            rows[source] = {"bank": self.bank, "source": source, "name": name, "at": at, "data": data}
        for stored in self.episode_rows(rows):
            rows[stored.source]["name"] = stored.name  # it stays
        self._do(upsert(self.sql, EPISODE, ("bank", "source")), list(rows.values()))
        for source, row in rows.items():
            digest = episode_digest(row["at"], row["data"])
            self.tell([self.event("episode", row["name"], change={"episode": digest, "source": source})])

    # The chain ----------------------------------------------------------------------------------------------------

    def event(
        self,
        action: str,
        record: str = "",
        target: str = "",
        why: str = "",
        *,
        scores: Mapping[str, float] | None = None,
        change: Mapping[str, Any] | None = None,
        origin: str = "",
        row: Record | None = None,
    ) -> dict[str, object]:
        """The next event as a row; :meth:`tell` writes it. ``row`` is the record as the event leaves it."""
        payload = (
            clean(why, MAX_WHY),
            dump(finite(scores)) if scores else "{}",
            "" if change is None else dump(dict(change)),
            clean(origin, MAX_WHY),
            row_digest(row) if row else "",
        )
        salt = os.urandom(16)
        digest = payload_digest(salt, payload)
        self._seq += 1
        header = (self.bank, self._seq, self.rev, self.now, self._actor, clean(action, 64), record, target)
        prev, self._hash = self._hash, chain_hash(self._hash, header, digest)
        return dict(zip(EVENT_COLUMNS, (*header, *payload, salt, digest, prev, self._hash), strict=True))

    def tell(self, events: Iterable[dict[str, object]]) -> None:
        """Write events, in their order."""
        self._do(insert(EVENT), list(events))

    def touch(self, ids: Iterable[str]) -> None:
        """Mark these records as changed (rev), so that an index notices."""
        for some in batches(ids):
            where = (RECORD.c.bank == self.bank) & RECORD.c.id.in_(some) & (RECORD.c.state != FORGOTTEN)
            self._do(update(RECORD).where(where).values(rev=self.rev))

    def delete(self, table: Table, column: str, values: Collection[str]) -> None:
        """Delete the bank's rows of a table whose column has one of these values."""
        for some in batches(values):
            self._do(delete(table).where(table.c.bank == self.bank, table.c[column].in_(some)))

    def finish(self) -> None:
        """Advance the bank's own row, if anything happened; the last thing before the commit."""
        if self._half:
            raise MemoryStoreError("A change failed midway, so that its transaction cannot be committed.")
        if self._seq != self._began:
            values = (self.bank, self.rev, self._seq, self._hash, self.now)
            row = dict(zip(BANK.columns.keys(), values, strict=True))
            self._do(upsert(self.sql, BANK, ("bank",)), [row])

    def _do(self, statement: Any, rows: Sequence[Mapping[str, Any]] | None = None) -> None:
        """Change rows. A partial failure must not be committed, even if the error is caught."""
        if rows is None or rows:
            self._half = True
            self.sql.execute(statement, rows)
            self._half = False


def upsert(connection: Connection, table: Any, keys: tuple[str, ...]) -> Any:
    """An INSERT that replaces the row of the same keys."""
    statement: Any
    if connection.dialect.name == "sqlite":
        from sqlalchemy.dialects import sqlite

        statement = sqlite.insert(table)
    else:
        from sqlalchemy.dialects import postgresql

        statement = postgresql.insert(table)
    changed = {c.name: statement.excluded[c.name] for c in table.columns if c.name not in keys}
    return statement.on_conflict_do_update(index_elements=list(keys), set_=changed)


def _check_action(action: str) -> None:
    if not action or action.partition(":")[0] in RESERVED:
        raise MemoryStoreError(f"'{action}' cannot be the name of a decision: choose another one.")


def _difference(before: Record, after: Record) -> dict[str, list[Any]]:
    """``{field: [before, after]}`` of the differences, except version and rev."""
    return {
        name: [getattr(before, name), value]
        for name, value in as_json(after).items()
        if name not in ("version", "rev") and getattr(before, name) != value
    }


def checked(record: Record, bank: str, version: int, rev: int) -> Record:
    """The record as it can be stored; raises :class:`MemoryStoreError` for one that cannot.

    Text loses NUL and lone surrogates; NumPy numbers, and ints for floats, are converted.
    """
    values = []
    for value, kind in zip(as_json(record).values(), TYPES, strict=True):
        if type(value) is str:
            value = clean(value, MAX_TEXT)
        elif kind is not str and isinstance(value, int | float | np.integer | np.floating):
            value = kind(value) or kind(0)  # SQLite knows no minus zero
        values.append(value)
    values[-2:] = version, rev
    damage = damage_of(tuple(values))
    if record.bank != bank or not record.id or record.state == FORGOTTEN or not record.dedup_key:
        damage = f"bank '{record.bank}', state '{record.state}', or no id or key"
    elif values[0] != record.id:
        damage = "its id has characters that no database accepts"
    if damage:
        raise MemoryStoreError(f"Record '{record.id}' cannot be stored in bank '{bank}': {damage}.")
    return Record(*values)


def vector_row(vector: NDArray[np.floating[Any]], model: str, id: str, bank: str) -> dict[str, Any]:
    """The row of a vector; raises :class:`MemoryStoreError` for one that cannot be stored."""
    array = np.asarray(vector)
    if not model or array.ndim != 1 or not array.size or not np.isfinite(array).all():
        needed = "it needs a model's name and finite numbers in one row"
        raise MemoryStoreError(f"The vector of record '{id}' cannot be stored: {needed}.")
    stored = array.astype("<f4").tobytes()
    return {"bank": bank, "id": id, "model": model, "dimension": array.size, "vector": stored}
