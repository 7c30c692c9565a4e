"""The banks of a database: transactions that are whole or nothing, safe among processes, and their whole history."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gvla2.errors import MemoryStoreError
from gvla2.memory.records import Record, clean
from gvla2.memory.storage.addresses import wrong_bank_name
from gvla2.memory.storage.audit import Problem, audit
from gvla2.memory.storage.chain import Chain
from gvla2.memory.storage.database import Database
from gvla2.memory.storage.episodes import StoredEpisode
from gvla2.memory.storage.events import Event, Link
from gvla2.memory.storage.forgetting import scrub
from gvla2.memory.storage.putting import Put, StaleRecordError, write_vectors
from gvla2.memory.storage.rebuilding import Rebuilt, rebuild
from gvla2.memory.storage.transaction import Tie, Transaction
from gvla2.memory.storage.view import Change, View

__all__ = [
    "Change",
    "Event",
    "Link",
    "Problem",
    "Put",
    "Rebuilt",
    "Record",
    "StaleRecordError",
    "Store",
    "StoredEpisode",
    "Tie",
    "Transaction",
    "View",
]


class Store:
    """An open database of banks. Any number of processes and threads may have the same one open.

    Every method raises :class:`~gvla2.errors.MemoryStoreError` when the database cannot be used. Damaged rows are
    passed over when reading and named by :meth:`verify`; they hold up nothing else.
    """

    def __init__(self, database: Database) -> None:
        self._database = database

    @classmethod
    def open(cls, address: str | Path, *, busy_seconds: float = 5.0, create: bool = True) -> Store:
        """Open or create the database at a path, ``sqlite:///path`` or ``postgresql://user@host/name``.

        Waits for others at most ``busy_seconds`` at a time. Without ``create``, what has no tables yet stays so and
        is refused, and so is what another version of gvla2 wrote in other tables. A file that cannot be written is
        opened for reading: only what writes is refused then. Raises :class:`~gvla2.errors.ConfigurationError` for any
        other address.
        """
        return cls(Database.open(address, busy_seconds, create))

    @property
    def name(self) -> str:
        """The file or address, as messages say it."""
        return self._database.name

    @contextmanager
    def reading(self) -> Iterator[View]:
        """All banks as they are at one instant, for reads that must agree with one another."""
        with self._database.reading() as connection:
            yield View(connection)

    @contextmanager
    def writing(self, bank: str, *, actor: str, now: float) -> Iterator[Transaction]:
        """A transaction that keeps other writers of ``bank`` out from its start; any exception undoes all of it.

        ``actor`` is who decides (a command, an operation of the bank), ``now`` seconds since the epoch. All its
        changes get one ``rev``, which is allocated here; a transaction without changes leaves no trace.
        """
        wrong = wrong_bank_name(bank)
        if wrong and (bank != clean(bank, 200) or not self.rev(bank)):  # old banks may have other names
            raise MemoryStoreError(wrong)
        with self._database.writing(bank) as connection:
            transaction = Transaction(connection, bank, actor, now)
            yield transaction
            transaction.finish()
        if transaction.to_scrub:
            scrub(self._database, transaction.forgotten)

    # Reading: each call is one instant ----------------------------------------------------------------------------

    def rev(self, bank: str) -> int:
        """The number of the bank's last transaction, 0 for none; cheap enough to ask before each query."""
        with self._database.connection() as connection:
            return View(connection).rev(bank)

    def changes(self, bank: str, since: int) -> list[Change]:
        """What transactions after ``since`` changed, each record once, by rev and id; forgotten ones too."""
        with self.reading() as view:
            return view.changes(bank, since)

    def records(
        self, bank: str, states: Sequence[str] | None = None, ids: Sequence[str] | None = None
    ) -> list[Record]:
        """The records in these states, with these ids (all by default; never forgotten ones), by id."""
        with self.reading() as view:
            return view.records(bank, states, ids)

    def links(self, bank: str, id: str | None = None) -> list[Link]:
        """The links of the bank, or those that name one record on either end."""
        with self.reading() as view:
            return view.links(bank, None if id is None else [id])

    def history(self, bank: str, id: str) -> list[Event]:
        """The events about one record (or one episode's source), oldest first."""
        with self.reading() as view:
            return view.history(bank, id)

    def events(self, bank: str, since: int = 0, limit: int | None = None) -> list[Event]:
        """The events with seq > ``since``, oldest first, at most ``limit``."""
        with self.reading() as view:
            return view.events(bank, since, limit)

    def episodes(self, bank: str, sources: Sequence[str] | None = None) -> list[StoredEpisode]:
        """The stored episodes, of these sources or all, by time and source."""
        with self.reading() as view:
            return view.episodes(bank, sources)

    def banks(self) -> list[str]:
        """Names of the banks that anything was ever written to."""
        with self.reading() as view:
            return view.banks()

    def as_of(self, bank: str, time: float) -> list[Record]:
        """The records as they were at ``time`` (seconds since the epoch), by id, without what was forgotten since."""
        with self.reading() as view:
            return list(rebuild(view.stream_events(bank, time)).records)

    def rebuild(self, bank: str) -> Rebuilt:
        """Records and links from the events alone; canonical JSON equal to the rows' byte for byte."""
        with self.reading() as view:
            return rebuild(view.stream_events(bank))

    def verify(self, bank: str, *, head: str = "") -> list[Problem]:
        """What is wrong with a bank: its chain, payloads, rows against events, vectors, episodes; [] for nothing.

        ``head`` is "SEQ:HASH" of an event, as :meth:`stats` had them once and somebody kept elsewhere: with it, a
        chain whose end was cut off, or that was written anew, is found as well.
        """
        with self.reading() as view:
            return audit(view, bank, head)

    def stats(self, bank: str) -> dict[str, Any]:
        """Numbers about a bank: records by state and type, links, events, episodes, rev, head of the chain, bytes."""
        with self.reading() as view:
            return {**view.counts(bank), "bytes": self._database.size()}

    # Upkeep -------------------------------------------------------------------------------------------------------

    def save_vectors(
        self, bank: str, model: str, vectors: Sequence[tuple[Record, NDArray[np.floating[Any]]]]
    ) -> int:
        """Keep embeddings that an index made anew; how many were kept: those whose record has not changed since.

        Vectors are derived data: this is no event, and no change of any record.
        """
        with self._database.writing(bank) as connection:
            return write_vectors(Chain(connection, bank, "", 0.0), model, vectors)

    def compact(
        self,
        bank: str | None = None,
        *,
        archived_before: float | None = None,
        now: float | None = None,
        actor: str = "compact",
    ) -> int:
        """Give space back, and overwrite what was forgotten where that is pending.

        With a ``bank`` and ``archived_before`` (seconds since the epoch), archived records not updated since then
        are forgotten first; how many is returned.
        """
        gone: list[str] = []
        if bank is not None and archived_before is not None:
            with self.writing(bank, actor=actor, now=time.time() if now is None else now) as transaction:
                old = [r.id for r in transaction.records(["archive"]) if r.updated < archived_before]
                gone = transaction.forget_many(old, why="archived long ago") if old else []
        if not gone:  # else forgetting has scrubbed already
            scrub(self._database)
        return len(gone)

    def snapshot(self, path: Path | str) -> None:
        """Write a consistent copy of a SQLite database to a new file. What is forgotten later stays in copies."""
        self._database.snapshot(Path(path))

    def close(self) -> None:
        """Release the database; safe to call twice."""
        self._database.close()

    def __enter__(self) -> Store:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
