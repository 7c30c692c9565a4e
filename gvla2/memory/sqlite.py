"""SQLite files that many processes share: how one is opened, created once, and refused.

Nothing here ever replaces, moves or deletes a file: what cannot be used is left as it is, and named.
"""

from __future__ import annotations

import sqlite3
import sys
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any
from urllib.parse import quote

from sqlalchemy import Connection, Engine, create_engine, event
from sqlalchemy.engine import URL, make_url
from sqlalchemy.exc import ArgumentError, SQLAlchemyError
from sqlalchemy.pool import QueuePool

from gvla2.errors import ConfigurationError, MemoryStoreError
from gvla2.memory.records import SCHEMA_VERSION, tables

if sys.platform != "win32":
    import fcntl

WRITES = "gvla2_writes"
"""Execution option of connections that will write: they take the write lock when they begin."""


def database_path(url: str) -> Path:
    """The file of ``sqlite:///path``; raises :class:`ConfigurationError` for anything else."""
    try:
        parsed = make_url(url)
    except ArgumentError as error:
        raise ConfigurationError(f"Not a database address: {url!r}. Give sqlite:///path/to/file.") from error
    if parsed.get_backend_name() != "sqlite":
        raise ConfigurationError(
            f"The memory cannot use '{parsed.get_backend_name()}': give an address such as sqlite:///path/to/file."
        )
    if not parsed.database or parsed.database == ":memory:" or parsed.query:
        raise ConfigurationError(f"{url!r} names no file: give an address such as sqlite:///path/to/file.")
    return Path(parsed.database).expanduser().absolute()


def make_engine(path: Path, busy_seconds: float) -> Engine:
    """An engine that keeps one connection open between transactions (it holds no lock then), and more for threads."""
    engine = create_engine(
        URL.create("sqlite", database=str(path)),
        poolclass=QueuePool,
        pool_size=1,
        max_overflow=15,
        connect_args={"timeout": busy_seconds, "check_same_thread": False},
    )

    @event.listens_for(engine, "connect")
    def configure(connection: Any, _record: Any) -> None:
        connection.isolation_level = None  # the "begin" below is the only one
        connection.execute("PRAGMA synchronous=FULL")

    @event.listens_for(engine, "begin")
    def begin(connection: Connection) -> None:
        writes = connection.get_execution_options().get(WRITES, False)
        # A transaction that reads first and writes later fails under contention; a writer says so at once.
        connection.exec_driver_sql("BEGIN IMMEDIATE" if writes else "BEGIN")

    return engine


def prepare(path: Path, busy_seconds: float) -> None:
    """Make sure that ``path`` holds the memory's tables, creating them once among all processes.

    Raises :class:`MemoryStoreError` for a file that is locked, corrupt, not writable, of a later schema, or the
    database of something else.
    """
    with explained(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        if _has_tables(path, busy_seconds):
            return
        with _creation_lock(path, busy_seconds):
            if not _has_tables(path, busy_seconds):
                _create(path, busy_seconds)


def _has_tables(path: Path, busy_seconds: float) -> bool:
    """Whether the memory is there and usable; False for a file that is absent or empty."""
    if not path.exists():
        return False
    if path.is_dir():
        raise MemoryStoreError(f"The memory {path} cannot be used: it is a folder. Give the path of a file.")
    # An administrator who takes all write bits away means it, for root as well.
    if not path.stat().st_mode & 0o222:
        raise MemoryStoreError(f"The memory {path} is read-only. Make it writable, or choose another file.")
    if path.stat().st_size == 0:
        return False
    # Looking must not change a file that is then refused, nor leave a write-ahead log beside it, as reading does
    # unless the file is said to be immutable. It is not if others have it open; they leave a log beside it, too.
    if not _in_use(path):
        try:
            _look(path, "immutable=1", busy_seconds)
        except (sqlite3.Error, MemoryStoreError):
            if not _in_use(path):
                raise
    return _look(path, "mode=ro", busy_seconds)


def _in_use(path: Path) -> bool:
    """Whether a log lies beside the file: somebody has it open, or crashed and left something to recover."""
    return any(path.with_name(path.name + suffix).exists() for suffix in ("-wal", "-shm", "-journal"))


def _look(path: Path, mode: str, busy_seconds: float) -> bool:
    """Whether the file holds the memory's tables, False for no tables at all; raises for a file to be refused."""
    address = f"file:{quote(str(path))}?{mode}"
    with closing(sqlite3.connect(address, uri=True, timeout=busy_seconds)) as connection:
        names = {row[0] for row in connection.execute("SELECT name FROM sqlite_master WHERE type = 'table'")}
        if not names:
            return False
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
    return True


def _create(path: Path, busy_seconds: float) -> None:
    with closing(sqlite3.connect(path, timeout=busy_seconds)) as connection:
        connection.execute("PRAGMA journal_mode=WAL")
    engine = make_engine(path, busy_seconds)
    try:
        with engine.execution_options(**{WRITES: True}).begin() as connection:
            tables.metadata.create_all(connection)
            connection.exec_driver_sql("INSERT INTO memory_meta VALUES ('schema', ?)", (str(SCHEMA_VERSION),))
    finally:
        engine.dispose()


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
                        f"The memory {path} is being created by another process."
                    ) from error
                time.sleep(0.01)
        yield  # closing the file lets go of the lock


@contextmanager
def explained(path: Path) -> Iterator[None]:
    """Turn what SQLite and the file system say into a :class:`MemoryStoreError` that names the file."""
    try:
        yield
    except (sqlite3.Error, SQLAlchemyError, OSError) as error:
        said = str(getattr(error, "orig", None) or error)
        hint = ""
        if "locked" in said or "busy" in said:
            hint = " Another process holds it: wait for it, or choose another file."
        elif "readonly" in said or isinstance(error, PermissionError) or "unable to open" in said:
            hint = " It, or its folder, is not writable: choose another file."
        elif "not a database" in said or "malformed" in said:
            hint = " It is corrupt and was left as it is: restore it from a copy, or choose another file."
        raise MemoryStoreError(f"The memory {path} cannot be used: {said}.{hint}") from error
