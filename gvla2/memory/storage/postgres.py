"""The memory in a PostgreSQL database that many machines share: the same tables, by psycopg."""

from __future__ import annotations

import os
import sqlite3
import zlib
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import closing, contextmanager
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sqlalchemy.dialects.postgresql.psycopg import PGDialect_psycopg

from gvla2.errors import ConfigurationError, MemoryStoreError, MissingDependencyError
from gvla2.memory.storage.addresses import server_address
from gvla2.memory.storage.database import SCHEMA_VERSION, Row, Uncleaned
from gvla2.memory.storage.sqlite_file import create_tables, delete_database, explained, refuse_to_replace

if TYPE_CHECKING:
    import psycopg

ROWS_AT_ONCE = 2000
_TABLES = (
    "memory",
    "memory_bank",
    "memory_episode",
    "memory_event",
    "memory_link",
    "memory_meta",
    "memory_vector",
)
_SPACE = 0x6776_6C61
"""First half of the advisory locks' keys, so that they are not taken for another program's."""


@lru_cache(maxsize=1024)
def _translated(sql: str) -> str:
    """SQL with psycopg's placeholders."""
    return sql.replace("%", "%%").replace("?", "%s")


class PostgresConnection:
    """A :class:`gvla2.memory.storage.database.Connection`."""

    def __init__(self, raw: psycopg.Connection[Row]) -> None:
        self.raw = raw

    def rows(self, sql: str, values: Sequence[Any] = ()) -> list[Row]:
        """All rows of a query."""
        return self.raw.execute(_translated(sql), values).fetchall()

    def row(self, sql: str, values: Sequence[Any] = ()) -> Row | None:
        """The first row of a query, None where there is none."""
        return self.raw.execute(_translated(sql), values).fetchone()

    def stream(self, sql: str, values: Sequence[Any] = ()) -> Iterator[Row]:
        """The rows of a query, a few at a time."""
        with self.raw.cursor("memory_stream") as cursor:
            cursor.itersize = ROWS_AT_ONCE
            cursor.execute(_translated(sql), values)
            yield from cursor

    def run(self, sql: str, values: Sequence[Any] = ()) -> int:
        """Run a statement; how many rows it touched."""
        return self.raw.execute(_translated(sql), values).rowcount

    def run_many(self, sql: str, values: Iterable[Sequence[Any]]) -> None:
        """Run a statement once for each row of values."""
        with self.raw.cursor() as cursor:
            cursor.executemany(_translated(sql), values)


class PostgresDatabase:
    """A :class:`gvla2.memory.storage.database.Database` at ``postgresql://user@host/name``.

    Idle connections are kept; each thread works on one of its own, and a forked process on new ones. Waits for
    other writers, and for the server, at most ``busy_seconds`` at a time. Needs the extra ``postgres``.
    """

    def __init__(self, url: str, busy_seconds: float, create: bool = True) -> None:
        try:
            import psycopg
        except ImportError as error:
            raise MissingDependencyError(
                "psycopg", "A memory in PostgreSQL", 'pip install "gvla2[postgres]"'
            ) from error
        self._psycopg = psycopg
        self._url = server_address(url)
        self._busy_seconds = busy_seconds
        self._name = self._redacted()
        self._idle: list[PostgresConnection] = []
        self._inherited: list[PostgresConnection] = []
        self._pid = os.getpid()
        self._closed = False
        try:
            self._prepare(create)
        except BaseException:
            self.close()
            raise

    @property
    def name(self) -> str:
        """The address without its password."""
        return self._name

    def _redacted(self) -> str:
        try:
            parts = self._psycopg.conninfo.conninfo_to_dict(self._url)
        except self._psycopg.Error as error:
            raise ConfigurationError(
                "Not a PostgreSQL address: give postgresql://user@host/database."
            ) from error
        for secret in ("password", "sslpassword"):
            parts.pop(secret, None)
        return f"postgresql({self._psycopg.conninfo.make_conninfo('', **parts)})"

    def _connect(self) -> PostgresConnection:
        wait = max(2, round(self._busy_seconds))
        raw = self._psycopg.connect(self._url, autocommit=True, connect_timeout=wait)
        # A lost server must not turn an acknowledged change into a lost one.
        raw.execute("SET synchronous_commit = on")
        raw.execute(f"SET lock_timeout = {max(1, int(self._busy_seconds * 1000))}")
        raw.execute("SET client_encoding = 'UTF8'")
        return PostgresConnection(raw)

    def _take(self) -> PostgresConnection:
        if self._closed:
            raise MemoryStoreError(f"The memory {self._name} was closed.")
        if self._pid != os.getpid():
            # After a fork, the parent's connections must be neither used nor closed here.
            self._inherited, self._idle, self._pid = self._idle, [], os.getpid()
        while self._idle:
            connection = self._idle.pop()
            if not connection.raw.closed:
                return connection
        return self._connect()

    def _give(self, connection: PostgresConnection) -> None:
        idle = self._psycopg.pq.TransactionStatus.IDLE
        if self._closed or connection.raw.closed or connection.raw.info.transaction_status != idle:
            connection.raw.close()
        else:
            self._idle.append(connection)

    @contextmanager
    def _connection(self) -> Iterator[PostgresConnection]:
        with self._explained():
            connection = self._take()
            try:
                yield connection
            finally:
                self._give(connection)

    @contextmanager
    def _transaction(self, begin: str, lock: int | None = None) -> Iterator[PostgresConnection]:
        with self._connection() as connection:
            connection.raw.execute(begin)
            try:
                if lock is not None:
                    connection.raw.execute("SELECT pg_advisory_xact_lock(%s, %s)", (_SPACE, lock))
                yield connection
                connection.raw.execute("COMMIT")
            except BaseException:
                if not connection.raw.closed:
                    connection.raw.execute("ROLLBACK")
                raise

    @contextmanager
    def reading(self) -> Iterator[PostgresConnection]:
        """A consistent view, held until the end of the block."""
        with self._transaction("BEGIN ISOLATION LEVEL REPEATABLE READ READ ONLY") as connection:
            yield connection

    @contextmanager
    def writing(self, bank: str) -> Iterator[PostgresConnection]:
        """A transaction that holds the bank's lock from its start; an exception undoes all of it."""
        # The lock goes to whoever allocates a rev: numbers then become visible in their order, which those of a
        # sequence do not, so that a reader that has seen a rev has seen all before it.
        lock = zlib.crc32(bank.encode()) - 2**31
        with self._transaction("BEGIN ISOLATION LEVEL READ COMMITTED", lock) as connection:
            yield connection

    def one(self, sql: str, values: Sequence[Any]) -> Row | None:
        """The first row of a query by itself, as cheaply as can be."""
        with self._connection() as connection:
            return connection.row(sql, values)

    def scrub(self) -> None:
        """Write the tables anew without what was deleted.

        What the server keeps of its own accord (write-ahead log until it is recycled, backups) is out of reach.
        """
        with self._connection() as connection:
            connection.raw.execute(f"VACUUM (FULL) {', '.join(_TABLES)}")
            connection.raw.execute("CHECKPOINT")

    def forget_in_copies(self, gone: Callable[[], Sequence[tuple[str, str]]]) -> list[Uncleaned]:
        """No migration leaves copies in a server."""
        return []

    def snapshot(self, path: Path) -> None:
        """Write the banks into a SQLite file beside ``path``, then put it in its place."""
        with explained(path):
            refuse_to_replace(path, self._busy_seconds)
            aside = path.with_name(f".{path.name}.{os.getpid()}.part")
            delete_database(aside)
            try:
                with (
                    closing(sqlite3.connect(aside, isolation_level=None)) as copy,
                    self.reading() as connection,
                ):
                    _copy(connection, copy)
                aside.replace(path)
            finally:
                delete_database(aside)

    def size(self) -> int:
        """Bytes of the tables and their indices."""
        query = "SELECT pg_total_relation_size(?::regclass)"
        with self._connection() as connection:
            sizes = [connection.row(query, (name,)) for name in _TABLES]
        return sum(int(size[0]) for size in sizes if size)

    def close(self) -> None:
        """Close idle connections; safe to call twice."""
        self._closed = True
        if self._pid == os.getpid():
            while self._idle:
                self._idle.pop().raw.close()

    def _prepare(self, create: bool) -> None:
        """Create the tables once among all processes; raises for tables of a later version or of something else."""
        with self._transaction("BEGIN", lock=0) as connection:
            found = connection.row("SELECT to_regclass('memory_meta'), to_regclass('memory')")
            if found == (None, None):
                if not create:
                    raise MemoryStoreError(f"There is no memory in {self._name} yet: it has no tables.")
                _create(connection)
                return
            if found is None or found[0] is None:
                raise MemoryStoreError(
                    f"The database {self._name} has a table 'memory' of something else: choose another one."
                )
            version = connection.row("SELECT value FROM memory_meta WHERE key = 'schema'")
        if version is None or not str(version[0]).isdigit() or int(version[0]) < SCHEMA_VERSION:
            raise MemoryStoreError(f"The memory {self._name} is damaged: its schema is not stated.")
        if int(version[0]) > SCHEMA_VERSION:
            raise MemoryStoreError(
                f"The memory {self._name} has schema {version[0]}, this gvla2 knows up to {SCHEMA_VERSION}: update "
                "gvla2, or choose another database."
            )

    @contextmanager
    def _explained(self) -> Iterator[None]:
        try:
            yield
        except (self._psycopg.Error, OSError, UnicodeError) as error:
            said = " ".join(str(error).split())
            hint = ""
            if isinstance(error, self._psycopg.errors.LockNotAvailable):
                hint = " Another process holds the lock: wait for it."
            elif isinstance(error, self._psycopg.OperationalError):
                hint = " Is the server running, and does it take this user?"
            raise MemoryStoreError(f"The memory {self._name} cannot be used: {said}.{hint}") from error


def _create(connection: PostgresConnection) -> None:
    from gvla2.memory.storage.tables import (
        create_statements,  # SQLModel is slow to import: only who creates pays
    )

    for statement in create_statements(PGDialect_psycopg()):  # type: ignore[no-untyped-call]
        connection.raw.execute(statement)
    connection.run("INSERT INTO memory_meta VALUES ('schema', ?)", (str(SCHEMA_VERSION),))


def _copy(connection: PostgresConnection, copy: sqlite3.Connection) -> None:
    from gvla2.memory.storage.tables import table_columns

    copy.execute("PRAGMA journal_mode=WAL")
    copy.execute("BEGIN")
    create_tables(copy)
    copy.execute("DELETE FROM memory_meta")
    for table, columns in table_columns().items():
        names, marks = ", ".join(columns), ", ".join("?" * len(columns))
        copy.executemany(
            f"INSERT INTO {table} ({names}) VALUES ({marks})",
            connection.stream(f"SELECT {names} FROM {table}"),
        )
    copy.execute("COMMIT")
