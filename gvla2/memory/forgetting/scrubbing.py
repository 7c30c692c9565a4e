"""After forgetting: no byte of what went is left in any file, and where one may be left, that is said and kept."""

from __future__ import annotations

import os
import time
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from gvla2.errors import MemoryStoreError
from gvla2.memory.records import dump, load
from gvla2.memory.storage.database import Connection, Database, Uncleaned
from gvla2.memory.storage.location import snapshot_path
from gvla2.memory.storage.view import View

PENDING = "scrub"
"""Key of ``memory_meta`` while bytes of something forgotten may be left: a random token, and the files' names."""
_SET = "INSERT INTO memory_meta (key, value) VALUES (?, ?) ON CONFLICT (key) DO UPDATE SET value = excluded.value"
_STRAY_SECONDS = 600.0
"""Nobody takes so long to write an index."""


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
    """Clean the database's files, the copies that a migration left beside it, and kept indices; to the last byte.

    ``forgotten`` are the records that were forgotten just now. Raises :class:`~gvla2.errors.MemoryStoreError` that
    names the files that could not be cleaned: that stays noted, and the next time tries again.
    """
    with database.reading() as sql:
        asked, banks = View(sql).meta(PENDING), View(sql).banks()
    left = _delete(kept_indices(database.name, banks) if asked else strays(database.name, banks))
    left += database.forget_in_copies(lambda: _forgotten(database))
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


def strays(name: str, banks: Sequence[str], now: float | None = None) -> list[Path]:
    """What processes left that were killed while they wrote an index, so long ago that none is still at it."""
    from gvla2.memory.indexing.snapshot import (
        strays_of,  # it compiles code on import, which few who open a store need
    )

    limit = (time.time() if now is None else now) - _STRAY_SECONDS
    found = []
    for bank in banks:
        for path in strays_of(snapshot_path(name, bank)):
            with suppress(OSError):
                found += [path] if path.stat().st_mtime < limit else []
    return found


def kept_indices(name: str, banks: Sequence[str]) -> list[Path]:
    """The snapshots of indices, and what killed processes left of some."""
    from gvla2.memory.indexing.snapshot import strays_of

    paths = [snapshot_path(name, bank) for bank in banks]
    return [file for path in paths for file in (path, *strays_of(path))]


def _delete(files: Sequence[Path]) -> list[Uncleaned]:
    left = []
    for file in files:
        try:
            file.unlink(missing_ok=True)
        except OSError as error:
            left.append(Uncleaned(str(file), f"{file} ({error.strerror or error})"))
    return left


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
