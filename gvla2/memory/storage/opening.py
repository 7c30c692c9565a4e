"""From an address to a database."""

from __future__ import annotations

from gvla2.memory.storage.addresses import database_path, scheme_of
from gvla2.memory.storage.database import Database


def open_database(url: str, busy_seconds: float, create: bool = True) -> Database:
    """The database at ``sqlite:///path`` or ``postgresql://...``, migrated where needed, and created if ``create``."""
    if scheme_of(url) == "postgresql":
        from gvla2.memory.storage.postgres import PostgresDatabase

        return PostgresDatabase(url, busy_seconds, create)
    from gvla2.memory.storage.sqlite import SqliteDatabase

    return SqliteDatabase(database_path(url), busy_seconds, create)
