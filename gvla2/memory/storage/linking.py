"""How records come to refer to one another: many links at once, each checked, each an event."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from gvla2.errors import MemoryStoreError
from gvla2.memory.records import clean
from gvla2.memory.storage.database import Connection
from gvla2.memory.storage.events import Link

if TYPE_CHECKING:
    from gvla2.memory.storage.transaction import Transaction

_KNOWN = "SELECT 1 FROM memory_link WHERE bank = ? AND source = ? AND kind = ? AND target = ?"
_INSERT = "INSERT INTO memory_link (bank, source, kind, target, at) VALUES (?, ?, ?, ?, ?)"


@dataclass(frozen=True, slots=True)
class Tie:
    """One link to be made and the decision behind it, see :meth:`Transaction.link`."""

    source: str
    kind: str
    target: str
    why: str = ""
    scores: Mapping[str, float] = field(default_factory=dict)


def link_many(transaction: Transaction, sql: Connection, ties: Sequence[Tie]) -> list[Link]:
    """Make the links that are not there yet, and write their events; all of it is checked before."""
    bank, written = transaction.bank, transaction.written
    ends = {end for tie in ties for end in (tie.source, tie.target)}
    others = sorted(ends - written)
    sound = written | {record.id for record in transaction.records(ids=others)} if others else written
    made: dict[tuple[str, str, str], Tie] = {}
    for tie in ties:
        if tie.source == tie.target or not tie.kind or tie.source not in sound or tie.target not in sound:
            raise MemoryStoreError(
                f"Cannot link '{tie.source}' to '{tie.target}' as '{tie.kind}': two different records of bank "
                f"'{bank}' and a kind are needed."
            )
        key = (tie.source, clean(tie.kind, 64), tie.target)
        new = (
            tie.source in transaction.created and tie.source not in transaction.linked
        )  # and so has no links
        if key in made or (not new and sql.row(_KNOWN, (bank, *key))):
            continue
        made[key] = tie
    if not made:
        return []
    sql.run_many(_INSERT, [(bank, *key, transaction.now) for key in made])
    transaction.linked.update(source for source, _, _ in made)
    touched = {end for source, _, target in made for end in (source, target)} - written
    if touched:
        transaction.touch(sorted(touched))
    transaction.record_events(
        [
            transaction.next_event(f"link:{kind}", source, target, why=tie.why, scores=tie.scores)
            for (source, kind, target), tie in made.items()
        ]
    )
    return [Link(*key, transaction.now) for key in made]
