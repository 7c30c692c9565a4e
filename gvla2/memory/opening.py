"""From an address to a database."""

from __future__ import annotations

from gvla2.errors import ConfigurationError
from gvla2.memory.database import Database


def open_database(url: str, busy_seconds: float) -> Database:
    """The database at ``sqlite:///path`` or ``postgresql://...``, created or migrated where needed."""
    scheme = url.partition(":")[0].partition("+")[0]
    if scheme in ("postgresql", "postgres"):
        from gvla2.memory.postgres import PostgresDatabase

        return PostgresDatabase(url, busy_seconds)
    if scheme != "sqlite":
        raise ConfigurationError(
            f"The memory cannot use {url!r}: give sqlite:///path/to/file, or postgresql://user@host/database."
        )
    from gvla2.memory.sqlite import SqliteDatabase
    from gvla2.memory.sqlite_file import database_path

    return SqliteDatabase(database_path(url), busy_seconds)
