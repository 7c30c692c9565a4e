"""Rows that were changed behind the bank's back, made again from the events, which say what they were."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from gvla2.errors import MemoryStoreError
from gvla2.memory.records import FORGOTTEN, Record, damage_of, dump, numbered
from gvla2.memory.storage.database import Connection
from gvla2.memory.storage.events import Link
from gvla2.memory.storage.putting import replace_row, set_keys_aside
from gvla2.memory.storage.rebuilding import rebuild

if TYPE_CHECKING:
    from gvla2.memory.storage.transaction import Transaction

ACTION = "repair"
_WHY = "the rows were not what the events say"


@dataclass(frozen=True)
class Repaired:
    """Ids of the ``records`` whose row, vector or links were made again, and of those that nothing had created and
    that were ``forgotten``.
    """

    records: tuple[str, ...]
    forgotten: tuple[str, ...]


def repair(transaction: Transaction, sql: Connection, vectors: Collection[str]) -> Repaired:
    """Make a bank's rows and links what its events say; see :meth:`Transaction.repair`."""
    from gvla2.memory.storage.audit import audit  # it looks into transactions itself

    view, bank = transaction.view, transaction.bank
    problems = audit(view, bank)
    if changed := [problem for problem in problems if problem.where in ("chain", "event")]:
        raise MemoryStoreError(
            f"The bank '{bank}' cannot be repaired: its events were changed, too ({changed[0]}). Restore the database "
            "from a copy."
        )
    rebuilt = rebuild(view.stream_events(bank))
    due = {record.id: record for record in (*rebuilt.records, *rebuilt.tombstones)}
    wrong = {problem.id for problem in problems if problem.where in ("record", "vector")} | set(vectors)
    foreign = sorted(wrong - due.keys())
    # First, as any of these rows may hold the dedup key of another, or of one that is missing.
    set_keys_aside(sql, bank, sorted(wrong))
    forgotten = [id for id in foreign if transaction.forget(id, why=_WHY)]
    sql.run_many("DELETE FROM memory_vector WHERE bank = ? AND id = ?", [(bank, id) for id in sorted(wrong)])
    wrong |= _links(transaction, sql, rebuilt.links)
    for id in sorted(wrong & due.keys()):
        _record(transaction, sql, due[id])
    return Repaired(tuple(sorted(wrong & due.keys())), tuple(forgotten))


def _links(transaction: Transaction, sql: Connection, due: Sequence[Link]) -> set[str]:
    """Make the links what they should be; the ids on both ends of those that were not."""
    bank, stored = transaction.bank, set(transaction.view.links(transaction.bank))
    surplus, missing = stored - set(due), set(due) - stored
    sql.run_many(
        "DELETE FROM memory_link WHERE bank = ? AND source = ? AND kind = ? AND target = ?",
        [(bank, link.source, link.kind, link.target) for link in surplus],
    )
    sql.run_many(
        "INSERT INTO memory_link (bank, source, kind, target, at) VALUES (?, ?, ?, ?, ?)",
        [(bank, link.source, link.kind, link.target, link.at) for link in missing],
    )
    return {end for link in surplus | missing for end in (link.source, link.target)}


def _record(transaction: Transaction, sql: Connection, due: Record) -> None:
    """Write one record as it should be, with an event that changes nothing, so that every index reads it anew."""
    row = next(iter(transaction.view.rows(transaction.bank, ids=[due.id])), None)
    if row is None and due.state == FORGOTTEN:
        return  # nothing is left of it, which is what was wanted
    if row is None or (damage_of(row) and due.state != FORGOTTEN):
        transaction.put(replace(due, version=0), action=ACTION, why=_WHY)
        return
    replace_row(sql, numbered(due, due.version + 1, transaction.rev))
    transaction.record_event(ACTION, due.id, why=_WHY, change=dump({}))
