"""The banks of a database: where it is, how it is opened, and atomic transactions that are safe across processes."""

from __future__ import annotations

import unicodedata
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from sqlalchemy import select

from gvla2.errors import ConfigurationError, MemoryStoreError
from gvla2.io.database_url import Closing, parsed
from gvla2.memory.database import Database, PostgresDatabase, SqliteDatabase
from gvla2.memory.events import BANK
from gvla2.memory.transaction import Transaction
from gvla2.memory.view import BankView

LONGEST_NAME = 200


class Store(Closing):
    """An open database of banks. Any number of processes and threads may have the same one open.

    Every method raises :class:`~gvla2.errors.MemoryStoreError` when the database cannot be used. Damaged rows are
    skipped when reading and reported by :func:`~gvla2.memory.audit.audit`; they block nothing else.
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
            return cls(SqliteDatabase(Path(str(url.database)), busy_seconds, create))
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
        if transaction.forgotten:
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
        """Numbers about a bank: records by state and type, links, events, episodes, rev, head of the chain."""
        with self.reading(bank) as view:
            return view.counts()

    def compact(self, forgotten: Sequence[str] = ()) -> None:
        """Free space, and remove deleted data from the files; ``forgotten`` are the ids forgotten just now."""
        try:
            self._database.compact()
        except MemoryStoreError as error:
            if not forgotten:
                raise
            raise MemoryStoreError(
                f"{', '.join(forgotten)}: forgotten, and no longer in the bank, but deleted data may be left in the "
                f"files of {self.name} ({error}) They go when something is forgotten again, or with Store.compact()."
            ) from error

    def close(self) -> None:
        """Release the database; safe to call twice."""
        self._database.close()


# Addresses and names -------------------------------------------------------------------------------------------------


def settled(address: str, environment: Mapping[str, str]) -> str:
    """The absolute address to open for ``address``, since a run may change its working directory later.

    "" is ``memory.db`` in ``$GVLA2_HOME``, else in ``$XDG_DATA_HOME/gvla2``, else in ``~/.local/share/gvla2``.
    """
    if not address:
        data = environment.get("XDG_DATA_HOME") or "~/.local/share"
        folder = environment.get("GVLA2_HOME") or f"{data}/gvla2"
        address = f"sqlite:///{(Path(folder).expanduser() / 'memory.db').absolute()}"
    url = parsed(address)
    return f"sqlite:///{url.database}" if url.drivername == "sqlite" else address


def check_bank(name: str) -> None:
    """Raises :class:`~gvla2.errors.ConfigurationError` where a memory's option ``bank`` cannot be a bank's name."""
    if wrong := wrong_bank_name(name):
        raise ConfigurationError(f"The option 'memory.bank' is wrong: {wrong}")


def wrong_bank_name(name: str) -> str:
    """Why ``name`` is not a valid bank name, as a sentence; "" if it is.

    Letters and digits of any language and ``. _ - /``, the first a letter or digit, composed (NFC), so that
    equal-looking names are equal. Spaces, quotes, control characters and direction marks would be misread in a shell, a
    message or a file name.
    """
    letters = all(c in "._-/" or unicodedata.category(c)[0] in "LMN" for c in name) and name[:1].isalnum()
    if letters and len(name) <= LONGEST_NAME and unicodedata.is_normalized("NFC", name):
        return ""
    printed = "".join(c if c.isprintable() else f"\\u{ord(c):04x}" for c in name[:LONGEST_NAME])
    return (
        f"'{printed}' cannot be the name of a bank: a name begins with a letter or digit, continues with letters and "
        f"digits of any language and . _ - /, and has at most {LONGEST_NAME} characters."
    )
