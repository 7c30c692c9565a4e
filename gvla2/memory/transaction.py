"""Changing a bank, atomically: rows, the events that explain them, and forgetting for good.

Forgetting removes a record's row, vector, links and episodes, and erases the payloads of all events about it. Reasons
and notes refer to other records only by id, never by their words, so nothing else has to be searched.
"""

from __future__ import annotations

import os
from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sqlalchemy import Connection, Row, Table, delete, insert, update
from sqlalchemy.dialects import postgresql, sqlite

from gvla2.errors import MemoryStoreError
from gvla2.memory.records import (
    COLUMN_TYPES,
    FORGOTTEN,
    Record,
    as_json,
    clean,
    damage_of,
    dump,
    load_object,
)
from gvla2.memory.tables import (
    BANK,
    EPISODE,
    EVENT,
    GENESIS,
    LINK,
    RECORD,
    VECTOR,
    Link,
    StoredEpisode,
    digest_of,
    payload_digest,
    row_digest,
)
from gvla2.memory.view import BankView, batches, valid_record

MAX_WHY = 2000
MAX_TEXT = 2_000_000
"""Characters that one column may hold."""
ERASED = {"why": "", "scores": "", "change": "", "origin": "", "state": "", "salt": b""}
"""The erased payload of an event about something forgotten; without a later event of the forgetting it is damage."""


class Transaction(BankView):
    """Changes of one bank under one ``rev``, made by ``actor`` at ``now`` (never before the bank's last change).

    It holds the bank's write lock, so reads stay valid until the end. Reasons (``why``) and a record's ``note`` may
    name other records by id, but must not quote them: forgetting a record does not search for its words in the reasons
    of others (except of links to it). ``forgotten`` are the forgotten ids; if there are any, the store cleans the
    database's files after the commit. ``linked``: whether conflicts between records began or ended.
    """

    def __init__(self, sql: Connection, bank: str, actor: str, now: float) -> None:
        super().__init__(sql, bank)
        head, self._actor = self.head, clean(actor, 200)
        self._rev = super().rev + 1
        self.now = max(float(now), head.at) if head else float(now)
        self._seq, self._hash = (int(head.seq), str(head.hash)) if head else (0, GENESIS)
        self._began = self._seq
        self.forgotten: list[str] = []
        self.linked = False

    @property
    def rev(self) -> int:
        """The number of this transaction."""
        return self._rev

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
        """Store a record and the event that explains it; returns it as stored.

        A record of version 0 is new; any other must be of the version that is stored. A ``vector`` (D,) is the
        embedding of its text by ``model``; without one the stored vector stays, unless the text changed. ``origin`` is
        the source of the evidence, "" for none. Raises :class:`MemoryStoreError` for another version, and for what
        :func:`checked` refuses, before anything is written.
        """
        row = next(self.rows(ids=[record.id]), None)
        old = valid_record(row) if row is not None else None
        if record.version != (expected := old.version if old else 0):
            now = f"is of version {expected} by now, not {record.version}: read it again"
            raise MemoryStoreError(f"Record '{record.id}' of bank '{self.bank}' {now}.")
        # A tombstone and a damaged row are replaced.
        version = row.version if row is not None and type(row.version) is int else 0
        stored = checked(record, self.bank, version + 1, self.rev)
        self._write(RECORD, as_json(stored))
        if vector is not None:
            self._write(VECTOR, self._vector_row(stored, vector, model))
        elif old is None or old.text != stored.text:
            self._change(delete(VECTOR), VECTOR.c.id, [stored.id])
        change = as_json(stored)
        if old:
            before = as_json(old) | {"version": stored.version, "rev": stored.rev}
            change = {name: [before[name], value] for name, value in change.items() if before[name] != value}
        self._append(action, stored.id, why=why, change=change, origin=origin, row=stored)
        return stored

    def save_vectors(self, model: str, vectors: Sequence[tuple[Record, NDArray[np.floating[Any]]]]) -> None:
        """Store embeddings of records that did not change since they were read.

        Vectors are derived data: this is not an event, and changes no record.
        """
        stored = {row.id: row.version for row in self.rows(ids=[record.id for record, _ in vectors])}
        for one, vector in vectors:
            if stored.get(one.id) == one.version:
                self._write(VECTOR, self._vector_row(one, vector, model))

    def _vector_row(self, record: Record, vector: NDArray[np.floating[Any]], model: str) -> dict[str, Any]:
        stored = np.asarray(vector, "<f4")
        row = {"bank": self.bank, "id": record.id, "model": model}
        return {**row, "dimension": stored.size, "vector": stored.tobytes()}

    def link(self, source: str, kind: str, target: str, why: str = "") -> None:
        """Link two different records, unless they are linked so already."""
        if any((one.source, one.kind, one.target) == (source, kind, target) for one in self.links([source])):
            return
        self.linked = True
        self.sql.execute(insert(LINK), {"bank": self.bank, **Link(source, kind, target, self.now)._asdict()})
        self._append(f"link:{kind}", source, target, why)

    def decide(self, action: str, record: str = "", *, why: str = "") -> None:
        """An event for a decision that changes no row (a lesson was discarded)."""
        self._append(action, clean(record, 200), why=why)

    def save_episode(self, episode: StoredEpisode) -> None:
        """Store an episode for replay, replacing its source's earlier one; its digest goes on the chain."""
        source, at, data = clean(episode.source, 200), float(episode.at), episode.to_json()
        known = next(self.episode_rows([source]), None)
        name = known.name if known is not None else f"episode-{os.urandom(8).hex()}"
        row = {"bank": self.bank, "source": source, "name": name, "at": at, "data": data}
        self._write(EPISODE, row)
        self._append("episode", name, change={"episode": digest_of(at, data), "source": source})

    def forget(self, *ids: str, why: str = "") -> list[str]:
        """Forget records permanently. Returns the ids of those that existed.

        Their ids, and the fact that they were forgotten, stay.
        """
        rows = {row.id: row for row in self.rows(ids=ids) if row.state != FORGOTTEN}
        if not rows:
            return []
        for column in (LINK.c.source, LINK.c.target, VECTOR.c.id):
            self._change(delete(column.table), column, rows)
        for column in (EVENT.c.record, EVENT.c.target):
            self._change(update(EVENT).values(ERASED), column, rows)
        for row in rows.values():
            version = row.version + 1 if type(row.version) is int else 1
            blank: dict[str, Any] = dict.fromkeys(("query", "content", "type", "outcome"), "")
            blank |= {"state": FORGOTTEN, "confidence": 0.0, "quality": 0.0, "count": 0}
            blank |= {"created": self.now, "updated": self.now, "version": version, "rev": self.rev}
            tombstone = Record(row.id, self.bank, dedup_key=f"{FORGOTTEN}:{row.id}", **blank)
            self._write(RECORD, as_json(tombstone))
            self._append("forget", tombstone.id, why=why, change=as_json(tombstone), row=tombstone)
        self._forget_episodes(rows)
        self.forgotten += rows
        return list(rows)

    def _forget_episodes(self, rows: Mapping[str, Row[Any]]) -> None:
        """Forget the episodes that taught them: their rows, and the events' payloads about them."""
        named = {source for row in rows.values() for source in _listed(row.provenance, "sources")}
        found = {
            row.source: row.name
            for row in self.episode_rows()
            if row.source in named or not rows.keys().isdisjoint(_listed(row.data, "records", rows))
        }
        self._change(delete(EPISODE), EPISODE.c.source, found)
        self._change(update(EVENT).values(ERASED), EVENT.c.record, found.values())
        for name in found.values():
            self._append("forget", name)

    def _append(
        self,
        action: str,
        record: str = "",
        target: str = "",
        why: str = "",
        *,
        change: Mapping[str, Any] | None = None,
        origin: str = "",
        row: Record | None = None,
    ) -> None:
        """Write the next event. ``row`` is the record as the event leaves it."""
        payload = (
            clean(why, MAX_WHY),
            dump({"quality": row.quality, "confidence": row.confidence}) if row else "{}",
            "" if change is None else dump(dict(change)),
            clean(origin, MAX_WHY),
            row_digest(row) if row else "",
        )
        salt = os.urandom(16)
        digest = payload_digest(salt, payload)
        self._seq += 1
        header = (self.bank, self._seq, self.rev, self.now, self._actor, clean(action, 64), record, target)
        prev, self._hash = self._hash, digest_of(self._hash, *header, digest)
        values = (*header, *payload, salt, digest, prev, self._hash)
        self.sql.execute(insert(EVENT), dict(zip(EVENT.columns.keys(), values, strict=True)))

    def finish(self) -> None:
        """Advance the bank's own row, if anything happened; the last step before the commit."""
        if self._seq != self._began:
            head = {"bank": self.bank, "rev": self.rev, "seq": self._seq, "hash": self._hash, "at": self.now}
            self._write(BANK, head)

    def _write(self, table: Table, row: Mapping[str, Any]) -> None:
        """Insert a row, or replace the one of the same keys."""
        dialect = sqlite if self.sql.dialect.name == "sqlite" else postgresql
        statement: Any = dialect.insert(table)
        changed = {c.name: statement.excluded[c.name] for c in table.columns if not c.primary_key}
        keys = list(table.primary_key)
        self.sql.execute(statement.on_conflict_do_update(index_elements=keys, set_=changed), row)

    def _change(self, statement: Any, column: Any, values: Iterable[Any]) -> None:
        """Update or delete the bank's rows whose column has one of these values."""
        for some in batches(values):
            self.sql.execute(statement.where(column.table.c.bank == self.bank, column.in_(some)))


def checked(record: Record, bank: str, version: int, rev: int) -> Record:
    """The record as it can be stored; raises :class:`MemoryStoreError` for one that cannot.

    Text loses NUL and lone surrogates; NumPy numbers, and ints for floats, are converted.
    """
    values = []
    for value, kind in zip(as_json(record).values(), COLUMN_TYPES, strict=True):
        if type(value) is str:
            value = clean(value, MAX_TEXT)
        elif kind is not str and isinstance(value, int | float | np.integer | np.floating):
            value = kind(value) or kind(0)  # SQLite knows no minus zero
        values.append(value)
    values[-2:] = version, rev
    damage = damage_of(tuple(values))
    if (record.bank, record.id) != (bank, values[0]) or record.state == FORGOTTEN:
        damage = f"bank '{record.bank}', state '{record.state}', or an id that no database accepts"
    elif not record.id or not record.dedup_key:
        damage = "it has no id or no key"
    if damage:
        raise MemoryStoreError(f"Record '{record.id}' cannot be stored in bank '{bank}': {damage}.")
    return Record(*values)


def _listed(text: object, name: str, wanted: Collection[str] = ()) -> list[str]:
    """A named list of a JSON object; for a damaged one the ``wanted`` strings that it contains anywhere."""
    try:
        return [str(one) for one in load_object(str(text)).get(name, [])]
    except (ValueError, TypeError):
        return [one for one in wanted if dump(one) in str(text)]
