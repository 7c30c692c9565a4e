"""A bank in RAM, which follows the store."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from contextlib import suppress

import numpy as np
from numpy.typing import NDArray

from gvla2.errors import MemoryStoreError
from gvla2.memory.candidates import Candidates, HeldRecord
from gvla2.memory.contracts import Embedder
from gvla2.memory.embedding import StaticEmbedder, record_vectors
from gvla2.memory.records import OUTCOMES, TYPES, Record
from gvla2.memory.store import Store
from gvla2.memory.view import Embedded

STATES = ("provisional", "active")
"""The states held in RAM; a record of any other is dropped."""


class Index:
    """The records of ``bank`` that may be ranked, with vectors by ``embedder``. Not thread-safe.

    It is read anew when the bank's ``rev`` differs. Stored vectors of another model are replaced, except by the
    static table's: those are quickly made.
    """

    def __init__(self, store: Store, bank: str, embedder: Embedder) -> None:
        self.bank, self.rev = bank, 0
        self._store, self._embedder = store, embedder
        self._replaces = not isinstance(embedder, StaticEmbedder)
        self._shape = embedder.embed([""])[0].shape
        self._held: dict[str, HeldRecord] = {}
        self._candidates: dict[tuple[str, ...], Candidates] = {}
        self._made: list[tuple[Record, NDArray[np.float32]]] = []

    def clear(self) -> None:
        """Forget everything: the next refresh reads the whole bank."""
        self.rev = 0
        self._held.clear()
        self._candidates.clear()

    def refresh(self) -> None:
        """Read the store's bank if it changed; quick if it did not.

        Raises :class:`~gvla2.errors.MemoryStoreError` when the store cannot be read; the index is then unchanged.
        """
        if self._store.rev(self.bank) == self.rev:
            return
        with self._store.reading(self.bank) as view:
            rev, stored = view.rev, view.embedded(STATES)
        held = [
            HeldRecord(one.record, vector, one.conflicts)
            for one, vector in self._with_vectors(stored)
            if one.record.type in TYPES and one.record.outcome in OUTCOMES
        ]
        self._held = {one.record.id: one for one in held}
        self._candidates.clear()
        self.rev = rev

    def put(self, record: Record, vector: NDArray[np.float32] | None) -> None:
        """Hold a record as a transaction leaves it; without a new ``vector`` (D,) it keeps the one it has."""
        before = self._held.pop(record.id, None)
        if vector is None and before is not None:
            vector = before.vector
        if record.state in STATES and vector is not None:
            self._held[record.id] = HeldRecord(record, vector, before.conflicts if before else 0)
        self._candidates.clear()

    def keep(self) -> None:
        """Store newly made vectors, if the bank is writable; not within a transaction."""
        made, self._made = self._made, []
        if made:
            with suppress(MemoryStoreError), self._store.writing(self.bank, actor="index", now=0.0) as t:
                t.save_vectors(self._embedder.model, made)

    def candidates(self, states: Sequence[str], *, now: float = 0.0) -> Candidates:
        """The records of these states, as a retriever ranks them; ``now`` in seconds since the epoch."""
        wanted = tuple(states)
        if wanted not in self._candidates:
            held = [one for one in self._held.values() if one.record.state in wanted]
            self._candidates[wanted] = Candidates(held, now)
        found = self._candidates[wanted]
        found.now = now
        return found

    def nearest(self, vector: NDArray[np.float32], k: int) -> list[tuple[Record, float]]:
        """The at most ``k`` active records with the largest cosine to a unit (D,) vector, with it; equal ones by id.

        A zero vector has no neighbours.
        """
        if k <= 0 or not vector.any():
            return []
        candidates = self.candidates(["active"])
        cosines = candidates.cosine(vector)
        best = np.argsort(-cosines, kind="stable")[:k]
        return [(candidates.record(row), float(cosines[row])) for row in best.tolist()]

    def get(self, id: str) -> HeldRecord | None:
        """The record with its vector, None if it is not in the index."""
        return self._held.get(id)

    def held(self) -> Collection[HeldRecord]:
        """All that it holds."""
        return self._held.values()

    def records(self, state: str) -> list[Record]:
        """The records held in a state, by id."""
        held = [one.record for one in self._held.values() if one.record.state == state]
        return sorted(held, key=lambda record: record.id)

    def _with_vectors(self, stored: Sequence[Embedded]) -> list[tuple[Embedded, NDArray[np.float32]]]:
        """The records with the stored (D,) vectors by this embedder's model, and new ones for the others."""
        model = self._embedder.model
        vectors = {
            one.record.id: one.vector
            for one in stored
            if one.model == model and one.vector is not None and one.vector.shape == self._shape
        }
        missing = [one for one in stored if one.record.id not in vectors]
        made = record_vectors(self._embedder, [(one.record.query, one.record.content) for one in missing])
        for one, vector in zip(missing, np.nan_to_num(made), strict=True):
            vectors[one.record.id] = vector
            if not one.model or (self._replaces and one.model != model):
                self._made.append((one.record, vector))
        return [(one, vectors[one.record.id]) for one in stored]
