"""One transaction's changes to a bank, with an index that knows of them before they are committed."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gvla2.memory.contracts import Embedder, Inducer
from gvla2.memory.embedding import record_vectors
from gvla2.memory.forgetting import Transaction
from gvla2.memory.index import SERVED, STATES, Index
from gvla2.memory.options import BankOptions
from gvla2.memory.records import Record
from gvla2.memory.store import Store
from gvla2.memory.trust import Origin

_UNLIKE = 0.1
"""Records with a smaller cosine are not rivals and need not be read. Lessons of one wording for different tasks may
have less than .2, as half of a vector is the task's."""


class OpenBank:
    """What decisions about the bank named ``bank`` need: its store, its index in RAM, and its options.

    ``clock`` gives seconds since the epoch; ``retired_at`` is when failures were last checked for retirement.
    """

    def __init__(
        self,
        store: Store,
        bank: str,
        index: Index,
        embedder: Embedder,
        options: BankOptions,
        inducer: Inducer | None,
        clock: Callable[[], float],
    ) -> None:
        self.store, self.bank, self.index, self.embedder = store, bank, index, embedder
        self.options, self.inducer, self.clock = options, inducer, clock
        self.retired_at = -1e18


@contextmanager
def deciding(bank: OpenBank, actor: str) -> Iterator[Ledger]:
    """A ledger of the current bank; the index follows at the end."""
    with bank.store.writing(bank.bank, actor=actor, now=bank.clock()) as transaction:
        if bank.index.rev != transaction.rev - 1:
            bank.index.refresh()  # no other writer from here on
        yield Ledger(transaction, bank)
    bank.index.refresh()


class Ledger:
    """A bank within a transaction: stored records, index lookups, and what was changed so far.

    The index must be up to date when the transaction begins.
    """

    def __init__(self, transaction: Transaction, bank: OpenBank) -> None:
        self.transaction, self.index, self.options = transaction, bank.index, bank.options
        self.now: float = transaction.now
        self._embedder = bank.embedder
        self._changed: dict[str, Record] = {}
        self._vectors: dict[str, NDArray[np.float32]] = {}  # of changed texts
        self._by_key: dict[str, Record | None] = {}
        self._origins: dict[str, list[Origin]] = {}

    def get(self, id: str) -> Record | None:
        """The record as changed so far."""
        return self._changed.get(id) or self.transaction.get(id)

    def latest(self, record: Record) -> Record:
        """The present version of a record read earlier."""
        return self._changed.get(record.id, record)

    def changed(self) -> list[Record]:
        """The records changed so far, in the order of their first change."""
        return list(self._changed.values())

    def expect(self, keys: Iterable[str]) -> None:
        """Read the records of these dedup keys, and their origins, at once."""
        wanted = list(keys)
        found = self.transaction.by_keys(wanted)
        self._by_key |= dict.fromkeys(wanted) | found
        ids = [record.id for record in found.values()]
        read = self.transaction.origins(ids)
        self._origins |= {id: _read(read.get(id, [])) for id in ids}

    def by_key(self, key: str) -> Record | None:
        """The record with this dedup key."""
        if key not in self._by_key:
            self.expect([key])
        found = self._by_key[key]
        return self.latest(found) if found is not None else None

    def origins(self, id: str) -> list[Origin]:
        """The origins of a record's evidence."""
        if id not in self._origins:
            self._origins[id] = _read(self.transaction.origins([id]).get(id, []))
        return self._origins[id]

    def nearest(
        self, vector: NDArray[np.float32], k: int, states: Sequence[str] = SERVED
    ) -> list[tuple[Record, float]]:
        """The records of these states nearest to a unit (D,) vector with their cosines, best first, equal ones by id.

        Dissimilar ones are left out.
        """
        near = self.index.nearest(vector, k, states)
        found = {record.id: (self.latest(record), cosine) for record, cosine in near}
        if self._vectors:
            alike = np.stack([*self._vectors.values()]) @ vector
            for id, cosine in zip(self._vectors, alike.tolist(), strict=True):
                found[id] = (self._changed[id], cosine)
        kept = [one for one in found.values() if one[0].state in states and one[1] >= _UNLIKE]
        return sorted(kept, key=lambda entry: (-entry[1], entry[0].id))[:k]

    def vector(self, record: Record) -> NDArray[np.float32]:
        """(D,) the embedding of a record's text, or of its text when stored."""
        known = self._vectors.get(record.id)
        stored = self.index.vector(record.id) if known is None else known
        return self._embedded(record) if stored is None else stored

    def put(
        self,
        record: Record,
        action: str,
        why: str = "",
        *,
        vector: NDArray[np.float32] | None = None,
        origin: Origin | None = None,
    ) -> Record:
        """Store a record; ``vector`` (D,) is that of its text, if known. Returns it as stored."""
        before = self._changed.get(record.id) or self.index.get(record.id)
        if record.state not in STATES:
            vector = None
        elif vector is None and (before is None or before.text != record.text):
            vector = self._embedded(record)
        model = self._embedder.model if vector is not None else ""
        if not record.version:
            self._origins[record.id] = []
        if origin is not None:
            self.origins(record.id).append(origin)
        stored = self.transaction.put(
            record, action, vector=vector, model=model, why=why, origin="" if origin is None else str(origin)
        )
        self._changed[record.id] = self._by_key[record.dedup_key] = stored
        if vector is not None:
            self._vectors[record.id] = vector
        return stored

    def archive(self, record: Record, action: str, why: str, note: str = "") -> None:
        """Archive a record; its note says why."""
        self.put(replace(self.latest(record), state="archive", note=note or why), action, why)

    def _embedded(self, record: Record) -> NDArray[np.float32]:
        vectors = record_vectors(self._embedder, [(record.query, record.content)])
        return np.asarray(vectors[0], np.float32)


def _read(origins: Iterable[str]) -> list[Origin]:
    return [origin for text in origins if (origin := Origin.read(text)) is not None]
