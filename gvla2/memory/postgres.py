"""The memory in a PostgreSQL database that many machines share."""

from __future__ import annotations

import zlib

from sqlalchemy import URL, Connection, event, select, text

from gvla2.errors import ConfigurationError, MemoryStoreError, MissingDependencyError
from gvla2.memory.database import Database, create_tables, engine_of, refuse_version
from gvla2.memory.events import META, TABLES

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

    def size(self) -> int:
        """Bytes of the tables and their indices."""
        query = text("SELECT pg_total_relation_size(CAST(:name AS regclass))")
        with self.connection() as connection:
            return sum(int(connection.execute(query, {"name": table.name}).scalar_one()) for table in TABLES)

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
