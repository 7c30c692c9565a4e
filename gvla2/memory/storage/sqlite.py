"""The memory in a SQLite file that many processes share: created once, refused where it cannot be used.

Nothing here ever replaces, moves or deletes a file that is no copy of a memory: what cannot be used is left as it is,
and named.
"""

from __future__ import annotations

import os
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
from gvla2.memory.storage.database import Database, create_tables, engine_of, refuse_version

if sys.platform != "win32":
    import fcntl

BESIDE = ("-wal", "-shm", "-journal")
"""What SQLite adds to the name of a file for others beside it."""
_READ_ONLY = "The memory {} is read-only. Make it writable, or choose another file."
_EMPTY_LOG = "PRAGMA wal_checkpoint(TRUNCATE)"
_SCRUB = ("PRAGMA secure_delete=ON", _EMPTY_LOG, "VACUUM", _EMPTY_LOG)
_HINTS = {
    "locked|busy": "Another process holds it: wait for it, or choose another file.",
    "readonly|unable to open|Permission": "It, or its folder, is gone or not writable: choose another file.",
    "not a database|malformed": "It is corrupt and was left as it is: restore it from a copy, or choose another file.",
    "full": "Nothing of the change was stored: make room, and try again.",
    "disk I/O": "Nothing of the change was stored: is the disk full or failing, or is there a limit on files?",
}
"""What to do, by what SQLite or the system said."""


class SqliteDatabase(Database):
    """One file, made ready at ``path`` (created if ``create``).

    Waits for other processes at most ``busy_seconds`` at a time. A file that cannot be written is read. Connections
    never bring a deleted file back.
    """

    begin_reading = "BEGIN"

    def __init__(self, path: Path, busy_seconds: float, create: bool) -> None:
        self._path, self._busy_seconds = path, busy_seconds
        try:
            self._prepare(create)
            self._identity = _identity(path)
        except MemoryStoreError:
            raise
        except Exception as error:
            raise self.explained(error) from error
        super().__init__(str(path), self._engine())

    def begin(self, connection: Connection, bank: str) -> None:
        """Take the write lock: a transaction that reads first and writes later would fail under contention.

        SQLite's own way of waiting sleeps ever longer, so that whoever comes last goes first. Here the pauses get
        shorter the longer one has waited: nobody starves.
        """
        self._refuse_read_only()
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
        """A change to a file that has no name any more would be lost."""
        if _identity(self._path) != self._identity:
            raise MemoryStoreError(
                f"The memory {self._path} was deleted or replaced while it was open, and nothing of the change was "
                "stored: put it back, and open it again."
            )

    def scrub(self) -> None:
        """Write the file anew without what was deleted, and empty the write-ahead log."""
        self._refuse_read_only()
        with self.connection() as connection:
            raw: Any = connection.connection.dbapi_connection
            try:
                for step in _SCRUB:
                    answer = raw.execute(step).fetchone()
                    if step == _EMPTY_LOG and answer and answer[0]:
                        raise MemoryStoreError(
                            f"The memory {self._path} cannot be cleaned now: another process is reading it."
                        )
            finally:
                raw.execute("PRAGMA secure_delete=OFF")

    def size(self) -> int:
        """Bytes of the file and its log."""
        files = [self._path, self._path.with_name(self._path.name + "-wal")]
        return sum(file.stat().st_size for file in files if file.exists())

    def explained(self, error: BaseException) -> MemoryStoreError:
        """What SQLite or the file system said, with the file, and what to do."""
        said = str(getattr(error, "orig", None) or error)
        hint = next((f" {hint}" for words, hint in _HINTS.items() if re.search(words, said)), "")
        return MemoryStoreError(f"The memory {self._path} cannot be used: {said}.{hint}")

    def _refuse_read_only(self) -> None:
        if not self._writable:
            raise MemoryStoreError(_READ_ONLY.format(self._path))

    def _address(self, mode: str = "") -> str:
        """How to open the file: not creating it, and changing nothing of one that may not be changed.

        Without a log beside it, which cannot be made then, nobody is writing just now: that is seen anew each time.
        """
        if not mode and not self._writable:
            beside = [self._path.with_name(self._path.name + suffix) for suffix in BESIDE]
            mode = "mode=ro" if any(path.exists() for path in beside) else "immutable=1"
        return f"file:{quote(str(self._path))}?{mode or 'mode=rw'}"

    def _opened(self, mode: str = "", **options: Any) -> sqlite3.Connection:
        address, wait = self._address(mode), self._busy_seconds
        opened: sqlite3.Connection = sqlite3.connect(address, uri=True, timeout=wait, **options)
        return opened

    def _engine(self, mode: str = "") -> Engine:
        """Connections to the file; those for reading alone are not kept."""

        def connect() -> sqlite3.Connection:
            raw = self._opened(mode, isolation_level=None, check_same_thread=False, cached_statements=256)
            # One damaged text must not hide the others: what is no UTF-8 stays bytes, which no text column may hold.
            raw.text_factory = _text_or_bytes
            if self._writable:
                raw.execute("PRAGMA journal_mode=WAL")
            raw.execute("PRAGMA synchronous=FULL")
            return raw

        url = URL.create("sqlite", database=str(self._path))
        return engine_of(url, pooled=self._writable, creator=connect)

    # The file -----------------------------------------------------------------------------------------------------

    def _prepare(self, create: bool) -> None:
        """Make sure that the file holds the memory's tables, creating them once among all processes.

        Raises for a file that is locked, corrupt, of another schema, or the database of something else, and for one
        without any tables unless ``create``; all of them are left as they are.
        """
        path = self._path
        if path.exists() and not path.is_file():
            what = "a folder" if path.is_dir() else "a device or a pipe"
            raise MemoryStoreError(
                f"The memory {path} cannot be used: it is {what}. Give the path of a file."
            )
        # An administrator who takes all write bits away means it, for root as well.
        self._writable = not path.exists() or bool(
            path.stat().st_mode & 0o222 and os.access(path, os.W_OK) and os.access(path.parent, os.W_OK)
        )
        if self._usable():
            return
        what = "empty" if path.exists() else "absent"
        if not create:
            raise MemoryStoreError(f"There is no memory in {path} yet: it is {what}.")
        if not self._writable:
            raise MemoryStoreError(f"{_READ_ONLY.format(path)} It is {what}.")
        path.parent.mkdir(parents=True, exist_ok=True)
        with self._creation_lock():
            if not self._usable():
                engine = self._engine("mode=rwc")
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
                raise MemoryStoreError(f"{path} is the database of something else: choose another file.")
            found = connection.execute("SELECT value FROM memory_meta WHERE key = 'schema'").fetchone()
            health = connection.execute("PRAGMA quick_check(1)").fetchone()
        if health is None or health[0] != "ok":
            raise MemoryStoreError(f"The memory {path} is corrupt: {health[0] if health else 'unreadable'}.")
        refuse_version(str(path), str(found[0]) if found and "memory" in names else "none")
        return True

    @contextmanager
    def _creation_lock(self) -> Iterator[None]:
        """One process at a time: switching a new file to write-ahead logging does not wait for others by itself."""
        if sys.platform == "win32":
            yield  # SQLite's own locks are all there is
            return
        with self._path.with_name(f".{self._path.name}.lock").open("a") as handle:
            deadline = time.monotonic() + self._busy_seconds
            while True:
                try:
                    fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
                    break
                except BlockingIOError as error:
                    if time.monotonic() > deadline:
                        raise MemoryStoreError(
                            f"The memory {self._path} is being created by another process."
                        ) from error
                    time.sleep(0.01)
            yield  # closing the file lets go of the lock


def _text_or_bytes(stored: bytes) -> str | bytes:
    try:
        return stored.decode()
    except UnicodeDecodeError:
        return stored


def _identity(path: Path) -> tuple[int, int]:
    try:
        found = path.stat()
    except FileNotFoundError:
        return (0, 0)
    return (found.st_dev, found.st_ino)
