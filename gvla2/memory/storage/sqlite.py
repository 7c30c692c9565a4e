"""The memory in a SQLite file that many processes share: its connections and transactions."""

from __future__ import annotations

import os
import random
import sqlite3
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any
from urllib.parse import quote

from gvla2.errors import MemoryStoreError
from gvla2.memory.storage.database import Row, Uncleaned
from gvla2.memory.storage.sqlite_file import (
    READ_ONLY,
    connect_to_read,
    delete_database,
    explained,
    prepare,
    refuse_to_replace,
)

ROWS_AT_ONCE = 2000
_EMPTY_LOG = "PRAGMA wal_checkpoint(TRUNCATE)"
_SCRUB = ("PRAGMA secure_delete=ON", _EMPTY_LOG, "VACUUM", _EMPTY_LOG)


def connect(path: Path, busy_seconds: float) -> sqlite3.Connection:
    """A connection on which only explicit BEGINs open transactions, and a commit is on the disk.

    The file is there already: one that was deleted must not come back empty.
    """
    connection = sqlite3.connect(
        f"file:{quote(str(path))}?mode=rw",
        uri=True,
        timeout=busy_seconds,
        isolation_level=None,
        check_same_thread=False,
        cached_statements=256,
    )
    connection.execute("PRAGMA synchronous=FULL")
    return connection


class SqliteConnection:
    """A :class:`gvla2.memory.storage.database.Connection`."""

    def __init__(self, raw: sqlite3.Connection) -> None:
        self.raw = raw

    def rows(self, sql: str, values: Sequence[Any] = ()) -> list[Row]:
        """All rows of a query."""
        try:
            return self.raw.execute(sql, values).fetchall()
        except sqlite3.OperationalError as error:
            if "decode to UTF-8" not in str(error):
                raise
        # One damaged text must not hide the others: what is no UTF-8 stays bytes, which no text column may hold.
        self.raw.text_factory = _text_or_bytes
        try:
            return self.raw.execute(sql, values).fetchall()
        finally:
            self.raw.text_factory = str

    def row(self, sql: str, values: Sequence[Any] = ()) -> Row | None:
        """The first row of a query, None where there is none."""
        rows = self.rows(sql, values)
        return rows[0] if rows else None

    def stream(self, sql: str, values: Sequence[Any] = ()) -> Iterator[Row]:
        """The rows of a query, a few at a time."""
        cursor = self.raw.cursor()
        cursor.row_factory = None
        self.raw.text_factory = _text_or_bytes
        try:
            cursor.execute(sql, values)
            while rows := cursor.fetchmany(ROWS_AT_ONCE):
                yield from rows
        finally:
            self.raw.text_factory = str
            cursor.close()

    def run(self, sql: str, values: Sequence[Any] = ()) -> int:
        """Run a statement; how many rows it touched."""
        return self.raw.execute(sql, values).rowcount

    def run_many(self, sql: str, values: Iterable[Sequence[Any]]) -> None:
        """Run a statement once for each row of values."""
        self.raw.executemany(sql, values)


def _identity(path: Path) -> tuple[int, int]:
    try:
        found = path.stat()
    except FileNotFoundError:
        return (0, 0)
    return (found.st_dev, found.st_ino)


def _begin(raw: sqlite3.Connection) -> None:
    raw.execute("BEGIN")


def _text_or_bytes(stored: bytes) -> str | bytes:
    try:
        return stored.decode()
    except UnicodeDecodeError:
        return stored


class SqliteDatabase:
    """A :class:`gvla2.memory.storage.database.Database` in one file, opened at ``path`` (created if ``create``).

    Idle connections are kept and hold no lock; each thread works on one of its own, and a forked process on new
    ones. Waits for other processes at most ``busy_seconds`` at a time. A file that cannot be written is read.
    """

    def __init__(self, path: Path, busy_seconds: float, create: bool = True) -> None:
        self._writable = prepare(path, busy_seconds, create)
        self._path, self._busy_seconds = path, busy_seconds
        with explained(path):
            self._identity = _identity(path)
        self._idle: list[SqliteConnection] = []
        self._inherited: list[SqliteConnection] = []
        self._pid = os.getpid()
        self._closed = False

    @property
    def name(self) -> str:
        """The file's path."""
        return str(self._path)

    def _take(self) -> SqliteConnection:
        if self._closed:
            raise MemoryStoreError(f"The memory {self._path} was closed.")
        if self._pid != os.getpid():
            # After a fork, the parent's connections must be neither used nor closed here.
            self._inherited, self._idle, self._pid = self._idle, [], os.getpid()
        try:
            return self._idle.pop()
        except IndexError:
            return SqliteConnection(self._connect())

    def _connect(self) -> sqlite3.Connection:
        return (connect if self._writable else connect_to_read)(self._path, self._busy_seconds)

    def _give(self, connection: SqliteConnection) -> None:
        if self._closed or connection.raw.in_transaction or not self._writable:
            connection.raw.close()
        else:
            self._idle.append(connection)

    @contextmanager
    def reading(self) -> Iterator[SqliteConnection]:
        """A consistent view, held until the end of the block."""
        with self._transaction(_begin) as connection:
            yield connection

    @contextmanager
    def writing(self, bank: str) -> Iterator[SqliteConnection]:
        """A transaction that holds the write lock from its start; an exception undoes all of it."""
        with self._transaction(self._begin_to_write) as connection:
            yield connection
            if _identity(self._path) != self._identity:
                # The change would go into a file that has no name any more, and be lost.
                raise MemoryStoreError(
                    f"The memory {self._path} was deleted or replaced while it was open, and nothing of the change was "
                    "stored: put it back, and open it again."
                )

    @contextmanager
    def _transaction(self, begin: Callable[[sqlite3.Connection], object]) -> Iterator[SqliteConnection]:
        with explained(self._path):
            connection = self._take()
            try:
                begin(connection.raw)
                try:
                    yield connection
                    connection.raw.execute("COMMIT")
                except BaseException:
                    if connection.raw.in_transaction:
                        connection.raw.execute("ROLLBACK")
                    raise
            finally:
                self._give(connection)

    def _begin_to_write(self, raw: sqlite3.Connection) -> None:
        """Take the write lock: a transaction that reads first and writes later would fail under contention.

        SQLite's own way of waiting sleeps ever longer, so that whoever comes last goes first. Here the pauses get
        shorter the longer one has waited: nobody starves.
        """
        if not self._writable:
            raise MemoryStoreError(READ_ONLY.format(self._path))
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

    def one(self, sql: str, values: Sequence[Any]) -> Row | None:
        """The first row of a query by itself, as cheaply as can be."""
        with explained(self._path):
            connection = self._take()
            try:
                return connection.row(sql, values)
            finally:
                self._give(connection)

    def scrub(self) -> None:
        """Write the file anew without what was deleted, and empty the write-ahead log."""
        if not self._writable:
            raise MemoryStoreError(READ_ONLY.format(self._path))
        with explained(self._path):
            connection = self._take()
            try:
                for step in _SCRUB:
                    answer = connection.raw.execute(step).fetchone()
                    if step == _EMPTY_LOG and answer and answer[0]:
                        raise MemoryStoreError(
                            f"The memory {self._path} cannot be cleaned now: another process is reading it."
                        )
            finally:
                connection.raw.execute("PRAGMA secure_delete=OFF")
                self._give(connection)

    def forget_in_copies(self, gone: Callable[[], Sequence[tuple[str, str]]]) -> list[Uncleaned]:
        """Take records out of the copies that a migration left beside the file; those that could not be cleaned."""
        from gvla2.memory.storage.migrations import forget_in_copies  # it stands on this module

        return forget_in_copies(self._path, gone, self._busy_seconds)

    def snapshot(self, path: Path) -> None:
        """Write a consistent, compact copy beside ``path``, then put it in its place."""
        with explained(path):
            refuse_to_replace(path, self._busy_seconds)
            aside = path.with_name(f".{path.name}.{os.getpid()}.part")
            delete_database(aside)
            try:
                with closing(self._connect()) as connection:
                    connection.execute("VACUUM INTO ?", (str(aside),))
                with closing(sqlite3.connect(aside)) as copy:
                    copy.execute("PRAGMA journal_mode=WAL")
                with aside.open("rb+") as handle:
                    os.fsync(handle.fileno())
                aside.replace(path)
            finally:
                delete_database(aside)

    def size(self) -> int:
        """Bytes of the file and its log."""
        files = [self._path, self._path.with_name(self._path.name + "-wal")]
        return sum(file.stat().st_size for file in files if file.exists())

    def close(self) -> None:
        """Close idle connections; safe to call twice."""
        self._closed = True
        if self._pid == os.getpid():
            while self._idle:
                self._idle.pop().raw.close()
