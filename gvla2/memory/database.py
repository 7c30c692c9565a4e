"""A database with the memory's tables: connections and atomic transactions.

What is specific to SQLite and PostgreSQL is in :mod:`gvla2.memory.sqlite` and :mod:`gvla2.memory.postgres`; all queries
are SQLAlchemy's, and the same for both.
"""

from __future__ import annotations

import os
from abc import ABC, abstractmethod
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any

from sqlalchemy import URL, Connection, Engine, create_engine, insert
from sqlalchemy.exc import SQLAlchemyError
from sqlalchemy.pool import QueuePool

from gvla2.errors import MemoryStoreError
from gvla2.memory.events import META, METADATA, SCHEMA_VERSION


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
    def size(self) -> int:
        """Bytes on disk."""

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
