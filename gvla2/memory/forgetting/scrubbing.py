"""After forgetting: no byte of what went is left in any file, and where one may be left, that is said and kept."""

from __future__ import annotations

import os
from collections.abc import Sequence

from gvla2.errors import MemoryStoreError
from gvla2.memory.records import dump, load
from gvla2.memory.storage.database import Connection, Database, Uncleaned
from gvla2.memory.storage.view import View

PENDING = "scrub"
"""Key of ``memory_meta`` while bytes of something forgotten may be left: a random token, and the files' names."""
_SET = "INSERT INTO memory_meta (key, value) VALUES (?, ?) ON CONFLICT (key) DO UPDATE SET value = excluded.value"


def ask_for_scrubbing(sql: Connection) -> None:
    """Note, within the transaction that forgets, that the files still have to be cleaned."""
    sql.run(_SET, (PENDING, dump([os.urandom(8).hex(), ""])))


def pending(noted: str) -> list[str]:
    """The files that may hold bytes of what was forgotten, by what the database notes; "" is its own."""
    if not noted:
        return []
    try:
        found = load(noted)
    except ValueError:
        found = None
    return [str(name) for name in found[1:]] if isinstance(found, list) else [""]


def scrub(database: Database, forgotten: Sequence[str] = ()) -> None:
    """Clean the database's files, and the copies that a migration left beside it; to the last byte.

    ``forgotten`` are the records that were forgotten just now. Raises :class:`~gvla2.errors.MemoryStoreError` that
    names the files that could not be cleaned: that stays noted, and the next time tries again.
    """
    with database.reading() as sql:
        asked = View(sql).meta(PENDING)
    left = database.forget_in_copies(lambda: _forgotten(database))
    try:
        database.scrub()
    except MemoryStoreError as error:
        if not asked and not left:
            raise
        left.insert(0, Uncleaned("", f"{database.name} ({_reason(error, database.name)})"))
    noted = dump([os.urandom(8).hex(), *(file.path for file in left)]) if left else ""
    try:
        _note(database, asked, noted)
    except MemoryStoreError as error:
        if not left:  # it is clean, but will be taken for unclean: no harm, and worth saying
            left.append(Uncleaned("", f"{database.name} ({_reason(error, database.name)})"))
    if left:
        what = f"{', '.join(forgotten)}: forgotten, and no longer in the bank." if forgotten else ""
        raise MemoryStoreError(
            f"{what} Bytes of what was forgotten may be left in {'; '.join(file.said for file in left)}. When that "
            "is out of the way, run `gvla2 memory compact` (Store.compact), or forget something else.".strip()
        )


def _forgotten(database: Database) -> list[tuple[str, str]]:
    """(bank, id) of all records that were ever forgotten, or freed of what quoted one."""
    query = "SELECT DISTINCT bank, record FROM memory_event WHERE action IN ('forget', 'forget:part')"
    with database.reading() as sql:
        return [(row[0], row[1]) for row in sql.rows(query)]


def _note(database: Database, before: str, after: str) -> None:
    """Keep what is left to clean, unless somebody has forgotten something since: he will clean, too."""
    if before == after == "":
        return
    with database.writing("") as sql:
        if View(sql).meta(PENDING) != before:
            return
        sql.run("DELETE FROM memory_meta WHERE key = ?", (PENDING,))
        if after:
            sql.run(_SET, (PENDING, after))


def _reason(error: BaseException, name: str) -> str:
    return str(error.__cause__ or error).strip().removeprefix(f"The memory {name} ").rstrip(".")
