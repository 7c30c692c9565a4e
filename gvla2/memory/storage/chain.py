"""The head of a bank's chain of events within a transaction: every change is written through it, with its reason."""

from __future__ import annotations

import os
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager

from sqlalchemy import Connection, Table, delete, insert, update

from gvla2.errors import MemoryStoreError
from gvla2.memory.records import FORGOTTEN, clean, dump, finite
from gvla2.memory.storage.database import upsert
from gvla2.memory.storage.events import EVENT_COLUMNS, GENESIS, RESERVED, chain_hash, payload_digest
from gvla2.memory.storage.tables import BANK, EVENT, RECORD
from gvla2.memory.storage.view import View

MAX_WHY = 2000
LATEST = 253402300799.0
"""The last second of the year 9999: what no calendar knows, no clock means, and later times could not follow it."""
_TOGETHER = 500
ERASED = {"why": "", "scores": "", "change": "", "origin": "", "salt": b""}
"""What is left of the payload of an event that told of something forgotten."""


class Chain:
    """The next transaction of one bank: its ``rev``, its time ``now`` (never before the bank's last change), and the
    events up to now. Whoever makes one holds the bank's write lock.
    """

    def __init__(self, connection: Connection, bank: str, actor: str, now: float) -> None:
        if not abs(now) <= LATEST:
            raise MemoryStoreError(
                f"The time of a change must be a finite number of seconds, before the year 10000, not {now}."
            )
        self.sql, self._view = connection, View(connection)
        head = self._view.head(bank)
        self.bank, self.actor = bank, clean(actor, 200)
        self.rev: int = (head.rev if head else 0) + 1
        self.now: float = max(float(now), head.at) if head else float(now)
        self.models: dict[str, int] = self._view.models(bank)
        self.seq: int = head.seq if head else 0
        self._hash: str = head.hash if head else GENESIS
        self._began, self._half = self.seq, False
        self.written: set[str] = set()
        """Ids of the records that were put: they are sound, and of this rev."""
        self._events: list[dict[str, object]] = []

    @property
    def view(self) -> View:
        """The banks as they are within this transaction."""
        self.flush()
        return self._view

    @contextmanager
    def whole(self) -> Iterator[None]:
        """A change of rows that must not be committed when it fails midway, whoever catches the error."""
        self._half = True
        yield
        self._half = False

    def check_action(self, action: str) -> None:
        """Raises :class:`MemoryStoreError` for a name that only the store itself may give an event."""
        if not action or action.partition(":")[0] in RESERVED:
            raise MemoryStoreError(f"'{action}' cannot be the name of a decision: choose another one.")

    def event(
        self,
        action: str,
        record: str = "",
        target: str = "",
        *,
        why: str = "",
        scores: Mapping[str, float] | None = None,
        change: str = "",
        origin: str = "",
    ) -> None:
        """The next event; written together with later ones, by :meth:`flush`."""
        salt = os.urandom(16)
        payload = (
            clean(why, MAX_WHY),
            dump(finite(scores)) if scores else "{}",
            change,
            clean(origin, MAX_WHY),
        )
        digest = payload_digest(salt, payload)
        self.seq += 1
        header = (self.bank, self.seq, self.rev, self.now, self.actor, clean(action, 64), record, target)
        prev, self._hash = self._hash, chain_hash(self._hash, header, digest)
        values = (*header, *payload, salt, digest, prev, self._hash)
        self._events.append(dict(zip(EVENT_COLUMNS, values, strict=True)))

    def flush(self) -> None:
        """Write the events up to now; done before anything is read in ways that could show them."""
        if self._events:
            events, self._events = self._events, []
            self.sql.execute(insert(EVENT), events)

    def erase(self, *, naming: Collection[str] = (), seqs: Collection[int] = ()) -> None:
        """Forget what events say: those about these records or links to them, or those of these numbers.

        An event of the forgetting must follow: an erased one without it counts as damage.
        """
        self.flush()
        for column, wanted in ((EVENT.c.record, naming), (EVENT.c.target, naming), (EVENT.c.seq, seqs)):
            ordered = sorted(wanted)
            for start in range(0, len(ordered), _TOGETHER):
                some = column.in_(ordered[start : start + _TOGETHER])
                self.sql.execute(update(EVENT).where(EVENT.c.bank == self.bank, some).values(ERASED))

    def touch(self, ids: Collection[str]) -> None:
        """Let these records count as changed (rev), so that an index hears of it."""
        ordered = sorted(set(ids))
        for start in range(0, len(ordered), _TOGETHER):
            some = RECORD.c.id.in_(ordered[start : start + _TOGETHER])
            where = (RECORD.c.bank == self.bank) & some & (RECORD.c.state != FORGOTTEN)
            self.sql.execute(update(RECORD).where(where).values(rev=self.rev))

    def delete(self, table: Table, column: str, values: Collection[str]) -> None:
        """Delete the bank's rows of a table whose column has one of these values."""
        ordered = sorted(set(values))
        for start in range(0, len(ordered), _TOGETHER):
            some = table.c[column].in_(ordered[start : start + _TOGETHER])
            self.sql.execute(delete(table).where(table.c.bank == self.bank, some))

    def finish(self) -> None:
        """Advance the bank's own row, if anything happened; the last thing before the commit."""
        if self._half:
            raise MemoryStoreError("A change failed midway, so that its transaction cannot be committed.")
        self.flush()
        if self.seq != self._began:
            values = (self.bank, self.rev, self.seq, self._hash, self.now, dump(self.models))
            row = dict(zip(BANK.columns.keys(), values, strict=True))
            self.sql.execute(upsert(self.sql, BANK, ("bank",)), row)
