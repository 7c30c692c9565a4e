"""How records become rows: checked, compared with what is stored, and written together."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sqlalchemy import Row, bindparam, insert, update

from gvla2.errors import MemoryStoreError
from gvla2.memory.records import COLUMNS, FORGOTTEN, TYPES, Record, as_json, clean, damage_of, dump
from gvla2.memory.storage.chain import Chain
from gvla2.memory.storage.database import upsert
from gvla2.memory.storage.events import difference
from gvla2.memory.storage.tables import BANK, RECORD, VECTOR

MAX_TEXT = 2_000_000
"""Characters that one column may hold."""
_FLOATS = tuple(i for i, kind in enumerate(TYPES) if kind is float)
_OF_ONE = (RECORD.c.bank == bindparam("b_bank")) & (RECORD.c.id == bindparam("b_id"))
# The key columns are left out: naming one would make the database rewrite its index entry each time.
_CHANGED = [name for name in COLUMNS if name not in ("id", "bank", "dedup_key")]
_UPDATE = update(RECORD).where(_OF_ONE).values({name: bindparam(name) for name in _CHANGED})
_REKEY = update(RECORD).where(_OF_ONE).values(dedup_key=bindparam("dedup_key"))


@dataclass(frozen=True)
class Put:
    """One record to be stored and the decision behind it, see :meth:`Transaction.put`.

    ``origin`` says who brought the evidence that the decision rests on.
    """

    record: Record
    action: str
    vector: NDArray[np.floating[Any]] | None = None
    model: str = ""
    why: str = ""
    scores: Mapping[str, float] = field(default_factory=dict)
    origin: str = ""


class StaleRecordError(MemoryStoreError):
    """A record was changed by somebody else after it was read: read it again and decide anew."""


def put_many(chain: Chain, puts: Sequence[Put]) -> list[Record]:
    """Store records and write their events; all of it is checked before anything is written."""
    stored = {row.id: row for row in chain.view.rows(chain.bank, ids=[put.record.id for put in puts])}
    latest: dict[str, Record] = {}
    vectors: dict[str, dict[str, Any] | None] = {}
    models = dict(chain.models)
    steps: list[tuple[Put, Record, dict[str, Any]]] = []
    for put in puts:
        chain.check_action(put.action)
        id = put.record.id
        record, old = _next(chain, put.record, latest.get(id), stored.get(id))
        if put.vector is not None:
            vectors[id] = _vector_row(put.vector, put.model, id, chain.bank, models)
        elif old is None or (old.query, old.content) != (record.query, record.content):
            vectors[id] = None
        change = difference(as_json(old), as_json(record)) if old else as_json(record)
        latest[id] = record
        steps.append((put, record, change))
    _refuse_taken_keys(chain, latest, stored)
    with chain.whole():
        _write(chain, latest, stored)
        chain.delete(VECTOR, "id", [id for id, row in vectors.items() if row is None and id in stored])
        if kept := [row for row in vectors.values() if row is not None]:
            chain.sql.execute(upsert(chain.sql, VECTOR, ("bank", "id")), kept)
    chain.models = models
    chain.written.update(latest)
    for put, record, change in steps:
        chain.event(
            put.action, record.id, why=put.why, scores=put.scores, change=dump(change), origin=put.origin
        )
    return [record for _, record, _ in steps]


def _next(
    chain: Chain, record: Record, before: Record | None, row: Row[Any] | None
) -> tuple[Record, Record | None]:
    """The record as it will be stored and as it is, ``before`` in the same batch, or the stored ``row``."""
    old = before
    if old is None and row is not None and row.state != FORGOTTEN and not damage_of(tuple(row)):
        old = Record(*tuple[Any, ...](row))
    expected = old.version if old else 0
    if record.version != expected:
        raise StaleRecordError(
            f"Record '{record.id}' of bank '{chain.bank}' is of version {expected} by now, not {record.version}: "
            "read it again."
        )
    # A tombstone, and a damaged row, are replaced; the count of changes goes on.
    kept = row.version if row is not None and type(row.version) is int else 0
    return checked(record, chain.bank, (old.version if old else kept) + 1, chain.rev), old


def checked(record: Record, bank: str, version: int, rev: int) -> Record:
    """The record as it can be stored; raises :class:`MemoryStoreError` for one that cannot."""
    if record.bank != bank or not record.id or record.state == FORGOTTEN or not record.dedup_key:
        raise MemoryStoreError(
            f"Record '{record.id}' (bank '{record.bank}', state '{record.state}') cannot be stored in bank '{bank}'."
        )
    values = [_storable(value, kind) for value, kind in zip(as_json(record).values(), TYPES, strict=True)]
    values[-2:] = version, rev
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
        return clean(value, MAX_TEXT)
    if (
        type(value) is not kind
        and kind is not str
        and isinstance(value, int | float | np.integer | np.floating)
    ):
        return kind(value)
    return value


def _vector_row(
    vector: NDArray[np.floating[Any]], model: str, id: str, bank: str, models: dict[str, int]
) -> dict[str, Any]:
    """The row of a vector; ``models`` knows the length of each model's and learns of a new one."""
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
    stored = array.astype("<f4").tobytes()
    return {"bank": bank, "id": id, "model": model, "dimension": array.size, "vector": stored}


def _refuse_taken_keys(chain: Chain, latest: Mapping[str, Record], stored: Mapping[str, Row[Any]]) -> None:
    """Raise where a dedup key is another record's already."""
    owners: dict[str, str] = {}
    for record in latest.values():
        row = stored.get(record.id)
        if row is None or row.dedup_key != record.dedup_key:
            other = owners.setdefault(record.dedup_key, record.id)
            if other != record.id:
                raise MemoryStoreError(
                    f"Records '{other}' and '{record.id}' have one and the same dedup key."
                )
    for id, key in chain.view.owners(chain.bank, owners).items():
        if owners[key] != id:
            raise MemoryStoreError(
                f"Record '{owners[key]}' cannot be stored: '{id}' of bank '{chain.bank}' has its dedup key."
            )


def _write(chain: Chain, latest: Mapping[str, Record], stored: Mapping[str, Row[Any]]) -> None:
    old = [record for record in latest.values() if record.id in stored]
    if rekeyed := [_bound(r) for r in old if stored[r.id].dedup_key != r.dedup_key]:
        chain.sql.execute(_REKEY, rekeyed)
    if new := [as_json(record) for record in latest.values() if record.id not in stored]:
        chain.sql.execute(insert(RECORD), new)
    if old:
        chain.sql.execute(_UPDATE, [_bound(record) for record in old])


def _bound(record: Record) -> dict[str, Any]:
    return {"b_bank": record.bank, "b_id": record.id, **as_json(record)}


def set_keys_aside(chain: Chain, ids: Iterable[str]) -> None:
    """Give rows dedup keys that nobody has, so that theirs are free for others; each is to get its own afterwards."""
    token = os.urandom(16).hex()  # a key that a row may have been given by hand is not met
    if rows := [{"b_bank": chain.bank, "b_id": id, "dedup_key": f"{token}:{id}"} for id in ids]:
        chain.sql.execute(_REKEY, rows)


def replace_rows(chain: Chain, records: Sequence[Record]) -> None:
    """Put records in place of the stored rows of their ids, without an event."""
    if records:
        chain.sql.execute(_REKEY, [_bound(record) for record in records])
        chain.sql.execute(_UPDATE, [_bound(record) for record in records])


def write_vectors(
    chain: Chain, model: str, vectors: Sequence[tuple[Record, NDArray[np.floating[Any]]]]
) -> int:
    """Store vectors of records that are still of the same version; how many. No event, and no change of a record."""
    stored = {row.id: row for row in chain.view.rows(chain.bank, ids=[record.id for record, _ in vectors])}
    rows = [
        _vector_row(vector, model, record.id, chain.bank, chain.models)
        for record, vector in vectors
        if record.id in stored and stored[record.id].version == record.version
    ]
    if rows:
        chain.sql.execute(upsert(chain.sql, VECTOR, ("bank", "id")), rows)
        told = update(BANK).where(BANK.c.bank == chain.bank).values(models=dump(chain.models))
        chain.sql.execute(told)
    return len(rows)
