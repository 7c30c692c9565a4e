"""One transaction's changes to a bank, with an index that knows of them before they are committed."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gvla2.memory.contracts import Embedder, Inducer
from gvla2.memory.embedding import record_vectors
from gvla2.memory.index import STATES, Index
from gvla2.memory.options import BankOptions
from gvla2.memory.records import Record
from gvla2.memory.store import Store
from gvla2.memory.transaction import Transaction

_UNLIKE = 0.1
"""Records with a smaller cosine are not rivals and need not be read. Lessons of one wording for different tasks may
have less than .2, as half of a vector is the task's."""


@dataclass(eq=False)
class OpenBank:
    """What decisions about the bank named ``bank`` need: its store, its index in RAM, and its options.

    ``clock`` gives seconds since the epoch.
    """

    store: Store
    bank: str
    index: Index
    embedder: Embedder
    options: BankOptions
    inducer: Inducer | None
    clock: Callable[[], float]


@contextmanager
def deciding(bank: OpenBank, actor: str) -> Iterator[LessonLedger]:
    """A ledger of the current bank; the index follows at the end."""
    with bank.store.writing(bank.bank, actor=actor, now=bank.clock()) as transaction:
        if bank.index.rev != transaction.rev - 1:
            bank.index.refresh()  # no other writer from here on
        yield LessonLedger(transaction, bank)
    bank.index.refresh()


class LessonLedger:
    """A bank within a transaction: stored records, index lookups, and what was changed so far.

    The index must be up to date when the transaction begins.
    """

    def __init__(self, transaction: Transaction, bank: OpenBank) -> None:
        self.transaction, self.index, self.options = transaction, bank.index, bank.options
        self.now: float = transaction.now
        self._embedder = bank.embedder
        self._changed: dict[str, Record] = {}
        self._vectors: dict[str, NDArray[np.float32]] = {}  # of changed texts

    def latest(self, record: Record) -> Record:
        """The present version of a record of the index."""
        return self._changed.get(record.id, record)

    def changed(self) -> list[Record]:
        """The records changed so far, in the order of their first change."""
        return list(self._changed.values())

    def held(self, state: str) -> list[Record]:
        """The records now in a state, by id."""
        found = {record.id: record for record in self.index.records(state)} | self._changed
        return sorted((one for one in found.values() if one.state == state), key=lambda one: one.id)

    def nearest(
        self, vector: NDArray[np.float32], k: int, states: Sequence[str]
    ) -> list[tuple[Record, float]]:
        """The records of these states nearest to a unit (D,) vector with their cosines, best first, equal ones by id.

        Dissimilar ones are left out.
        """
        near = self.index.nearest(vector, k, states)
        found = {record.id: (self.latest(record), cosine) for record, cosine in near}
        found |= {id: (self._changed[id], float(one @ vector)) for id, one in self._vectors.items()}
        kept = [one for one in found.values() if one[0].state in states and one[1] >= _UNLIKE]
        return sorted(kept, key=lambda entry: (-entry[1], entry[0].id))[:k]

    def put(
        self,
        record: Record,
        action: str,
        why: str = "",
        *,
        vector: NDArray[np.float32] | None = None,
        origin: str = "",
    ) -> Record:
        """Store a record; ``vector`` (D,) is that of its text, if known, and ``origin`` that of new evidence for it.

        Returns it as stored.
        """
        held = self.index.get(record.id)
        before = self._changed.get(record.id) or (held.record if held else None)
        if record.state not in STATES:
            vector = None
        elif vector is None and (before is None or before.text != record.text):
            vector = record_vectors(self._embedder, [(record.query, record.content)])[0]
        model = self._embedder.model if vector is not None else ""
        stored = self.transaction.put(record, action, vector=vector, model=model, why=why, origin=origin)
        self._changed[record.id] = stored
        if vector is not None:
            self._vectors[record.id] = vector
        return stored

    def archive(self, record: Record, action: str, why: str) -> None:
        """Archive a record; its note says why."""
        self.put(replace(self.latest(record), state="archive", note=why), action, why)
