"""A bank in RAM that follows its store: it reads the bank's ``rev`` and applies newer changes."""

from __future__ import annotations

import logging
import time
from collections.abc import Iterable, Sequence
from contextlib import suppress

import numpy as np
from numpy.typing import NDArray

from gvla2.errors import MemoryStoreError
from gvla2.memory.contracts import OUTCOMES, TYPES, Embedder
from gvla2.memory.indexing.candidates import SERVED, STATES, Candidates, RecordRows, largest
from gvla2.memory.records import Record
from gvla2.memory.storage.store import Store
from gvla2.memory.storage.view import RecordChange

_MANY = 200
"""Number of texts that may take a model more than a second."""

log = logging.getLogger(__name__)


class Index:
    """The provisional, active and summary records of one bank; archived ones stay only in the store.

    Records without a vector, and with ``replace`` those with one of another model, are embedded here and stored for
    other processes by :meth:`keep`. Row numbers are valid until the next :meth:`refresh` or :meth:`apply`. Not
    thread-safe.
    """

    def __init__(self, store: Store, bank: str, embedder: Embedder, *, replace: bool = False) -> None:
        self.bank = bank
        self.rev = 0
        self._store, self._embedder, self._replace = store, embedder, replace
        self._made: list[tuple[Record, NDArray[np.float32]]] = []
        self._dimension = int(embedder.embed([""]).shape[1])
        self._rows = RecordRows(self._dimension)

    def refresh(self) -> None:
        """Apply newer changes of the store's bank; quick when there are none.

        Raises :class:`~gvla2.errors.MemoryStoreError` when the store cannot be read; the index is then unchanged.
        """
        rev = self._store.rev(self.bank)
        if rev < self.rev:  # a different database replaced the known one
            self._rows.clear()
            self.rev = 0
        if rev > self.rev:
            with self._store.reading(self.bank) as view:
                rev, changes = view.rev, view.changes(self.rev)
            self.apply(changes)
        self.rev = rev

    def keep(self) -> None:
        """Store newly made vectors, if the bank is writable; not within a transaction."""
        made, self._made = self._made, []
        if made:
            with suppress(MemoryStoreError), self._store.writing(self.bank, actor="index", now=0.0) as t:
                t.save_vectors(self._embedder.model, made)

    def apply(self, changes: Iterable[RecordChange]) -> None:
        """Update rows; a record without a valid vector by this embedder's model is embedded here."""
        kept, gone = list[RecordChange](), list[str]()
        for one in changes:
            if one.record.state in STATES and one.record.type in TYPES and one.record.outcome in OUTCOMES:
                kept.append(one)
            else:  # archived, forgotten, or of an unknown kind
                gone.append(one.record.id)
        vectors = self._vectors(kept)
        try:
            self._rows.drop(gone)
            self._rows.put([(one.record, v, one.conflicts) for one, v in zip(kept, vectors, strict=True)])
        except BaseException:
            self._rows.clear()  # half applied: read all of it again
            self.rev = 0
            raise

    def candidates(self, states: Sequence[str] = SERVED, *, now: float | None = None) -> Candidates:
        """The records of these states, as a retriever ranks them.

        ``now`` is the reference time of ages, in seconds since the epoch (the machine's clock by default).
        """
        return Candidates(self._rows, states, time.time() if now is None else now)

    def nearest(
        self, vector: NDArray[np.float32], k: int, states: Sequence[str] = SERVED
    ) -> list[tuple[Record, float]]:
        """The at most ``k`` records with the largest cosine to a unit (D,) vector, with it; equal ones by id.

        A zero vector has no neighbours.
        """
        served = np.flatnonzero(self._rows.in_states(states))
        if k <= 0 or not len(served) or not vector.any():
            return []
        cosines = (self._rows.vectors @ vector)[served].astype(np.float64)
        records = self._rows.records
        best = largest(cosines, k, lambda i: records[served[i]].id)
        return [(records[served[i]], float(cosines[i])) for i in best]

    def get(self, id: str) -> Record | None:
        """The record, None if it is not in the index."""
        row = self._rows.row_of.get(id)
        return None if row is None else self._rows.records[row]

    def vector(self, id: str) -> NDArray[np.float32] | None:
        """(D,) the embedding of a record, None if it is not in the index."""
        row = self._rows.row_of.get(id)
        return None if row is None else np.array(self._rows.vectors[row])

    def count(self, state: str) -> int:
        """How many records are held in a state."""
        return int(np.count_nonzero(self._rows.in_states((state,))))

    def records(self, state: str) -> list[Record]:
        """The records held in a state, by id."""
        rows = np.flatnonzero(self._rows.in_states((state,)))
        return sorted((self._rows.records[row] for row in rows.tolist()), key=lambda record: record.id)

    def _vectors(self, changes: Sequence[RecordChange]) -> list[NDArray[np.float32]]:
        """The valid stored (D,) vectors by this embedder's model, new ones for the others."""
        model = self._embedder.model
        found = [change.vector if change.model == model else None for change in changes]
        missing = [i for i, vector in enumerate(found) if not _sound(vector, self._dimension)]
        if len(missing) > _MANY:
            told = "%d records of the bank '%s' have no vectors by %s: embedding them."
            log.info(told, len(missing), self.bank, model)
        made = self._embedder.embed([changes[i].record.text for i in missing]) if missing else ()
        for i, vector in zip(missing, made, strict=True):
            found[i] = sound = np.nan_to_num(np.asarray(vector, np.float32))
            if not changes[i].model or (self._replace and changes[i].model != model):
                self._made.append((changes[i].record, sound))
        return [vector for vector in found if vector is not None]


def _sound(vector: NDArray[np.float32] | None, dimension: int) -> bool:
    """Whether a stored vector may be used: finite, and of length 1 or 0."""
    if vector is None or vector.shape != (dimension,):
        return False
    square = float(vector.astype(np.float64) @ vector)
    return square == 0.0 or abs(square - 1.0) < 2e-2
