"""The banks of a database: where it is, how it is opened, and atomic transactions that are safe across processes.

All queries are SQLAlchemy's, and the same for SQLite and PostgreSQL; only locking and compaction differ. A SQLite file
is shared by many processes, a PostgreSQL server by many machines. No file that is not a memory is ever replaced, moved
or deleted: an unusable one is left as it is, and named in the error.
"""

from __future__ import annotations

import fcntl
import os
import random
import re
import sqlite3
import time
import unicodedata
import zlib
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping
from contextlib import closing, contextmanager, suppress
from pathlib import Path
from typing import Any

from sqlalchemy import URL, Connection, create_engine, event, insert, select, text
from sqlalchemy.exc import SQLAlchemyError
from sqlalchemy.pool import QueuePool

from gvla2.errors import ConfigurationError, MemoryStoreError, MissingDependencyError
from gvla2.io.database_url import Closing, parsed
from gvla2.io.files import own_file
from gvla2.memory.tables import BANK, META, METADATA, SCHEMA_VERSION, TABLES
from gvla2.memory.transaction import Transaction
from gvla2.memory.view import BankView

LONGEST_NAME = 200


class Store(Closing, ABC):
    """An open database of banks. Any number of processes and threads may have the same one open.

    ``name`` is the file or address for messages, without a password. Idle connections are kept and hold no lock; each
    thread has its own, and a forked process new ones. Every method raises :class:`~gvla2.errors.MemoryStoreError` when
    the database cannot be used. Damaged rows are skipped when reading and reported by
    :func:`~gvla2.memory.view.audit`; they block nothing else.
    """

    begin_reading: str
    """The statement that begins a consistent view."""
    exists = True
    shared = True
    """Whether the database may hold other programs' tables too."""

    def __init__(self, name: str, url: URL, **options: Any) -> None:
        self.name = name
        # Transactions are begun explicitly.
        options |= {"poolclass": QueuePool, "max_overflow": -1, "skip_autocommit_rollback": True}
        self._engine = create_engine(url, isolation_level="AUTOCOMMIT", **options)
        self._pid, self._closed = os.getpid(), False

    @staticmethod
    def open(address: str | Path, *, busy_seconds: float = 5.0, create: bool = True) -> Store:
        """Open or create the database at a path, ``sqlite:///path`` or ``postgresql://user@host/name``.

        Waits for others at most ``busy_seconds`` at a time. Without ``create``, a database without tables is refused
        and left unchanged, and so is one with the tables of another version of gvla2. Raises
        :class:`~gvla2.errors.ConfigurationError` for any other address.
        """
        url = parsed(address)
        kind = SqliteStore if url.drivername == "sqlite" else PostgresStore
        store = kind(url, busy_seconds)
        try:
            store._prepare(create)
        except BaseException:
            store.close()
            raise
        return store

    @abstractmethod
    def _begin(self, connection: Connection, bank: str) -> None:
        """Begin a transaction that keeps other writers of the bank out."""

    @abstractmethod
    def _compact(self, connection: Connection) -> None:
        """Rewrite the database without deleted data."""

    @contextmanager
    def _creating(self) -> Iterator[None]:
        """Whatever must be there before tables can be made."""
        yield

    def _check(self) -> None:  # a server's database cannot be replaced while it is open
        """Before a commit: raises :class:`MemoryStoreError` where the change would be lost."""

    def _check_health(self, connection: Connection) -> None:  # servers look after their own files
        """Raises :class:`MemoryStoreError` for a corrupt database."""

    @contextmanager
    def reading(self, bank: str) -> Iterator[BankView]:
        """A consistent snapshot of a bank, held until the end of the block."""
        with self._connection() as connection, _ended(connection):
            connection.exec_driver_sql(self.begin_reading)
            yield BankView(connection, bank)

    @contextmanager
    def writing(self, bank: str, *, actor: str, now: float) -> Iterator[Transaction]:
        """A transaction that keeps other writers of ``bank`` out from its start; any exception undoes all of it.

        ``actor`` is the decision's author (a command, an operation of the bank), ``now`` seconds since the epoch. All
        its changes get one ``rev``, which is allocated here; a transaction without changes leaves no trace.
        """
        check_bank(bank)
        with self._connection() as connection, _ended(connection):
            self._begin(connection, bank)
            transaction = Transaction(connection, bank, actor, now)
            yield transaction
            transaction.finish()
            self._check()
        if transaction.forgotten:
            try:
                self.compact()
            except MemoryStoreError as error:
                raise MemoryStoreError(
                    f"{', '.join(transaction.forgotten)}: forgotten, and no longer in the bank, but deleted data may "
                    f"be left in the files of {self.name} ({error}) They go when something is forgotten again."
                ) from error

    def rev(self, bank: str) -> int:
        """The number of the bank's last transaction, 0 for none; cheap enough to read before each query."""
        with self._connection() as connection:
            return BankView(connection, bank).rev

    def banks(self) -> list[str]:
        """Names of the banks ever written to."""
        with self._connection() as connection:
            return sorted(map(str, connection.execute(select(BANK.c.bank)).scalars()))

    def compact(self) -> None:
        """Rewrite the database without deleted data, and free space."""
        with self._connection() as connection:
            self._compact(connection)

    def close(self) -> None:
        """Release the database; safe to call twice."""
        self._closed = True
        self._engine.dispose(close=self._pid == os.getpid())

    @contextmanager
    def _connection(self) -> Iterator[Connection]:
        """A connection outside any transaction; every failure is one of ours, with what to do."""
        if self._closed:
            raise MemoryStoreError(f"The memory {self.name} is closed.")
        if self._pid != os.getpid():
            # After a fork, the parent's connections must be neither used nor closed here.
            self._engine.dispose(close=False)
            self._pid = os.getpid()
        try:
            with self._engine.connect() as connection:
                yield connection
        except Exception as error:
            foreign = type(error).__module__.startswith(("sqlite3", "psycopg"))
            if not foreign and not isinstance(error, SQLAlchemyError | OSError | UnicodeError):
                raise
            self._check()
            said = " ".join(str(getattr(error, "orig", None) or error).split())
            hint = next((f" {hint}" for words, hint in _HINTS.items() if re.search(words, said)), "")
            raise MemoryStoreError(f"The memory {self.name} cannot be used: {said}.{hint}") from error

    def _prepare(self, create: bool) -> None:
        """Make sure that the database has our tables, created by one process only."""
        if self.exists:
            with self._connection() as connection:
                if self._has_tables(connection):
                    return
        if not create:
            raise MemoryStoreError(f"There is no memory in {self.name} yet.")
        with self._creating(), self._connection() as connection, _ended(connection):
            self._begin(connection, "")
            if not self._has_tables(connection):
                METADATA.create_all(connection, checkfirst=False)
                connection.execute(insert(META), {"key": "schema", "value": str(SCHEMA_VERSION)})

    def _has_tables(self, connection: Connection) -> bool:
        """Whether the database has our tables; raises for another program's or version's, and for a corrupt one."""
        names = set(connection.dialect.get_table_names(connection))
        if META.name not in names:
            if names.isdisjoint(table.name for table in TABLES) and (self.shared or not names):
                return False
            raise MemoryStoreError(f"{self.name} is the database of another program: choose another one.")
        stated = connection.execute(select(META.c.value).where(META.c.key == "schema")).scalar()
        if stated != str(SCHEMA_VERSION):
            raise MemoryStoreError(
                f"The memory {self.name} has schema {stated}, and this gvla2 reads {SCHEMA_VERSION} only. It is "
                "unchanged: open it with the gvla2 that wrote it, or choose another database."
            )
        self._check_health(connection)
        return True


@contextmanager
def _ended(connection: Connection) -> Iterator[None]:
    """Commit the transaction that begins in the block, or undo it."""
    try:
        yield
        connection.exec_driver_sql("COMMIT")
    except BaseException:
        # It never began, or a full disk or lost server has already undone it.
        with suppress(SQLAlchemyError):
            connection.exec_driver_sql("ROLLBACK")
        raise


_HINTS = {
    "locked|busy|lock timeout": "Another process holds the lock: wait for it, or choose another database.",
    "readonly|unable to open|Permission": "It, or its folder, is gone or not writable: choose another file.",
    "not a database|malformed": "It is corrupt and was left as it is: restore it from a copy, or choose another file.",
    "full|disk I/O": "The change was not stored: is the disk full or failing, or is there a limit on files?",
    "connection|server": "Is the server running, and does it accept this user?",
}
"""What to do, by words of the database's message."""


class SqliteStore(Store):
    """A file in write-ahead mode; a connection never recreates a deleted one."""

    shared, begin_reading = False, "BEGIN"

    def __init__(self, url: URL, busy_seconds: float) -> None:
        self._path, self._busy_seconds = Path(str(url.database)), busy_seconds
        if self._path.exists() and not self._path.is_file():
            raise MemoryStoreError(f"The memory {self._path} cannot be used: it is not a file.")
        super().__init__(str(self._path), url, creator=self._connect)
        self._opened: tuple[int, int] | None = None  # the file's inode

    def _connect(self) -> sqlite3.Connection:
        raw = sqlite3.connect(
            f"{self._path.as_uri()}?mode=rw",
            uri=True,
            timeout=self._busy_seconds,
            isolation_level=None,
            check_same_thread=False,
            cached_statements=256,
        )
        # One damaged text must not hide the others: invalid UTF-8 stays bytes, which no text column may hold.
        raw.text_factory = _text_or_bytes
        raw.execute("PRAGMA synchronous=FULL")
        self._opened = self._opened or self._inode()
        return raw

    @property
    def exists(self) -> bool:  # type: ignore[override]
        """Whether the file is there and not empty."""
        try:
            return self._path.stat().st_size > 0
        except OSError:
            return False

    @contextmanager
    def _creating(self) -> Iterator[None]:
        """One process at a time: switching a new file to write-ahead logging does not wait for others by itself."""
        try:
            self._path.parent.mkdir(parents=True, exist_ok=True)
            lock = self._path.with_name(f".{self._path.name}.lock")
            with open(lock, "a", opener=own_file) as handle:
                fcntl.flock(handle, fcntl.LOCK_EX)
                self._path.touch()
                with closing(sqlite3.connect(self._path, timeout=self._busy_seconds)) as raw:
                    raw.execute("PRAGMA journal_mode=WAL")
                yield
        except (OSError, sqlite3.Error) as error:
            raise MemoryStoreError(f"The memory {self.name} cannot be used: {error}.") from error

    def _begin(self, connection: Connection, bank: str) -> None:
        """Take the write lock: a transaction that reads first and writes later would fail under contention.

        SQLite's own waiting sleeps ever longer, so the last to come is served first, and some of eight writers meet
        the time-out. Here the pauses get shorter the longer a process has waited: none starves.
        """
        raw: Any = connection.connection.dbapi_connection
        began = time.monotonic()
        raw.execute("PRAGMA busy_timeout=0")
        try:
            while True:
                try:
                    raw.execute("BEGIN IMMEDIATE")
                    return
                except sqlite3.OperationalError as error:
                    waited = time.monotonic() - began
                    if error.sqlite_errorcode & 0xFF != sqlite3.SQLITE_BUSY or waited > self._busy_seconds:
                        raise
                time.sleep(random.uniform(0.5, 1.5) * max(0.0002, 0.004 * (1 - waited / 0.3)))
        finally:
            raw.execute(f"PRAGMA busy_timeout={int(1000 * self._busy_seconds)}")

    def _check(self) -> None:
        """Check that the file still exists: a change to a deleted file would be lost."""
        if self._opened is not None and self._inode() != self._opened:
            raise MemoryStoreError(
                f"The memory {self.name} was deleted or replaced while it was open, and the change was not stored: "
                f"restore it, and open it again."
            )

    def _check_health(self, connection: Connection) -> None:
        """Quick, and sees a damaged page."""
        health = connection.exec_driver_sql("PRAGMA quick_check(1)").scalar()
        if health != "ok":
            raise MemoryStoreError(f"The memory {self.name} is corrupt: {health}.")

    def _compact(self, connection: Connection) -> None:
        """Rewrite the file, and empty the write-ahead log."""
        connection.exec_driver_sql("PRAGMA secure_delete=ON")
        try:
            connection.exec_driver_sql("VACUUM")
            if connection.exec_driver_sql("PRAGMA wal_checkpoint(TRUNCATE)").scalar():
                raise MemoryStoreError(
                    f"The memory {self.name} cannot be compacted now: another process is reading it."
                )
        finally:
            connection.exec_driver_sql("PRAGMA secure_delete=OFF")

    def _inode(self) -> tuple[int, int] | None:
        with suppress(FileNotFoundError):
            found = self._path.stat()
            return found.st_dev, found.st_ino
        return None


def _text_or_bytes(stored: bytes) -> str | bytes:
    try:
        return stored.decode()
    except UnicodeDecodeError:
        return stored


_SPACE = 0x6776_6C61
"""First half of the advisory locks' keys, to avoid collisions with other programs."""


class PostgresStore(Store):
    """PostgreSQL through psycopg (extra ``postgres``). Acknowledged changes survive a lost server."""

    begin_reading = "BEGIN ISOLATION LEVEL REPEATABLE READ READ ONLY"

    def __init__(self, url: URL, busy_seconds: float) -> None:
        try:
            import psycopg  # noqa: F401
        except ImportError as error:
            raise MissingDependencyError(
                "psycopg", "A memory in PostgreSQL", 'pip install "gvla2[postgres]"'
            ) from error
        name = url.difference_update_query(["password", "sslpassword"]).render_as_string()
        super().__init__(name, url, connect_args={"connect_timeout": max(2, round(busy_seconds))})

        @event.listens_for(self._engine, "connect")
        def _connected(raw: Any, _: object) -> None:
            wait = f"lock_timeout = {max(1, int(busy_seconds * 1000))}"
            for setting in ("synchronous_commit = on", wait, "client_encoding = 'UTF8'"):
                raw.execute(f"SET {setting}")

    def _begin(self, connection: Connection, bank: str) -> None:
        """Take the bank's lock.

        Revs are allocated under it, so they become visible in order, unlike those of a sequence: a reader that has seen
        a rev has seen all before it.
        """
        connection.exec_driver_sql("BEGIN ISOLATION LEVEL READ COMMITTED")
        lock = zlib.crc32(bank.encode()) - 2**31 if bank else 0
        connection.execute(text("SELECT pg_advisory_xact_lock(:a, :b)"), {"a": _SPACE, "b": lock})

    def _compact(self, connection: Connection) -> None:
        """Rewrite the tables; the server's own copies (its log until it is recycled, backups) are out of reach."""
        connection.exec_driver_sql(f"VACUUM (FULL) {', '.join(table.name for table in TABLES)}")
        connection.exec_driver_sql("CHECKPOINT")


def resolved_address(address: str, environment: Mapping[str, str]) -> str:
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
    """Raises :class:`~gvla2.errors.ConfigurationError` for a name that a bank cannot have.

    Letters and digits of any language and ``. _ - /``, the first a letter or digit, composed (NFC), so that
    equal-looking names are equal. Spaces, quotes, control characters and direction marks would be misread in a shell, a
    message or a file name.
    """
    letters = all(c in "._-/" or unicodedata.category(c)[0] in "LMN" for c in name) and name[:1].isalnum()
    if not letters or len(name) > LONGEST_NAME or not unicodedata.is_normalized("NFC", name):
        raise ConfigurationError(
            f"{name[:LONGEST_NAME]!a} cannot be the name of a bank: a name begins with a letter or digit, continues "
            f"with letters and digits of any language and . _ - /, and has at most {LONGEST_NAME} characters."
        )
