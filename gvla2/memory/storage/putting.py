"""How records become rows: checked, compared with what is stored, and written together."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from operator import attrgetter
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from gvla2.errors import MemoryStoreError
from gvla2.memory.records import (
    COLUMNS,
    FORGOTTEN,
    TYPES,
    Record,
    as_json,
    clean,
    damage_of,
    dump,
)
from gvla2.memory.storage.database import Connection, Row
from gvla2.memory.storage.events import difference
from gvla2.memory.storage.view import CHUNK, View, models_of

if TYPE_CHECKING:
    from gvla2.memory.storage.transaction import Transaction

_STATE, _VERSION, _KEY = (COLUMNS.index(name) for name in ("state", "version", "dedup_key"))
_FLOATS = tuple(i for i, kind in enumerate(TYPES) if kind is float)
_INSERT = f"INSERT INTO memory ({', '.join(COLUMNS)}) VALUES ({', '.join('?' * len(COLUMNS))})"
# The key columns are left out: naming one would make the database rewrite its index entry each time.
_CHANGED = tuple(name for name in COLUMNS if name not in ("id", "bank", "dedup_key"))
_ALL, _SOME = attrgetter(*COLUMNS), attrgetter(*_CHANGED)
_UPDATE = f"UPDATE memory SET {', '.join(f'{name} = ?' for name in _CHANGED)} WHERE bank = ? AND id = ?"
_REKEY = "UPDATE memory SET dedup_key = ? WHERE bank = ? AND id = ?"
_VECTOR = (
    "INSERT INTO memory_vector (bank, id, model, dimension, vector) VALUES (?, ?, ?, ?, ?) "
    "ON CONFLICT (bank, id) DO UPDATE SET model = excluded.model, dimension = excluded.dimension, "
    "vector = excluded.vector"
)
_NO_VECTOR = "DELETE FROM memory_vector WHERE bank = ? AND id = ?"
MAX_TEXT = 2_000_000
"""Characters that one column may hold."""


@dataclass(frozen=True)
class Put:
    """One record to be stored and the decision behind it, see :meth:`Transaction.put`."""

    record: Record
    action: str
    vector: NDArray[np.floating[Any]] | None = None
    model: str = ""
    why: str = ""
    scores: Mapping[str, float] = field(default_factory=dict)


class StaleRecordError(MemoryStoreError):
    """A record was changed by somebody else after it was read: read it again and decide anew."""


@dataclass(frozen=True, slots=True)
class _Step:
    """One put, checked: the record as it will be stored, what changes, and its vector's row."""

    put: Put
    record: Record
    change: dict[str, Any]
    vector: Row | None


def put_many(transaction: Transaction, sql: Connection, puts: Sequence[Put]) -> list[Record]:
    """Store records and write their events; all of it is checked before anything is written."""
    bank = transaction.bank
    stored = _stored(sql, bank, [put.record.id for put in puts])
    latest: dict[str, Record] = {}
    steps = []
    models = dict(transaction.models)
    for put in puts:
        transaction.check_action(put.action)
        step = _step(put, latest.get(put.record.id), stored.get(put.record.id), bank, transaction.rev, models)
        latest[step.record.id] = step.record
        steps.append(step)
    _refuse_taken_keys(sql, bank, latest, stored)
    transaction.models = models
    _write_rows(sql, bank, latest, stored)
    _write_vectors(sql, bank, steps, stored)
    transaction.written.update(latest)
    transaction.created.update(latest.keys() - stored.keys())
    transaction.record_events(
        [
            transaction.next_event(
                step.put.action,
                step.record.id,
                why=step.put.why,
                scores=step.put.scores,
                change=dump(step.change),
            )
            for step in steps
        ]
    )
    return [step.record for step in steps]


def _step(
    put: Put, before: Record | None, row: Row | None, bank: str, rev: int, models: dict[str, int]
) -> _Step:
    """Check one put against what came ``before`` it in the same batch, or the stored ``row``."""
    old = before
    if old is None and row is not None and row[_STATE] != FORGOTTEN and not damage_of(row):
        old = Record(*row)
    expected = old.version if old else 0
    if put.record.version != expected:
        raise StaleRecordError(
            f"Record '{put.record.id}' of bank '{bank}' is of version {expected} by now, not {put.record.version}: "
            "read it again."
        )
    # A tombstone, and a damaged row, are replaced; the count of changes goes on.
    kept = row[_VERSION] if row is not None and type(row[_VERSION]) is int else 0
    version = old.version + 1 if old else kept + 1
    record = checked(put.record, bank, version, rev)
    vector = vector_row(put.vector, put.model, record.id, bank, models) if put.vector is not None else None
    return _Step(put, record, difference(as_json(old), as_json(record)) if old else as_json(record), vector)


def checked(record: Record, bank: str, version: int, rev: int) -> Record:
    """The record as it can be stored; raises :class:`MemoryStoreError` for one that cannot."""
    if record.bank != bank or not record.id or record.state == FORGOTTEN or not record.dedup_key:
        raise MemoryStoreError(
            f"Record '{record.id}' (bank '{record.bank}', state '{record.state}') cannot be stored in bank '{bank}'."
        )
    values = [*_ALL(record)[:-2], version, rev]
    text = "".join([value for value in values if type(value) is str])
    if tuple(map(type, values)) != TYPES or not text.isascii() or "\0" in text:
        values = [_storable(value, kind) for value, kind in zip(values, TYPES, strict=True)]
    for i in _FLOATS:
        if values[i] == 0.0:
            values[i] = 0.0  # SQLite knows no minus zero
    damage = damage_of(tuple(values))
    if values[0] != record.id:
        damage = "its id holds what no database takes"
    if damage:
        raise MemoryStoreError(f"Record '{record.id}' cannot be stored: {damage}.")
    return Record(*values)


def _storable(value: Any, kind: type) -> Any:
    """Text without NUL and lone surrogates; NumPy's numbers, and an int for a float, as what they stand for."""
    if type(value) is str:
        return value if value.isascii() and "\0" not in value else clean(value, MAX_TEXT)
    if (
        type(value) is not kind
        and kind is not str
        and isinstance(value, int | float | np.integer | np.floating)
    ):
        return kind(value)
    return value


def vector_row(
    vector: NDArray[np.floating[Any]], model: str, id: str, bank: str, models: dict[str, int]
) -> Row:
    """The row of a vector; ``models`` knows the dimension of each model and learns of a new one."""
    array = np.asarray(vector)
    if not model or array.ndim != 1 or not array.size or not np.isfinite(array).all():
        raise MemoryStoreError(
            f"The vector of record '{id}' cannot be stored: a model's name and finite numbers in one row are needed."
        )
    known = models.setdefault(model, array.size)
    if known != array.size:
        raise MemoryStoreError(
            f"The vector of record '{id}' has {array.size} numbers, those of '{model}' in bank '{bank}' have {known}."
        )
    return (bank, id, model, array.size, array.astype("<f4").tobytes())


def _stored(sql: Connection, bank: str, ids: Sequence[str]) -> dict[str, Row]:
    """The rows that are there already, damaged ones and tombstones too."""
    return {row[0]: row for row in View(sql).rows(bank, ids=ids)}


def _refuse_taken_keys(sql: Connection, bank: str, latest: dict[str, Record], stored: dict[str, Row]) -> None:
    """Raise where a dedup key is another record's already."""
    owners: dict[str, str] = {}
    for record in latest.values():
        row = stored.get(record.id)
        if row is None or row[_KEY] != record.dedup_key:
            other = owners.setdefault(record.dedup_key, record.id)
            if other != record.id:
                raise MemoryStoreError(
                    f"Records '{other}' and '{record.id}' have one and the same dedup key."
                )
    keys = sorted(owners)
    for start in range(0, len(keys), CHUNK):
        some = keys[start : start + CHUNK]
        query = (
            f"SELECT id, dedup_key FROM memory WHERE bank = ? AND dedup_key IN ({', '.join('?' * len(some))})"
        )
        for id, key in sql.rows(query, [bank, *some]):
            if owners[key] != id:
                raise MemoryStoreError(
                    f"Record '{owners[key]}' cannot be stored: '{id}' of bank '{bank}' has its dedup key."
                )


def _write_rows(sql: Connection, bank: str, latest: dict[str, Record], stored: dict[str, Row]) -> None:
    rekeyed = [
        (record.dedup_key, bank, record.id)
        for record in latest.values()
        if record.id in stored and stored[record.id][_KEY] != record.dedup_key
    ]
    if rekeyed:
        sql.run_many(_REKEY, rekeyed)
    new = [_ALL(record) for record in latest.values() if record.id not in stored]
    if new:
        sql.run_many(_INSERT, new)
    old = [(*_SOME(record), bank, record.id) for record in latest.values() if record.id in stored]
    if old:
        sql.run_many(_UPDATE, old)


def _write_vectors(sql: Connection, bank: str, steps: Sequence[_Step], stored: dict[str, Row]) -> None:
    """Keep each record's last vector; drop one whose text changed without a new one."""
    vectors: dict[str, Row | None] = {}
    for step in steps:
        if step.vector is not None:
            vectors[step.record.id] = step.vector
        elif "content" in step.change or "query" in step.change:
            vectors[step.record.id] = None
    dropped = [(bank, id) for id, row in vectors.items() if row is None and id in stored]
    if dropped:
        sql.run_many(_NO_VECTOR, dropped)
    kept = [row for row in vectors.values() if row is not None]
    if kept:
        sql.run_many(_VECTOR, kept)


def set_keys_aside(sql: Connection, bank: str, ids: Iterable[str]) -> None:
    """Give rows dedup keys that nobody has, so that theirs are free for others; each is to get its own afterwards."""
    token = os.urandom(16).hex()  # a key that a row may have been given by hand is not met
    sql.run_many(_REKEY, [(f"{token}:{id}", bank, id) for id in ids])


def replace_row(sql: Connection, record: Record) -> None:
    """Put a record in place of the stored row of its id, without an event."""
    sql.run(_REKEY, (record.dedup_key, record.bank, record.id))
    sql.run(_UPDATE, (*_SOME(record), record.bank, record.id))


def write_vectors(
    sql: Connection, bank: str, model: str, vectors: Sequence[tuple[Record, NDArray[np.floating[Any]]]]
) -> int:
    """Store vectors of records that are still of the same version; how many. Teaches the bank a new model."""
    head = sql.row("SELECT models FROM memory_bank WHERE bank = ?", (bank,))
    if head is None:
        return 0
    models = models_of(head[0])
    stored = _stored(sql, bank, [record.id for record, _ in vectors])
    rows = [
        vector_row(vector, model, record.id, bank, models)
        for record, vector in vectors
        if record.id in stored and stored[record.id][_VERSION] == record.version
    ]
    if rows:
        sql.run_many(_VECTOR, rows)
        sql.run("UPDATE memory_bank SET models = ? WHERE bank = ?", (dump(models), bank))
    return len(rows)
