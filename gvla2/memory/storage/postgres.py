"""The memory in a PostgreSQL database that many machines share."""

from __future__ import annotations

import zlib
from pathlib import Path

from sqlalchemy import URL, Connection, Engine, event, text

from gvla2.errors import ConfigurationError, MemoryStoreError, MissingDependencyError
from gvla2.memory.storage.database import engine_of
from gvla2.memory.storage.tables import TABLES

_SPACE = 0x6776_6C61
"""First half of the advisory locks' keys, so that they are not taken for another program's."""


class PostgresDialect:
    """A :class:`gvla2.memory.storage.database.Dialect` by psycopg, which the extra ``postgres`` brings.

    Waits for other writers, and for the server, at most ``busy_seconds`` at a time.
    """

    reading = "BEGIN ISOLATION LEVEL REPEATABLE READ READ ONLY"

    def __init__(self, url: URL, busy_seconds: float) -> None:
        try:
            import psycopg
        except ImportError as error:
            raise MissingDependencyError(
                "psycopg", "A memory in PostgreSQL", 'pip install "gvla2[postgres]"'
            ) from error
        self._url, self._busy_seconds, self._psycopg = url, busy_seconds, psycopg
        plain = url.set(drivername="postgresql").render_as_string(hide_password=False)
        try:
            parts = psycopg.conninfo.conninfo_to_dict(plain)
        except psycopg.Error as error:
            raise ConfigurationError(
                "Not a PostgreSQL address: give postgresql://user@host/database."
            ) from error
        open_ones = {name: told for name, told in parts.items() if name not in ("password", "sslpassword")}
        self.name = f"postgresql({psycopg.conninfo.make_conninfo('', **open_ones)})"

    def engine(self) -> Engine:
        """Connections whose acknowledged changes outlive a lost server."""
        options = {"connect_timeout": max(2, round(self._busy_seconds))}
        engine = engine_of(self._url, connect_args=options)

        @event.listens_for(engine, "connect")
        def _connected(raw: object, _: object) -> None:
            for setting in (
                "synchronous_commit = on",
                f"lock_timeout = {max(1, int(self._busy_seconds * 1000))}",
                "client_encoding = 'UTF8'",
            ):
                raw.execute(f"SET {setting}")  # type: ignore[attr-defined]

        return engine

    def begin(self, connection: Connection, bank: str) -> None:
        """Take the bank's lock.

        It goes to whoever allocates a rev: numbers then become visible in their order, which those of a sequence do
        not, so that a reader that has seen a rev has seen all before it.
        """
        connection.exec_driver_sql("BEGIN ISOLATION LEVEL READ COMMITTED")
        lock = zlib.crc32(bank.encode()) - 2**31 if bank else 0
        try:
            connection.execute(text("SELECT pg_advisory_xact_lock(:a, :b)"), {"a": _SPACE, "b": lock})
        except BaseException:
            connection.exec_driver_sql("ROLLBACK")
            raise

    def check(self) -> None:
        """A server's database cannot be replaced while it is open."""

    def scrub(self, connection: Connection) -> None:
        """Write the tables anew without what was deleted.

        What the server keeps of its own accord (write-ahead log until it is recycled, backups) is out of reach.
        """
        connection.exec_driver_sql(f"VACUUM (FULL) {', '.join(table.name for table in TABLES)}")
        connection.exec_driver_sql("CHECKPOINT")

    def size(self, connection: Connection) -> int:
        """Bytes of the tables and their indices."""
        query = text("SELECT pg_total_relation_size(CAST(:name AS regclass))")
        return sum(int(connection.execute(query, {"name": table.name}).scalar_one()) for table in TABLES)

    def copy(self, connection: Connection, path: Path) -> None:
        """A server has a tool of its own for it."""
        raise MemoryStoreError(f"{self.name} is copied by pg_dump.")

    def explained(self, error: BaseException) -> MemoryStoreError:
        """What went wrong with the server."""
        cause = getattr(error, "orig", None) or error
        said = " ".join(str(cause).split())
        hint = ""
        if isinstance(cause, self._psycopg.errors.LockNotAvailable):
            hint = " Another process holds the lock: wait for it."
        elif isinstance(cause, self._psycopg.OperationalError):
            hint = " Is the server running, and does it take this user?"
        return MemoryStoreError(f"The memory {self.name} cannot be used: {said}.{hint}")
