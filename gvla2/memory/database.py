"""The databases that hold a memory's tables: connections and atomic transactions, on SQLite and PostgreSQL.

All other queries are SQLAlchemy's, and the same for both. A SQLite file is shared by many processes, a PostgreSQL
server by many machines. No file that is not a memory is ever replaced, moved or deleted: an unusable one is left as it
is, and named in the error.
"""

from __future__ import annotations

import os
import random
import re
import sqlite3
import sys
import time
import zlib
from abc import ABC, abstractmethod
from collections.abc import Iterator
from contextlib import closing, contextmanager, suppress
from pathlib import Path
from typing import Any
from urllib.parse import quote

from sqlalchemy import URL, Connection, Engine, create_engine, event, insert, select, text
from sqlalchemy.exc import SQLAlchemyError
from sqlalchemy.pool import QueuePool

from gvla2.errors import ConfigurationError, MemoryStoreError, MissingDependencyError
from gvla2.memory.events import META, METADATA, SCHEMA_VERSION, TABLES

if sys.platform != "win32":
    import fcntl


class Database(ABC):
    """Connections to one database; ``name`` is the file or address for messages, without a password.

    Idle connections are kept and hold no lock; each thread has its own, and a forked process new ones. Every failure is
    a :class:`~gvla2.errors.MemoryStoreError`.
    """

    begin_reading: str
    """The statement that begins a consistent view."""

    def __init__(self, name: str, engine: Engine) -> None:
        self.name, self.engine = name, engine
        self._pid, self._closed = os.getpid(), False

    @abstractmethod
    def begin(self, connection: Connection, bank: str) -> None:
        """Begin a transaction that keeps other writers of the bank out."""

    def check(self) -> None:  # noqa: B027  # a server's database cannot be replaced while it is open
        """Before a commit: raises :class:`MemoryStoreError` where the change would be lost."""

    @abstractmethod
    def compact(self) -> None:
        """Rewrite the database without deleted data; frees space."""

    @abstractmethod
    def explained(self, error: BaseException) -> MemoryStoreError:
        """What went wrong, and what to do."""

    @contextmanager
    def connection(self) -> Iterator[Connection]:
        """A connection outside any transaction."""
        if self._closed:
            raise MemoryStoreError(f"The memory {self.name} is closed.")
        if self._pid != os.getpid():
            # After a fork, the parent's connections must be neither used nor closed here.
            self.engine.dispose(close=False)
            self._pid = os.getpid()
        try:
            with self.engine.connect() as connection:
                yield connection
        except (SQLAlchemyError, OSError, UnicodeError) as error:
            raise self.explained(error) from error
        except Exception as error:
            if type(error).__module__ in ("sqlite3", "psycopg.errors", "psycopg"):
                raise self.explained(error) from error
            raise

    @contextmanager
    def reading(self) -> Iterator[Connection]:
        """A consistent view, held until the end of the block."""
        with self.connection() as connection, _ended(connection):
            connection.exec_driver_sql(self.begin_reading)
            yield connection

    @contextmanager
    def writing(self, bank: str) -> Iterator[Connection]:
        """A transaction that keeps other writers of the bank out from its start; an exception undoes all of it."""
        with self.connection() as connection, _ended(connection):
            self.begin(connection, bank)
            yield connection
            self.check()

    def close(self) -> None:
        """Close all connections; safe to call twice."""
        self._closed = True
        self.engine.dispose(close=self._pid == os.getpid())


@contextmanager
def _ended(connection: Connection) -> Iterator[None]:
    try:
        yield
        connection.exec_driver_sql("COMMIT")
    except BaseException:
        # It never began, or a full disk or lost server has already undone it.
        with suppress(SQLAlchemyError):
            connection.exec_driver_sql("ROLLBACK")
        raise


def engine_of(url: URL, **options: Any) -> Engine:
    """An engine that leaves transactions to explicit BEGINs."""
    pool: dict[str, Any] = {"poolclass": QueuePool, "max_overflow": -1}
    return create_engine(url, isolation_level="AUTOCOMMIT", skip_autocommit_rollback=True, **pool, **options)


def create_tables(connection: Connection) -> None:
    """Create the tables of :data:`SCHEMA_VERSION` and record it, within the connection's transaction."""
    METADATA.create_all(connection, checkfirst=False)
    connection.execute(insert(META), {"key": "schema", "value": str(SCHEMA_VERSION)})


def refuse_version(name: str, stated: str) -> None:
    """Raises :class:`MemoryStoreError` for tables of a different version than ours."""
    if stated != str(SCHEMA_VERSION):
        raise MemoryStoreError(
            f"The memory {name} has schema {stated}, and this gvla2 reads {SCHEMA_VERSION} only. It is unchanged: "
            "open it with the gvla2 that wrote it, or choose another database."
        )


# SQLite ---------------------------------------------------------------------------------------------------------------

_HINTS = {
    "locked|busy": "Another process holds it: wait for it, or choose another file.",
    "readonly|unable to open|Permission": "It, or its folder, is gone or not writable: choose another file.",
    "not a database|malformed": "It is corrupt and was left as it is: restore it from a copy, or choose another file.",
    "full": "The change was not stored: free some space, and try again.",
    "disk I/O": "The change was not stored: is the disk full or failing, or is there a limit on files?",
}
"""What to do, by SQLite's or the system's message."""


class SqliteDatabase(Database):
    """One file at ``path`` (created if ``create``).

    Waits for other processes at most ``busy_seconds`` at a time. Connections never recreate a deleted file.
    """

    begin_reading = "BEGIN"

    def __init__(self, path: Path, busy_seconds: float, create: bool) -> None:
        self._path, self._busy_seconds = path, busy_seconds
        try:
            self._prepare(create)
            self._identity = self._inode()
        except MemoryStoreError:
            raise
        except Exception as error:
            raise self.explained(error) from error
        super().__init__(str(path), self._engine())

    def begin(self, connection: Connection, bank: str) -> None:
        """Take the write lock: a transaction that reads first and writes later would fail under contention.

        SQLite's own waiting sleeps ever longer, so the last to come is served first. Here the pauses get shorter the
        longer a process has waited: none starves.
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

    def check(self) -> None:
        """Check that the file still exists: a change to a deleted file would be lost."""
        if self._inode() != self._identity:
            raise MemoryStoreError(
                f"The memory {self._path} was deleted or replaced while it was open, and the change was not stored: "
                f"restore it, and open it again."
            )

    def compact(self) -> None:
        """Rewrite the file without deleted data, and empty the write-ahead log."""
        with self.connection() as connection:
            raw: Any = connection.connection.dbapi_connection
            raw.execute("PRAGMA secure_delete=ON")
            try:
                raw.execute("VACUUM")
                busy = raw.execute("PRAGMA wal_checkpoint(TRUNCATE)").fetchone()[0]
            finally:
                raw.execute("PRAGMA secure_delete=OFF")
        if busy:
            raise MemoryStoreError(
                f"The memory {self._path} cannot be compacted now: another process is reading it."
            )

    def explained(self, error: BaseException) -> MemoryStoreError:
        """The message of SQLite or the file system, with the file, and what to do."""
        said = str(getattr(error, "orig", None) or error)
        hint = next((f" {hint}" for words, hint in _HINTS.items() if re.search(words, said)), "")
        return MemoryStoreError(f"The memory {self._path} cannot be used: {said}.{hint}")

    def _opened(self, mode: str = "rw", **options: Any) -> sqlite3.Connection:
        """A connection that creates no file unless ``mode`` is rwc."""
        address, wait = f"file:{quote(str(self._path))}?mode={mode}", self._busy_seconds
        opened: sqlite3.Connection = sqlite3.connect(address, uri=True, timeout=wait, **options)
        return opened

    def _engine(self, mode: str = "rw") -> Engine:
        def connect() -> sqlite3.Connection:
            raw = self._opened(mode, isolation_level=None, check_same_thread=False, cached_statements=256)
            # One damaged text must not hide the others: invalid UTF-8 stays bytes, which no text column may hold.
            raw.text_factory = _text_or_bytes
            raw.execute("PRAGMA journal_mode=WAL")
            raw.execute("PRAGMA synchronous=FULL")
            return raw

        return engine_of(URL.create("sqlite", database=str(self._path)), creator=connect)

    def _inode(self) -> tuple[int, int]:
        try:
            found = self._path.stat()
        except FileNotFoundError:
            return (0, 0)
        return (found.st_dev, found.st_ino)

    # The file -----------------------------------------------------------------------------------------------------

    def _prepare(self, create: bool) -> None:
        """Make sure that the file holds the memory's tables, created by one process only.

        Raises for a file that is locked, corrupt, of another schema, or another program's database, and for one without
        any tables unless ``create``; all of them are left unchanged.
        """
        path = self._path
        if path.exists() and not path.is_file():
            what = "a folder" if path.is_dir() else "a device or a pipe"
            raise MemoryStoreError(
                f"The memory {path} cannot be used: it is {what}. Give the path of a file."
            )
        if self._usable():
            return
        if not create:
            what = "empty" if path.exists() else "absent"
            raise MemoryStoreError(f"There is no memory in {path} yet: it is {what}.")
        path.parent.mkdir(parents=True, exist_ok=True)
        with self._creation_lock():
            if not self._usable():
                engine = self._engine("rwc")
                with engine.connect() as connection:
                    connection.exec_driver_sql("BEGIN IMMEDIATE")
                    create_tables(connection)
                    connection.exec_driver_sql("COMMIT")
                engine.dispose()

    def _usable(self) -> bool:
        """Whether the file has our tables; False for one that is absent or empty. Raises for all others."""
        path = self._path
        if not path.exists() or path.stat().st_size == 0:
            return False
        with closing(self._opened()) as connection:
            tables = connection.execute("SELECT name FROM sqlite_master WHERE type = 'table'").fetchall()
            names = {name for (name,) in tables}
            if not names:
                return False
            if "memory_meta" not in names:
                raise MemoryStoreError(f"{path} is the database of another program: choose another file.")
            found = connection.execute("SELECT value FROM memory_meta WHERE key = 'schema'").fetchone()
            health = connection.execute("PRAGMA quick_check(1)").fetchone()
        if health is None or health[0] != "ok":
            raise MemoryStoreError(f"The memory {path} is corrupt: {health[0] if health else 'unreadable'}.")
        refuse_version(str(path), str(found[0]) if found and "memory" in names else "none")
        return True

    @contextmanager
    def _creation_lock(self) -> Iterator[None]:
        """One process at a time: switching a new file to write-ahead logging does not wait for others by itself."""
        with self._path.with_name(f".{self._path.name}.lock").open("a") as handle:
            if sys.platform != "win32":  # where there are only SQLite's own locks
                fcntl.flock(handle, fcntl.LOCK_EX)
            yield  # closing the file releases the lock


def _text_or_bytes(stored: bytes) -> str | bytes:
    try:
        return stored.decode()
    except UnicodeDecodeError:
        return stored


# PostgreSQL -----------------------------------------------------------------------------------------------------------

_SPACE = 0x6776_6C61
"""First half of the advisory locks' keys, to avoid collisions with other programs."""


class PostgresDatabase(Database):
    """PostgreSQL through psycopg (extra ``postgres``); with ``create``, one process makes the tables.

    Waits for other writers, and for the server, at most ``busy_seconds`` at a time. Acknowledged changes survive a lost
    server.
    """

    begin_reading = "BEGIN ISOLATION LEVEL REPEATABLE READ READ ONLY"

    def __init__(self, url: URL, busy_seconds: float, create: bool) -> None:
        try:
            import psycopg
        except ImportError as error:
            raise MissingDependencyError(
                "psycopg", "A memory in PostgreSQL", 'pip install "gvla2[postgres]"'
            ) from error
        self._psycopg = psycopg
        try:
            plain = url.set(drivername="postgresql").render_as_string(hide_password=False)
            given = psycopg.conninfo.conninfo_to_dict(plain)
        except psycopg.Error as error:
            why = "Not a PostgreSQL address: give postgresql://user@host/database."
            raise ConfigurationError(why) from error
        shown = {name: value for name, value in given.items() if name not in ("password", "sslpassword")}
        engine = engine_of(url, connect_args={"connect_timeout": max(2, round(busy_seconds))})
        super().__init__(f"postgresql({psycopg.conninfo.make_conninfo('', **shown)})", engine)

        @event.listens_for(engine, "connect")
        def _connected(raw: object, _: object) -> None:
            wait = f"lock_timeout = {max(1, int(busy_seconds * 1000))}"
            for setting in ("synchronous_commit = on", wait, "client_encoding = 'UTF8'"):
                raw.execute(f"SET {setting}")  # type: ignore[attr-defined]

        try:
            self._prepare(create)
        except BaseException:
            self.close()
            raise

    def _prepare(self, create: bool) -> None:
        with self.writing("") as connection:
            there = set(self.engine.dialect.get_table_names(connection))
            if there.isdisjoint(table.name for table in TABLES):
                if not create:
                    raise MemoryStoreError(f"There is no memory in {self.name} yet: it has no tables.")
                create_tables(connection)
                return
            if META.name not in there:
                raise MemoryStoreError(
                    f"The database {self.name} has a table 'memory' of another program: choose a different database."
                )
            stated = connection.execute(select(META.c.value).where(META.c.key == "schema")).scalar()
        refuse_version(self.name, str(stated))

    def begin(self, connection: Connection, bank: str) -> None:
        """Take the bank's lock.

        Revs are allocated under it, so they become visible in order, unlike those of a sequence: a reader that has seen
        a rev has seen all before it.
        """
        connection.exec_driver_sql("BEGIN ISOLATION LEVEL READ COMMITTED")
        lock = zlib.crc32(bank.encode()) - 2**31 if bank else 0
        connection.execute(text("SELECT pg_advisory_xact_lock(:a, :b)"), {"a": _SPACE, "b": lock})

    def compact(self) -> None:
        """Rewrite the tables without deleted data.

        The server's own copies (write-ahead log until it is recycled, backups) are out of reach.
        """
        with self.connection() as connection:
            connection.exec_driver_sql(f"VACUUM (FULL) {', '.join(table.name for table in TABLES)}")
            connection.exec_driver_sql("CHECKPOINT")

    def explained(self, error: BaseException) -> MemoryStoreError:
        """The server's error as one of ours."""
        cause = getattr(error, "orig", None) or error
        hint = ""
        if isinstance(cause, self._psycopg.errors.LockNotAvailable):
            hint = " Another process holds the lock: wait for it."
        elif isinstance(cause, self._psycopg.OperationalError):
            hint = " Is the server running, and does it accept this user?"
        said = " ".join(str(cause).split())
        return MemoryStoreError(f"The memory {self.name} cannot be used: {said}.{hint}")
