"""An open bank, and one transaction's changes to it, which its index follows before they are committed."""

from __future__ import annotations

from collections.abc import Callable, Iterator
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


class LessonLedger:
    """A bank within a transaction: every change goes to the store and to the index."""

    def __init__(self, transaction: Transaction, bank: OpenBank) -> None:
        self.transaction, self.index, self.options = transaction, bank.index, bank.options
        self.now: float = transaction.now
        self._embedder = bank.embedder

    def held(self, state: str) -> list[Record]:
        """The records now in a state, by id."""
        return sorted(self.index.records(state), key=lambda record: record.id)

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
        held, model = self.index.get(record.id), ""
        if record.state not in STATES:
            vector = None
        elif vector is None and (held is None or held.record.text != record.text):
            vector = record_vectors(self._embedder, [(record.query, record.content)])[0]
        if vector is not None:
            model = self._embedder.model
        stored = self.transaction.put(record, action, vector=vector, model=model, why=why, origin=origin)
        self.index.put(stored, vector)
        return stored

    def archive(self, record: Record, action: str, why: str) -> None:
        """Archive a record; its note says why."""
        self.put(replace(record, state="archive", note=why), action, why)


@contextmanager
def deciding(bank: OpenBank, actor: str) -> Iterator[LessonLedger]:
    """A ledger of the current bank; the index forgets what a failed transaction put into it."""
    try:
        with bank.store.writing(bank.bank, actor=actor, now=bank.clock()) as transaction:
            if bank.index.rev != transaction.rev - 1:
                bank.index.refresh()  # no other writer from here on
            yield LessonLedger(transaction, bank)
    except BaseException:
        bank.index.clear()
        raise
    bank.index.refresh()
