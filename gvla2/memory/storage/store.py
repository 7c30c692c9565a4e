"""The banks of a database: atomic transactions, safe across processes, and their whole history."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from sqlalchemy import delete, select

from gvla2.errors import MemoryStoreError
from gvla2.io.database_url import Closing, parsed
from gvla2.memory.storage.addresses import wrong_bank_name
from gvla2.memory.storage.database import Database
from gvla2.memory.storage.forgetting import Transaction
from gvla2.memory.storage.tables import BANK, META, PENDING
from gvla2.memory.storage.view import BankView


class Store(Closing):
    """An open database of banks. Any number of processes and threads may have the same one open.

    Every method raises :class:`~gvla2.errors.MemoryStoreError` when the database cannot be used. Damaged rows are
    skipped when reading and reported by :func:`~gvla2.memory.storage.audit.audit`; they block nothing else.
    """

    def __init__(self, database: Database) -> None:
        self._database = database
        self.name = database.name

    @classmethod
    def open(cls, address: str | Path, *, busy_seconds: float = 5.0, create: bool = True) -> Store:
        """Open or create the database at a path, ``sqlite:///path`` or ``postgresql://user@host/name``.

        Waits for others at most ``busy_seconds`` at a time. Without ``create``, a database without tables is refused
        and left unchanged, and so is one with the tables of another version of gvla2. A read-only file is opened for
        reading: only writes are refused then. Raises :class:`~gvla2.errors.ConfigurationError` for any other address.
        """
        url = parsed(address)
        if url.drivername == "sqlite":
            from gvla2.memory.storage.sqlite import SqliteDatabase

            return cls(SqliteDatabase(Path(str(url.database)), busy_seconds, create))
        from gvla2.memory.storage.postgres import PostgresDatabase

        return cls(PostgresDatabase(url, busy_seconds, create))

    @contextmanager
    def reading(self, bank: str) -> Iterator[BankView]:
        """A consistent snapshot of a bank."""
        with self._database.reading() as connection:
            yield BankView(connection, bank)

    @contextmanager
    def writing(self, bank: str, *, actor: str, now: float) -> Iterator[Transaction]:
        """A transaction that keeps other writers of ``bank`` out from its start; any exception undoes all of it.

        ``actor`` is the decision's author (a command, an operation of the bank), ``now`` seconds since the epoch. All
        its changes get one ``rev``, which is allocated here; a transaction without changes leaves no trace.
        """
        if wrong := wrong_bank_name(bank):
            raise MemoryStoreError(wrong)
        with self._database.writing(bank) as connection:
            transaction = Transaction(connection, bank, actor, now)
            yield transaction
            transaction.finish()
        if transaction.to_scrub:
            self.compact(transaction.forgotten)

    def rev(self, bank: str) -> int:
        """The number of the bank's last transaction, 0 for none; cheap enough to read before each query."""
        with self._database.connection() as connection:
            return BankView(connection, bank).rev

    def banks(self) -> list[str]:
        """Names of the banks ever written to."""
        with self._database.reading() as connection:
            return sorted(map(str, connection.execute(select(BANK.c.bank)).scalars()))

    def stats(self, bank: str) -> dict[str, Any]:
        """Numbers about a bank: records by state and type, links, events, episodes, rev, head of the chain, bytes."""
        with self.reading(bank) as view:
            return {**view.counts(), "bytes": self._database.size()}

    def compact(self, forgotten: Sequence[str] = ()) -> None:
        """Free space, and clean the files of every forgotten byte; ``forgotten`` are the ids forgotten just now.

        If that fails it stays noted, and is tried again next time.
        """
        database, pending = self._database, META.c.key == PENDING
        with database.reading() as sql:
            asked = sql.execute(select(META.c.value).where(pending)).scalar()
        try:
            database.scrub()
            if asked:
                # Unless another process has forgotten something since: it will clean too.
                with database.writing("") as sql:
                    sql.execute(delete(META).where(pending, META.c.value == asked))
        except MemoryStoreError as error:
            if not asked:
                raise
            what = f"{', '.join(forgotten)}: forgotten, and no longer in the bank. " if forgotten else ""
            cause = getattr(error.__cause__, "orig", None) or error.__cause__ or error
            raise MemoryStoreError(
                f"{what}Bytes of forgotten records may be left in {database.name} ({cause}). Once that is resolved, "
                f"run `gvla2 memory compact` (Store.compact), or forget something else."
            ) from error

    def close(self) -> None:
        """Release the database; safe to call twice."""
        self._database.close()
