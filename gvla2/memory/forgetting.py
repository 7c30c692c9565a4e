"""Forgetting for good: rows, vectors, links, episodes' text and events' payloads, then the file's bytes."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from gvla2.errors import MemoryStoreError
from gvla2.memory.database import Connection, Database
from gvla2.memory.location import snapshot_path
from gvla2.memory.putting import replace_row
from gvla2.memory.records import COLUMNS, FORGOTTEN, Record, as_json, dump, load_object

if TYPE_CHECKING:
    from gvla2.memory.transaction import Transaction

_STATE, _VERSION, _PROVENANCE = (COLUMNS.index(name) for name in ("state", "version", "provenance"))
_ERASE = "UPDATE memory_event SET why = '', scores = '', change = '', salt = ? WHERE bank = ? AND (record = ?"
PENDING = "scrub"
"""Key of ``memory_meta`` while bytes of something forgotten may be left in the database's files."""


def forget(transaction: Transaction, sql: Connection, id: str, why: str) -> bool:
    """Take a record out of all tables of a bank; False where there is none. See :meth:`Transaction.forget`."""
    bank = transaction.bank
    row = next(iter(transaction.view.rows(bank, ids=[id])), None)
    if row is None or row[_STATE] == FORGOTTEN:
        return False
    sources = _episodes_of(transaction, sql, id, row[_PROVENANCE])
    ends = {end for link in transaction.view.links(bank, id) for end in (link.source, link.target)} - {id}
    transaction.touch(sorted(ends))
    sql.run("DELETE FROM memory_link WHERE bank = ? AND (source = ? OR target = ?)", (bank, id, id))
    sql.run("DELETE FROM memory_vector WHERE bank = ? AND id = ?", (bank, id))
    version = row[_VERSION] if type(row[_VERSION]) is int else 0
    tombstone = _tombstone(id, bank, transaction.now, version + 1, transaction.rev)
    replace_row(sql, tombstone)
    sql.run(f"{_ERASE} OR target = ?)", (b"", bank, id, id))
    transaction.record_event("forget", id, why=why, change=dump(as_json(tombstone)))
    transaction.flush()
    transaction.written.discard(id)
    transaction.created.discard(id)
    for source in sources:
        sql.run("DELETE FROM memory_episode WHERE bank = ? AND source = ?", (bank, source))
        sql.run(f"{_ERASE})", (b"", bank, source))
        transaction.record_event("forget", source)
    sql.run(
        "INSERT INTO memory_meta (key, value) VALUES (?, ?) ON CONFLICT (key) DO UPDATE SET value = excluded.value",
        (PENDING, "1"),
    )
    transaction.forgotten.append(id)
    return True


def _episodes_of(transaction: Transaction, sql: Connection, id: str, provenance: object) -> list[str]:
    """Sources of the stored episodes that taught the record, by its provenance or by their own account."""
    try:
        listed = load_object(provenance).get("sources", []) if isinstance(provenance, str) else []
        sources = {str(source) for source in listed}
    except (ValueError, TypeError):
        sources = set()
    said = f"%{dump(id)}%".replace("_", "\\_")
    query = "SELECT source FROM memory_episode WHERE bank = ? AND data LIKE ? ESCAPE '\\'"
    named = {row[0] for row in sql.rows(query, (transaction.bank, said))}
    stored = {row[0] for row in transaction.view.episode_rows(transaction.bank, sorted(sources))}
    return sorted(named | stored)


def _tombstone(id: str, bank: str, now: float, version: int, rev: int) -> Record:
    """What is left of a forgotten record: that it was."""
    return Record(
        id=id,
        bank=bank,
        query="",
        content="",
        type="",
        state=FORGOTTEN,
        outcome="",
        confidence=0.0,
        quality=0.0,
        dedup_key=f"{FORGOTTEN}:{id}",
        created=now,
        updated=now,
        count=0,
        version=version,
        rev=rev,
    )


def finish_forgetting(database: Database, bank: str, ids: Sequence[str]) -> None:
    """After the commit: see to it that no byte is left in the database's files, nor in copies beside it.

    Raises :class:`~gvla2.errors.MemoryStoreError` where another process is in the way; what was forgotten stays
    so, and ``Store.compact`` does the rest later.
    """
    discard_snapshot(snapshot_path(database.name, bank))
    database.forget_in_copies(bank, ids)
    finish_scrubbing(database)


def discard_snapshot(path: Path) -> None:
    """Delete the snapshot of an index: it may hold the text of a record that is to be forgotten."""
    try:
        path.unlink(missing_ok=True)
    except OSError as error:
        raise MemoryStoreError(
            f"A record was forgotten, but the snapshot '{path}', which may hold its text, cannot be deleted "
            f"({error.strerror or error}): delete it."
        ) from error


def finish_scrubbing(database: Database) -> None:
    """Scrub, and note that nothing is pending any more."""
    database.scrub()
    with database.writing("") as sql:
        sql.run("DELETE FROM memory_meta WHERE key = ?", (PENDING,))
