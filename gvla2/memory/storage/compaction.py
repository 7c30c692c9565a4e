"""Keeping a database small: archived records that time has passed by, and space that nothing uses."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

from gvla2.memory.forgetting.scrubbing import scrub
from gvla2.memory.storage.database import Database

if TYPE_CHECKING:
    from gvla2.memory.storage.store import Store


def compact(
    store: Store,
    database: Database,
    bank: str | None,
    archived_before: float | None,
    now: float | None,
    actor: str,
) -> int:
    """Forget old archived records of a bank, if asked to, and write the database's files anew."""
    gone = 0
    if bank is not None and archived_before is not None:
        old = [r.id for r in store.records(bank, ["archive"]) if r.updated < archived_before]
        if old:
            with store.writing(bank, actor=actor, now=time.time() if now is None else now) as transaction:
                for record in transaction.records(["archive"], old):
                    if record.updated < archived_before:
                        gone += transaction.forget(record.id, why="archived long ago")
    if not gone:  # else forgetting has scrubbed already
        scrub(database)
    return gone
