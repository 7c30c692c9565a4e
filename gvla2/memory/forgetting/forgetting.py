"""Forgetting for good: rows, vectors, links, episodes' text and events' payloads, and what others say of it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from gvla2.memory.forgetting.quotes import Gone
from gvla2.memory.forgetting.scrubbing import PENDING, ask_for_scrubbing
from gvla2.memory.records import COLUMNS, FORGOTTEN, Record, as_json, damage_of, dump, load_object
from gvla2.memory.storage.database import Connection, Row
from gvla2.memory.storage.events import Link
from gvla2.memory.storage.putting import replace_row

if TYPE_CHECKING:
    from gvla2.memory.storage.transaction import Transaction

_STATE, _VERSION, _PROVENANCE, _QUERY, _CONTENT = (
    COLUMNS.index(name) for name in ("state", "version", "provenance", "query", "content")
)
_ERASE = "UPDATE memory_event SET why = '', scores = '', change = '', salt = ? WHERE bank = ? AND record = ?"


def forget(transaction: Transaction, sql: Connection, id: str, why: str) -> bool:
    """Take a record out of all tables of a bank; False where there is none. See :meth:`Transaction.forget`."""
    bank = transaction.bank
    row = next(iter(transaction.view.rows(bank, ids=[id])), None)
    if row is None or row[_STATE] == FORGOTTEN:
        # Asked again after the files could not be cleaned: then they are now.
        transaction.to_scrub = transaction.to_scrub or bool(transaction.view.meta(PENDING))
        return False
    sources = transaction.episodes.behind(id, _listed(row[_PROVENANCE]))
    links = transaction.view.links(bank, id)
    transaction.gone.append(_gone(row, links, transaction.seq))
    transaction.touch(sorted({end for link in links for end in (link.source, link.target)} - {id}))
    sql.run("DELETE FROM memory_link WHERE bank = ? AND (source = ? OR target = ?)", (bank, id, id))
    sql.run("DELETE FROM memory_vector WHERE bank = ? AND id = ?", (bank, id))
    version = row[_VERSION] if type(row[_VERSION]) is int else 0
    tombstone = _tombstone(id, bank, transaction.now, version + 1, transaction.rev)
    replace_row(sql, tombstone)
    sql.run(_ERASE, (b"", bank, id))
    transaction.record_event("forget", id, why=why, change=dump(as_json(tombstone)))
    transaction.flush()
    transaction.written.discard(id)
    transaction.created.discard(id)
    for source in sources:
        _forget_episode(transaction, sql, source)
    ask_for_scrubbing(sql)
    transaction.forgotten.append(id)
    transaction.to_scrub = True
    return True


def _gone(row: Row, links: list[Link], seq: int) -> Gone:
    query, content = (str(row[place]) for place in (_QUERY, _CONTENT))
    return Gone(str(row[0]), query, content, tuple(links), None if damage_of(row) else Record(*row), seq)


def _forget_episode(transaction: Transaction, sql: Connection, source: str) -> None:
    """Its row, and what its events say; the events' headers name the source itself in older banks alone."""
    bank = transaction.bank
    names = transaction.episodes.names(source)
    transaction.episodes.drop(source)
    sql.run("DELETE FROM memory_episode WHERE bank = ? AND source = ?", (bank, source))
    for name in names:
        sql.run(_ERASE, (b"", bank, name))
        transaction.record_event("forget", name)
    transaction.flush()


def _listed(provenance: object) -> list[str]:
    """The episodes that a record says it comes from."""
    try:
        listed = load_object(provenance).get("sources", []) if isinstance(provenance, str) else []
        return [str(source) for source in listed]
    except (ValueError, TypeError):
        return []


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
