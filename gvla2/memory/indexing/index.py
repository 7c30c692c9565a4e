"""A bank in RAM that follows its store: it asks for the bank's ``rev`` and applies what is newer."""

from __future__ import annotations

import time
from collections.abc import Iterable, Sequence
from functools import partial

import numpy as np
from numpy.typing import NDArray

from gvla2.memory.contracts import OUTCOMES, TYPES, Embedder
from gvla2.memory.indexing.candidates import RowCandidates, Served
from gvla2.memory.indexing.rows import STATES, Entry, Rows
from gvla2.memory.indexing.vectors import sound
from gvla2.memory.meaning.words import text_of
from gvla2.memory.records import Record
from gvla2.memory.retrieval.kernels import largest
from gvla2.memory.retrieval.ranking import best
from gvla2.memory.storage.store import Store
from gvla2.memory.storage.view import Change

SERVED = ("active", "summary")
"""The states that planners are told of, unless somebody asks for others."""
_KEPT = 16
_TOGETHER = 4096
_WORTH_SAVING = 1000
"""Changes that are quickly read from the store."""


class Index:
    """The provisional, active and summary records of one bank; archived ones stay in the store alone.

    Row numbers of :meth:`rows`, :meth:`nearest` and :meth:`record` hold until the next :meth:`refresh` or
    :meth:`apply`. ``snapshot`` names a file that makes the next start fast; it is derived data, ignored when it is
    damaged or does not belong to this bank. Not safe among threads.
    """

    def __init__(self, store: Store, bank: str, embedder: Embedder) -> None:
        self.bank = bank
        self.rev = -1
        self._store, self._embedder = store, embedder
        self._dimension = int(embedder.embed([""]).shape[1])
        self._rows = Rows(self._dimension)
        self._served: dict[tuple[tuple[str, ...], str], Served] = {}
        self._unsaved = 0

    def __len__(self) -> int:
        return len(self._rows)

    def refresh(self) -> None:
        """Apply what the store's bank has that is newer; quick when nothing is.

        Raises :class:`~gvla2.errors.MemoryStoreError` when the store cannot be read; the index then stays as it was.
        """
        rev = self._store.rev(self.bank)
        if rev == self.rev:
            return
        if self.rev < 0:
            self.rev = 0
        if rev < self.rev:  # another database took the place of the one known
            self._rows, self.rev = Rows(self._dimension), 0
        if rev > self.rev:
            with self._store.reading() as view:
                rev, changes = view.rev(self.bank), view.changes(self.bank, self.rev)
            self.apply(changes)
        self.rev = rev

    def apply(self, changes: Iterable[Change]) -> None:
        """Bring rows up to date; a record without a sound vector of this embedder's model is embedded here."""
        dropped: list[str] = []
        kept: list[Change] = []
        changes = list(changes)
        self._unsaved += len(changes)
        for change in changes:
            record = change.record
            known = record.state in STATES and record.type in TYPES and record.outcome in OUTCOMES
            if known and not change.forgotten:
                kept.append(change)
            else:
                dropped.append(record.id)
        usable = self._usable(kept)
        missing = [i for i in range(len(kept)) if not usable[i]]
        made = self._embed([kept[i].record for i in missing])
        fresh = dict(zip(missing, made, strict=True))
        try:
            self._rows.drop(dropped)
            self._rows.put(
                [
                    Entry(change.record, fresh.get(i, change.vector), change.conflicts)  # type: ignore[arg-type]
                    for i, change in enumerate(kept)
                ]
            )
        except BaseException:
            self._rows, self.rev = Rows(self._dimension), 0  # half applied: read all of it again
            raise
        finally:
            self._served.clear()

    def count(self, state: str, ids: Sequence[str] | None = None) -> int:
        """How many of the records held, or of those with these ids, are in a state."""
        place = STATES.index(state)
        if ids is None:
            return int(self._rows.postings.documents[place])
        states = self._rows.column("state")
        return int(np.count_nonzero(states[self.rows(ids)] == place)) if len(states) else 0

    def candidates(
        self, states: Sequence[str] = SERVED, skill: str = "", *, now: float | None = None
    ) -> RowCandidates:
        """The records of these states, of this skill or of none ("" for all), as a retriever ranks them.

        ``now`` is what ages are counted to, in seconds since the epoch (the machine's clock by default). BM25's
        statistics are those of the states, whatever the skill.
        """
        return RowCandidates(self._of(states, skill), time.time() if now is None else now)

    def nearest(
        self, vector: NDArray[np.float32], k: int, states: Sequence[str] = SERVED, skill: str = ""
    ) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """((K,) rows, (K,) cosines) of the at most ``k`` records with the largest cosine to a unit (D,) vector.

        Exact: the same as by brute force in float32; equal ones by id. Rows are those of :meth:`record`. A zero
        vector is near to nothing.
        """
        served = self._of(states, skill)
        candidates = RowCandidates(served, 0.0)
        rows, cosines = best(
            partial(largest, candidates.cosine(vector)),
            candidates.slack(vector),
            lambda rows: candidates.cosine(vector, rows),
            candidates.ids,
            k if vector.any() else 0,
        )
        return served.physical(rows), cosines

    def record(self, row: int) -> Record:
        """The record of a row of :meth:`nearest` or :meth:`rows`."""
        return self._rows.record(int(row))

    def records_at(self, rows: Sequence[int]) -> list[Record]:
        """The records of some rows."""
        return [self._rows.heap.get(row) for row in rows]

    def records(self, state: str) -> list[Record]:
        """The records held in a state, by id."""
        rows = np.flatnonzero(self._rows.column("state") == STATES.index(state))
        return sorted((self._rows.heap.read(row) for row in rows.tolist()), key=lambda record: record.id)

    def rows(self, ids: Sequence[str]) -> list[int]:
        """The rows of these ids; ids that the index does not hold are left out."""
        return [self._rows.row_of[id] for id in ids if id in self._rows.row_of]

    def vector(self, row: int) -> NDArray[np.float32]:
        """(D,) the embedding of a row."""
        return np.array(self._rows.vectors.exact[int(row)])

    def _of(self, states: Sequence[str], skill: str) -> Served:
        key = (tuple(sorted(set(states))), skill)
        served = self._served.get(key)
        if served is None or served.rows is not self._rows or served.epoch != self._rows.epoch:
            if len(self._served) >= _KEPT:
                self._served.clear()
            served = self._served[key] = Served(self._rows, states, skill)
        return served

    def _usable(self, changes: Sequence[Change]) -> list[bool]:
        """Which have a sound vector of this embedder's model."""
        model, shape = self._embedder.model, (self._dimension,)
        usable = [c.model == model and c.vector is not None and c.vector.shape == shape for c in changes]
        given = [i for i, there in enumerate(usable) if there]
        for start in range(0, len(given), _TOGETHER):
            some = given[start : start + _TOGETHER]
            stacked = np.stack([np.asarray(changes[i].vector) for i in some])
            for i, fine in zip(some, sound(stacked).tolist(), strict=True):
                usable[i] = fine
        return usable

    def _embed(self, records: Sequence[Record]) -> NDArray[np.float32]:
        if not records:
            return np.zeros((0, self._dimension), np.float32)
        made = self._embedder.embed([text_of(record.query, record.content) for record in records])
        return np.nan_to_num(np.asarray(made, np.float32))
