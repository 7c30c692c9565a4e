"""Rows that were changed behind the bank's back, made again from the events, which say what they were."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

from sqlalchemy import and_, delete, insert

from gvla2.errors import MemoryStoreError
from gvla2.memory.records import FORGOTTEN, Record, damage_of, dump, numbered
from gvla2.memory.storage.audit import audit
from gvla2.memory.storage.chain import Chain
from gvla2.memory.storage.events import Link
from gvla2.memory.storage.forgetting import Forgotten, forget_many
from gvla2.memory.storage.putting import Put, put_many, replace_rows, set_keys_aside
from gvla2.memory.storage.rebuilding import rebuild
from gvla2.memory.storage.tables import LINK, VECTOR

ACTION = "repair"
_WHY = "the rows were not what the events say"


@dataclass(frozen=True)
class Repaired:
    """Ids of the ``records`` whose row, vector or links were made again, and of those that nothing had created and
    that were ``forgotten``.
    """

    records: tuple[str, ...]
    forgotten: tuple[str, ...]


def repair(chain: Chain, vectors: Collection[str], done: Forgotten) -> Repaired:
    """Make a bank's rows and links what its events say; see :meth:`Transaction.repair`."""
    problems = audit(chain.view, chain.bank)
    if changed := [problem for problem in problems if problem.where in ("chain", "event")]:
        raise MemoryStoreError(
            f"The bank '{chain.bank}' cannot be repaired: its events were changed, too ({changed[0]}). Restore the "
            "database from a copy."
        )
    rebuilt = rebuild(chain.view.stream_events(chain.bank))
    due = {record.id: record for record in (*rebuilt.records, *rebuilt.tombstones)}
    wrong = {problem.id for problem in problems if problem.where in ("record", "vector")} | set(vectors)
    # First, as any of these rows may hold the dedup key of another, or of one that is missing.
    set_keys_aside(chain, sorted(wrong))
    forgotten = forget_many(chain, sorted(wrong - due.keys()), _WHY, done)
    chain.delete(VECTOR, "id", wrong)
    wrong |= _links(chain, rebuilt.links)
    for id in sorted(wrong & due.keys()):
        _record(chain, due[id])
    return Repaired(tuple(sorted(wrong & due.keys())), tuple(sorted(forgotten)))


def _links(chain: Chain, due: Sequence[Link]) -> set[str]:
    """Make the links what they should be; the ids on both ends of those that were not."""
    stored = set(chain.view.links(chain.bank))
    surplus, missing = stored - set(due), set(due) - stored
    for link in surplus:
        named = and_(LINK.c.source == link.source, LINK.c.kind == link.kind, LINK.c.target == link.target)
        chain.sql.execute(delete(LINK).where(LINK.c.bank == chain.bank, named))
    if missing:
        names = ("source", "kind", "target", "at")
        rows = [{"bank": chain.bank, **{name: getattr(link, name) for name in names}} for link in missing]
        chain.sql.execute(insert(LINK), rows)
    return {end for link in surplus | missing for end in (link.source, link.target)}


def _record(chain: Chain, due: Record) -> None:
    """Write one record as it should be, with an event that changes nothing, so that every index reads it anew."""
    row = next(iter(chain.view.rows(chain.bank, ids=[due.id])), None)
    if row is None and due.state == FORGOTTEN:
        return  # nothing is left of it, which is what was wanted
    if row is None or (damage_of(tuple(row)) and due.state != FORGOTTEN):
        put_many(chain, [Put(replace(due, version=0), ACTION, why=_WHY)])
        return
    replace_rows(chain, [numbered(due, due.version + 1, chain.rev)])
    chain.event(ACTION, due.id, why=_WHY, change=dump({}))
