"""SQLite files that many processes share: how one is created once, brought up to date, and refused.

Nothing here ever replaces, moves or deletes a file: what cannot be used is left as it is, and named.
"""

from __future__ import annotations

import os
import sqlite3
import sys
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from urllib.parse import quote

from sqlalchemy.dialects.sqlite.pysqlite import dialect as sqlite_dialect

from gvla2.errors import MemoryStoreError
from gvla2.memory.storage.database import SCHEMA_VERSION

if sys.platform != "win32":
    import fcntl


BESIDE = ("-wal", "-shm", "-journal")
"""What SQLite adds to the name of a file for others beside it."""
READ_ONLY = "The memory {} is read-only. Make it writable, or choose another file."


def prepare(path: Path, busy_seconds: float, create: bool = True) -> bool:
    """Make sure that ``path`` holds the memory's tables, creating or migrating them once among all processes.

    Returns whether the bank can be written; what cannot is left as it is, to the byte. Raises
    :class:`MemoryStoreError` for a file that is locked, corrupt, of a later schema, or the database of something
    else, and for one without any tables unless ``create``.
    """
    with explained(path):
        if not _writable(path):
            version = _version(path, busy_seconds)
            if version < SCHEMA_VERSION:
                what = f"of schema {version}, which has to be brought up to date" if version else "empty"
                raise MemoryStoreError(f"{READ_ONLY.format(path)} It is {what}.")
            return False
        version = _version(path, busy_seconds)
        if version == SCHEMA_VERSION and _logs_ahead(path):
            return True
        if not version and not create:
            what = "empty" if path.exists() else "absent"
            raise MemoryStoreError(f"There is no memory in {path} yet: it is {what}.")
        path.parent.mkdir(parents=True, exist_ok=True)
        with _creation_lock(path, busy_seconds):
            version = _version(path, busy_seconds)
            if version == 0:
                _create(path, busy_seconds)
            elif version < SCHEMA_VERSION:
                from gvla2.memory.storage.migrations import migrate

                migrate(path, version, busy_seconds)
            if not _logs_ahead(path):
                with closing(sqlite3.connect(path, timeout=busy_seconds)) as connection:
                    connection.execute("PRAGMA journal_mode=WAL")
    return True


def connect_to_read(path: Path, busy_seconds: float) -> sqlite3.Connection:
    """A connection to a file that cannot be written; good for one transaction.

    Without a log beside it, which cannot be made, nobody is writing just now.
    """
    address = f"file:{quote(str(path))}?{'mode=ro' if _in_use(path) else 'immutable=1'}"
    return sqlite3.connect(
        address, uri=True, timeout=busy_seconds, isolation_level=None, check_same_thread=False
    )


def _writable(path: Path) -> bool:
    """Whether a file, and its folder for the log, can be written; a file that is absent counts as one that can."""
    if not path.exists():
        return True
    # An administrator who takes all write bits away means it, for root as well.
    bits = path.is_dir() or path.stat().st_mode & 0o222
    return bool(bits) and os.access(path, os.W_OK) and os.access(path.parent, os.W_OK)


def refuse_to_replace(path: Path, busy_seconds: float) -> None:
    """Make the folder of a copy to be; raises for a file there that is no memory, or one that is in use."""
    path.parent.mkdir(parents=True, exist_ok=True)
    if _in_use(path):
        raise MemoryStoreError(f"The memory {path} is in use: write the copy to another file.")
    if path.is_dir():
        raise MemoryStoreError(
            f"A copy cannot be written to {path}: it is a folder. Give the path of a file."
        )
    if path.exists() and path.stat().st_size:
        _look(path, "immutable=1", busy_seconds)


def delete_database(path: Path) -> None:
    """Delete a file that is no memory in use, and what SQLite has left beside it."""
    for suffix in ("", *BESIDE):
        path.with_name(path.name + suffix).unlink(missing_ok=True)


def _logs_ahead(path: Path) -> bool:
    """Whether the file is in the mode where readers and a writer don't block one another; its header says so."""
    with path.open("rb") as handle:
        return handle.read(20)[18:20] == b"\x02\x02"


def _version(path: Path, busy_seconds: float) -> int:
    """The version of the tables in a file that is usable; 0 for a file that is absent or empty."""
    if not path.exists():
        return 0
    if path.is_dir():
        raise MemoryStoreError(f"The memory {path} cannot be used: it is a folder. Give the path of a file.")
    if not path.is_file():
        raise MemoryStoreError(
            f"The memory {path} cannot be used: it is a device or a pipe. Give the path of a file."
        )
    if path.stat().st_size == 0:
        return 0
    # Looking must not change a file that is then refused, nor leave a write-ahead log beside it, as reading does
    # unless the file is said to be immutable. It is not if others have it open; they leave a log beside it, too.
    if not _in_use(path):
        try:
            version = _look(path, "immutable=1", busy_seconds)
            if not _writable(path):
                return version
        except (sqlite3.Error, MemoryStoreError):
            if not _in_use(path):
                raise
    return _look(path, "mode=ro", busy_seconds)


def _in_use(path: Path) -> bool:
    """Whether a log lies beside the file: somebody has it open, or crashed and left something to recover."""
    return any(path.with_name(path.name + suffix).exists() for suffix in BESIDE)


def _look(path: Path, mode: str, busy_seconds: float) -> int:
    """The version of the tables in the file, 0 for no tables at all; raises for a file to be refused."""
    address = f"file:{quote(str(path))}?{mode}"
    with closing(sqlite3.connect(address, uri=True, timeout=busy_seconds)) as connection:
        names = {row[0] for row in connection.execute("SELECT name FROM sqlite_master WHERE type = 'table'")}
        if not names:
            return 0
        if "memory_meta" not in names:
            raise MemoryStoreError(f"{path} is the database of something else: choose another file.")
        found = connection.execute("SELECT value FROM memory_meta WHERE key = 'schema'").fetchone()
        version = int(found[0]) if found and str(found[0]).isdigit() else -1
        if version > SCHEMA_VERSION:
            raise MemoryStoreError(
                f"The memory {path} has schema {version}, this gvla2 knows up to {SCHEMA_VERSION}: update gvla2, "
                "or choose another file."
            )
        if version < 1 or "memory" not in names:
            raise MemoryStoreError(f"The memory {path} is damaged: its schema is not stated.")
        health = connection.execute("PRAGMA quick_check(1)").fetchone()
        if health is None or health[0] != "ok":
            raise MemoryStoreError(f"The memory {path} is corrupt: {health[0] if health else 'unreadable'}.")
    return version


def _create(path: Path, busy_seconds: float) -> None:
    with closing(sqlite3.connect(path, timeout=busy_seconds)) as connection:
        connection.execute("PRAGMA journal_mode=WAL")
    with closing(sqlite3.connect(path, timeout=busy_seconds, isolation_level=None)) as connection:
        connection.execute("PRAGMA synchronous=FULL")
        connection.execute("BEGIN IMMEDIATE")
        create_tables(connection)
        connection.execute("COMMIT")


def create_tables(connection: sqlite3.Connection) -> None:
    """Create the tables of :data:`SCHEMA_VERSION` and state it, within the connection's transaction."""
    from gvla2.memory.storage.tables import (
        create_statements,  # SQLModel is slow to import: only who creates pays
    )

    for statement in create_statements(sqlite_dialect()):
        connection.execute(statement)
    connection.execute("INSERT INTO memory_meta VALUES ('schema', ?)", (str(SCHEMA_VERSION),))


@contextmanager
def _creation_lock(path: Path, busy_seconds: float) -> Iterator[None]:
    """One process at a time: switching a new file to write-ahead logging does not wait for others by itself."""
    if sys.platform == "win32":
        yield  # SQLite's own locks are all there is
        return
    lock = path.with_name(f".{path.name}.lock")
    with lock.open("a") as handle:
        deadline = time.monotonic() + busy_seconds
        while True:
            try:
                fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
                break
            except BlockingIOError as error:
                if time.monotonic() > deadline:
                    raise MemoryStoreError(
                        f"The memory {path} is being created or migrated by another process."
                    ) from error
                time.sleep(0.01)
        yield  # closing the file lets go of the lock


@contextmanager
def explained(path: Path) -> Iterator[None]:
    """Turn what SQLite and the file system say into a :class:`MemoryStoreError` that names the file."""
    try:
        yield
    except (sqlite3.Error, OSError, UnicodeError) as error:
        said = str(error)
        hint = ""
        if "locked" in said or "busy" in said:
            hint = " Another process holds it: wait for it, or choose another file."
        elif "readonly" in said or isinstance(error, PermissionError) or "unable to open" in said:
            hint = " It, or its folder, is gone or not writable: choose another file."
        elif "not a database" in said or "malformed" in said:
            hint = " It is corrupt and was left as it is: restore it from a copy, or choose another file."
        elif "full" in said:
            hint = " Nothing of the change was stored: make room, and try again."
        elif "disk I/O" in said:
            hint = " Nothing of the change was stored: is the disk full or failing, or is there a limit on files?"
        raise MemoryStoreError(f"The memory {path} cannot be used: {said}.{hint}") from error
