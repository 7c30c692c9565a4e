"""What may become a row: records and vectors are checked before anything is written."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gvla2.errors import MemoryStoreError
from gvla2.memory.records import FORGOTTEN, TYPES, Record, as_json, clean, damage_of

MAX_TEXT = 2_000_000
"""Characters that one column may hold."""


@dataclass(frozen=True)
class Put:
    """One record to be stored and the decision behind it, see :meth:`Transaction.put_many`."""

    record: Record
    action: str
    vector: NDArray[np.floating[Any]] | None = None
    model: str = ""
    why: str = ""
    scores: Mapping[str, float] = field(default_factory=dict)
    origin: str = ""


@dataclass(frozen=True, slots=True)
class Tie:
    """One link to be made and the reason for it."""

    source: str
    kind: str
    target: str
    why: str = ""


class StaleRecordError(MemoryStoreError):
    """A record was changed by somebody else after it was read: read it again and decide anew."""


def checked(record: Record, bank: str, version: int, rev: int) -> Record:
    """The record as it can be stored; raises :class:`MemoryStoreError` for one that cannot.

    Text loses NUL and lone surrogates; NumPy's numbers, and an int for a float, become what they stand for.
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
        damage = "its id holds what no database takes"
    if damage:
        raise MemoryStoreError(f"Record '{record.id}' cannot be stored in bank '{bank}': {damage}.")
    return Record(*values)


def vector_row(vector: NDArray[np.floating[Any]], model: str, id: str, bank: str) -> dict[str, Any]:
    """The row of a vector; raises :class:`MemoryStoreError` for one that cannot be stored."""
    array = np.asarray(vector)
    if not model or array.ndim != 1 or not array.size or not np.isfinite(array).all():
        raise MemoryStoreError(
            f"The vector of record '{id}' cannot be stored: a model's name and finite numbers in one row are needed."
        )
    stored = array.astype("<f4").tobytes()
    return {"bank": bank, "id": id, "model": model, "dimension": array.size, "vector": stored}
