"""From the tables of schema 1 to those of today: in one transaction, with a copy of the file made first.

Schema 1 had the one table ``memory``, with the embedding and the links (JSON) in each row, and no events.
"""

from __future__ import annotations

import os
import re
import sqlite3
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gvla2.errors import MemoryStoreError
from gvla2.memory.records import COLUMNS, Record, load
from gvla2.memory.storage.database import SCHEMA_VERSION, Uncleaned
from gvla2.memory.storage.putting import Put
from gvla2.memory.storage.sqlite import SqliteConnection
from gvla2.memory.storage.sqlite_file import create_tables, delete_database
from gvla2.memory.storage.transaction import Transaction

COPY = ".before-schema-"
"""What the name of a copy adds to the file's own, before the new schema's number."""

_NAMED = re.compile(rf"{re.escape(COPY)}[0-9]+(?:\.(?:[0-9]+|part))?")
"""What :func:`copy_beside` adds to a file's name; whatever else is called much like it is somebody's own."""

_KEPT = tuple(name for name in COLUMNS if name not in ("used", "version", "rev"))


def migrate(path: Path, version: int, busy_seconds: float) -> Path:
    """Bring the file from ``version`` to today's tables; returns the copy of it made before.

    Rows that are damaged are taken over as they are, for ``verify`` to name. To be called under the file's lock.
    """
    copy = copy_beside(path, busy_seconds)
    with closing(
        sqlite3.connect(path, timeout=busy_seconds, isolation_level=None, check_same_thread=False)
    ) as connection:
        connection.execute("PRAGMA synchronous=FULL")
        connection.execute("BEGIN IMMEDIATE")
        try:
            found = connection.execute("SELECT value FROM memory_meta WHERE key = 'schema'").fetchone()
            if found != (str(version),):
                raise MemoryStoreError(
                    f"The memory {path} changed while it was being migrated: open it again."
                )
            _from_1(connection)
            connection.execute("COMMIT")
        except BaseException:
            if connection.in_transaction:
                connection.execute("ROLLBACK")
            raise
    return copy


def copy_beside(path: Path, busy_seconds: float) -> Path:
    """A consistent copy of the file in its folder, under a name that no other file has."""
    name, number = f"{path.name}{COPY}{SCHEMA_VERSION}", 0
    copy = path.with_name(name)
    while copy.exists():
        number += 1
        copy = path.with_name(f"{name}.{number}")
    # Whoever is killed meanwhile leaves no half copy under that name. Nobody else is here: the file's lock is held.
    aside = path.with_name(f"{name}.part")
    delete_database(aside)
    try:
        with closing(sqlite3.connect(path, timeout=busy_seconds, isolation_level=None)) as connection:
            connection.execute("VACUUM INTO ?", (str(aside),))
        with aside.open("rb+") as handle:
            os.fsync(handle.fileno())
        aside.replace(copy)
    finally:
        delete_database(aside)
    return copy


def _from_1(connection: sqlite3.Connection) -> None:
    connection.execute("ALTER TABLE memory RENAME TO memory_1")
    connection.execute("ALTER TABLE memory_meta RENAME TO memory_meta_1")
    create_tables(connection)
    sql = SqliteConnection(connection)
    banks = sql.rows("SELECT DISTINCT bank FROM memory_1 ORDER BY bank")
    for (bank,) in banks:
        if isinstance(bank, str):
            _import_bank(sql, bank)
    connection.execute("DROP TABLE memory_1")
    connection.execute("DROP TABLE memory_meta_1")


def _import_bank(sql: SqliteConnection, bank: str) -> None:
    names = ", ".join(_KEPT)
    query = f"SELECT links, embedding, embedding_model, {names} FROM memory_1 WHERE bank = ? ORDER BY rev, id"
    rows = sql.rows(query, (bank,))
    times = [row[3 + _KEPT.index("updated")] for row in rows]
    now = max((at for at in times if isinstance(at, float) and np.isfinite(at)), default=0.0)
    transaction = Transaction(sql, bank, "migration", now)
    linked = []
    for links, embedding, model, *values in rows:
        stored = dict(zip(_KEPT, values, strict=True))
        vector = _vector(embedding, transaction.models.get(str(model), 0))
        try:
            record = Record(**stored)
            put = Put(record, "imported", vector if model else None, str(model), why="from schema 1")
            transaction.put_many([put])
            linked.append((record.id, links))
        except (MemoryStoreError, TypeError):
            damaged = {**stored, "used": 0.0, "version": 1, "rev": transaction.rev}
            marks = ", ".join("?" * len(COLUMNS))
            sql.run(f"INSERT INTO memory VALUES ({marks})", [damaged[name] for name in COLUMNS])
    for source, links in linked:
        for kind, target in _links(links):
            if transaction.get(source) and transaction.get(target):
                transaction.link(source, kind, target, why="from schema 1")
    transaction.finish()


def _vector(stored: object, dimension: int) -> NDArray[np.float32] | None:
    """The embedding, None where it is absent or damaged: it is derived data and will be made anew."""
    if not isinstance(stored, bytes) or not stored or len(stored) % 4:
        return None
    vector = np.frombuffer(stored, dtype="<f4")
    return vector if np.isfinite(vector).all() and dimension in (0, len(vector)) else None


def _links(text: object) -> Iterator[tuple[str, str]]:
    """(kind, target) of the links of a row; damaged ones are left out."""
    try:
        listed: Any = load(text) if isinstance(text, str) else []
    except (ValueError, RecursionError):
        return
    for link in listed if isinstance(listed, list) else []:
        if isinstance(link, dict):
            kind, target = link.get("kind"), link.get("target", link.get("id"))
            if isinstance(kind, str) and kind and isinstance(target, str):
                yield kind, target


def forget_in_copies(
    path: Path, gone: Callable[[], Sequence[tuple[str, str]]], busy_seconds: float
) -> list[Uncleaned]:
    """Take records, (bank, id), out of the copies that :func:`migrate` left beside ``path``, to the last byte.

    A copy that is no database of schema 1, as a process that was killed leaves it, is of no use and deleted; no other
    file is touched. Those that could not be cleaned are returned, with the reason.
    """
    left: list[Uncleaned] = []
    try:
        copies = sorted(file for file in path.parent.iterdir() if _is_copy(file.name, path.name))
    except OSError as error:
        return [Uncleaned(str(path.parent), f"{path.parent} ({error.strerror or error})")]
    ids = gone() if copies else []
    for copy in copies:
        try:
            if copy.exists() and not _clean(copy, ids, busy_seconds):
                delete_database(copy)
        except (sqlite3.Error, OSError) as error:
            left.append(Uncleaned(str(copy), f"{copy} ({error})"))
    return left


def _is_copy(name: str, own: str) -> bool:
    return name.startswith(own) and _NAMED.fullmatch(name, len(own)) is not None


def _clean(copy: Path, gone: Sequence[tuple[str, str]], busy_seconds: float) -> bool:
    """Whether the copy is one, and free of these records now."""
    with closing(sqlite3.connect(copy, timeout=busy_seconds, isolation_level=None)) as connection:
        try:
            connection.execute("PRAGMA secure_delete=ON")
            tables = connection.execute("SELECT name FROM sqlite_master WHERE name = 'memory'").fetchall()
            if tables:
                connection.executemany("DELETE FROM memory WHERE bank = ? AND id = ?", gone)
                connection.execute("VACUUM")
            return bool(tables)
        except sqlite3.DatabaseError as error:
            if error.sqlite_errorcode & 0xFF in (sqlite3.SQLITE_NOTADB, sqlite3.SQLITE_CORRUPT):
                return False
            raise
