"""The memory in a SQLite file that many processes share: created once, refused if unusable.

Nothing here ever replaces, moves or deletes a file that is not a copy of a memory: an unusable file is left as it is,
and named in the error.
"""

from __future__ import annotations

import random
import re
import sqlite3
import sys
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any
from urllib.parse import quote

from sqlalchemy import URL, Connection, Engine

from gvla2.errors import MemoryStoreError
from gvla2.memory.database import Database, create_tables, engine_of, refuse_version

if sys.platform != "win32":
    import fcntl

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

    def size(self) -> int:
        """Bytes of the file and its log."""
        files = [self._path, self._path.with_name(self._path.name + "-wal")]
        return sum(file.stat().st_size for file in files if file.exists())

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
