"""A summary without a record that was forgotten: built anew from the members that are left, or taken back."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from gvla2.memory.curation.consolidation import support
from gvla2.memory.curation.governance import summary_of, tasks_of
from gvla2.memory.curation.growth import SUMMED_UP
from gvla2.memory.forgetting.quotes import Gone
from gvla2.memory.records import Record
from gvla2.memory.storage.database import Connection
from gvla2.memory.storage.view import vector_of

if TYPE_CHECKING:
    from gvla2.memory.storage.transaction import Transaction

_LEAST = 2
"""Members, and tasks that they come from, of which a summary can be made."""


def resummarise(transaction: Transaction, sql: Connection, id: str, gone: Sequence[Gone]) -> None:
    """Forget a summary that holds words of ``gone``; a new one stands for the members left, or they are active again.

    What had merged with the summary itself goes over to the new one, as does the use it was credited with.
    """
    old = transaction.get(id)
    if old is None:
        return
    links = [link for link in transaction.view.links(transaction.bank, id) if link.source == id]
    ids = {kind: [link.target for link in links if link.kind == kind] for kind in ("summary_of", "merged")}
    members = [r for r in transaction.records(["archive"], ids["summary_of"]) if r.note == f"{SUMMED_UP}{id}"]
    vectors = _vectors(sql, transaction.bank, [member.id for member in members])
    transaction.forget(id, why="it held what was forgotten")
    if old.state != "summary":
        transaction.also.append(f"The archived summary {id} held it and was forgotten.")
        return
    members.sort(key=lambda record: (-support(record), -record.count, record.id))
    held: list[Record] = []
    if len(members) >= _LEAST and len(tasks_of(members)) >= _LEAST:
        made, held = summary_of(members, transaction.now)
    if len(held) < _LEAST:
        for member in members:
            transaction.put(
                replace(member, state="active", note=""), action="RESTORE", why="no summary tells it"
            )
        back = f"; active again: {', '.join(member.id for member in members)}" if members else ""
        transaction.also.append(f"The summary {id} held it and was forgotten{back}.")
        return
    new = _written(
        transaction, made, held, vectors, old.usage - sum(one.record.usage for one in gone if one.record)
    )
    for member in members:
        if member in held:
            note = f"{SUMMED_UP}{new.id}"
            transaction.put(replace(member, note=note), action="SUMMED_UP", why="the summary was built anew")
            transaction.link(new.id, "summary_of", member.id)
    for record in transaction.records(ids=ids["merged"]):
        transaction.link(new.id, "merged", record.id)
    transaction.also.append(f"The summary {id} held it: {new.id}, without it, took its place.")


def _written(
    transaction: Transaction,
    made: Record,
    held: Sequence[Record],
    vectors: dict[str, tuple[str, NDArray[np.float32]]],
    usage: int,
) -> Record:
    known = transaction.get(made.id)
    record = replace(made, usage=max(made.usage, usage), version=known.version if known else 0)
    found = [vectors[member.id] for member in held if member.id in vectors]
    vector, model = None, ""
    if len(found) == len(held) and len({name for name, _ in found}) == 1:
        total = np.sum(np.stack([one for _, one in found]).astype(np.float64), axis=0)
        length = float(np.linalg.norm(total))
        if length > 0:
            vector, model = (total / length).astype(np.float32), found[0][0]
    why = f"built anew from {len(held)} records after one was forgotten"
    return transaction.put(record, vector, model=model, action="SUMMARY", why=why)


def _vectors(sql: Connection, bank: str, ids: Sequence[str]) -> dict[str, tuple[str, NDArray[np.float32]]]:
    """(model, (D,) vector) of records that have one."""
    found = {}
    for id in ids:
        row = sql.row(
            "SELECT model, dimension, vector FROM memory_vector WHERE bank = ? AND id = ?", (bank, id)
        )
        vector = vector_of(row[1], row[2]) if row else None
        if row and vector is not None:
            found[id] = (str(row[0]), vector)
    return found
