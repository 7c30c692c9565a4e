"""Does a bank match its events? Finds and repairs damage and tampering."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Iterator
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sqlalchemy import delete, insert, select

from gvla2.errors import MemoryStoreError
from gvla2.memory.contracts import Embedder
from gvla2.memory.records import COLUMNS, FORGOTTEN, as_json, damage_of, dump, numbered
from gvla2.memory.storage.events import (
    GENESIS,
    Event,
    Folding,
    StoredEpisode,
    chain_hash,
    episode_digest,
    payload_digest,
)
from gvla2.memory.storage.forgetting import Transaction
from gvla2.memory.storage.tables import LINK, PENDING, RECORD, VECTOR
from gvla2.memory.storage.view import BankView, vector_of

_OWN = 0.99
"""Cosine above which a vector matches a text, despite rounding."""
_WHY = "the rows did not match the events"


@dataclass(frozen=True, slots=True)
class Problem:
    """A problem of a bank: ``where`` (chain, event, record, vector, link, episode, file), which ``id``."""

    where: str
    id: str
    what: str

    def __str__(self) -> str:
        return f"{self.where} {self.id}: {self.what}." if self.id else f"{self.where}: {self.what}."


def audit(view: BankView, head: str = "", embedder: Embedder | None = None) -> list[Problem]:
    """The problems of a bank: its chain, payloads, rows against events, vectors, episodes; [] if there are none.

    ``head`` is "SEQ:HASH" of an event from earlier statistics of the bank, kept elsewhere: with it, a truncated or
    rewritten chain is found as well. With an ``embedder``, vectors by its model that do not match their records, as
    after a swap, are reported too.
    """
    folding = Folding()
    problems = list(_chain(view, folding))
    problems += _kept_head(view, head) if head else ()
    problems += _records(view, folding)
    problems += _vectors(view, embedder, {problem.id for problem in problems if problem.where == "record"})
    stored, due = {(x.source, x.kind, x.target): x.at for x in view.links()}, folding.ties
    for key in sorted(key for key in {*stored, *due} if stored.get(key) != due.get(key)):
        kind = "it differs from" if key in stored and key in due else "it is not in both rows and"
        problems.append(Problem("link", " ".join(key), f"{kind} events"))
    problems += _episodes(view, folding)
    if view.meta(PENDING):
        problems.append(Problem("file", "", "bytes of forgotten records may be left in it: compact it"))
    return problems


def _chain(view: BankView, folding: Folding) -> Iterator[Problem]:
    """Walk the events: numbers, hashes, digests, times; fold them on the way."""
    prev, seq, rev, at = GENESIS, 0, 0, -math.inf
    erased: list[Event] = []
    forgotten: dict[str, int] = {}
    for event in view.events():
        where = str(event.seq)
        if event.damage:
            yield Problem("event", where, event.damage)
            prev, seq = event.hash, seq + 1
            continue
        if event.seq != seq + 1:
            yield Problem("chain", where, f"events {seq + 1} to {event.seq - 1} are missing")
        elif event.prev != prev:
            yield Problem("chain", where, "it does not follow the event before it")
        if chain_hash(event.prev, event.header, event.digest) != event.hash:
            yield Problem("event", where, "its header was changed: the hash differs")
        if event.erased:
            erased.append(event)
        elif payload_digest(event.salt, event.payload) != event.digest:
            yield Problem("event", where, "its content was changed: the digest differs")
        if event.at < at or event.rev < rev:
            yield Problem("event", where, "it is older than the event before it")
        if event.action.partition(":")[0] == "forget":
            forgotten[event.record] = event.seq
        if wrong := folding.apply(event):
            yield Problem("event", where, wrong)
        prev, seq, rev, at = event.hash, event.seq, event.rev, event.at
    for event in erased:
        if max(forgotten.get(event.record, 0), forgotten.get(event.target, 0)) <= event.seq:
            yield Problem("event", str(event.seq), "it was erased, and nothing was forgotten afterwards")
    head = view.head
    if head is not None and (head.rev, head.seq, head.hash) != (rev, seq, prev):
        told = f"event {head.seq}" if head.seq != seq else "a different hash or transaction number"
        yield Problem("chain", "", f"it ends with event {seq}, the bank's own row says {told}")
    if head is None and seq:
        yield Problem("chain", "", "the bank's own row is missing")


def _kept_head(view: BankView, head: str) -> Iterator[Problem]:
    """Whether the chain still has an event that was its last once."""
    place, _, hash_ = head.strip().partition(":")
    if not place.isdecimal() or not hash_:
        why = "is not the head of a chain: give SEQ:HASH from a bank's statistics"
        raise MemoryStoreError(f"{head!r} {why}.")
    event, told = next(view.events(int(place) - 1), None), ""
    if event is None or event.seq != int(place):
        told = "the head kept elsewhere is missing: the chain was truncated"
    elif event.hash != hash_:
        told = "it differs from the head kept elsewhere: the chain was rewritten"
    if told:
        yield Problem("chain", place, told)


def _records(view: BankView, folding: Folding) -> Iterator[Problem]:
    due = dict(folding.rows)
    for row in view.rows():
        id, said = str(row.id), due.pop(str(row.id), None)
        differing = [
            name for name, value in zip(COLUMNS, row, strict=True) if said and said.get(name) != value
        ]
        if damage := damage_of(tuple(row)):
            yield Problem("record", id, f"damaged: {damage}")
        elif said is None:
            yield Problem("record", id, "no event created it")
        elif differing:
            yield Problem("record", id, f"{', '.join(differing)} differ from the events")
    for id in sorted(due):
        yield Problem("record", id, "the events have it, the rows do not")


def _vectors(view: BankView, embedder: Embedder | None, named: Collection[str]) -> Iterator[Problem]:
    """Orphaned and damaged vectors; with the embedder also those by its model that do not match their records, unless
    already ``named``.
    """
    texts = {one.id: one.text for one in view.records() if one.id not in named} if embedder else {}
    held: list[tuple[str, NDArray[np.float32]]] = []
    for row in view.vector_rows():
        id, model, dimension, stored, state = tuple[Any, ...](row)
        vector = vector_of(dimension, stored)
        if state in (None, FORGOTTEN):
            yield Problem("vector", str(id), "it belongs to no record")
        elif vector is None:
            yield Problem("vector", id, "damaged: not finite, or of the wrong length")
        elif embedder and model == embedder.model and id in texts:
            held.append((id, vector))
    made = embedder.embed([texts[id] for id, _ in held]) if embedder and held else ()
    for (id, vector), own in zip(held, made, strict=True):
        vector = vector.astype(float)  # of damaged ones the square may not fit into 32 bits
        length = np.linalg.norm(vector) * np.linalg.norm(own)
        if own.any() and not (vector.shape == own.shape and float(vector @ own) >= _OWN * length > 0):
            yield Problem("vector", id, "it does not match the record's text")


def _episodes(view: BankView, folding: Folding) -> Iterable[Problem]:
    due = dict(folding.episodes)
    for row in view.episode_rows():
        digest = due.pop(row.source, None)
        try:
            StoredEpisode.from_json(row.source, row.at, row.data)
            if digest != episode_digest(row.at, row.data):
                yield Problem("episode", str(row.source), "it is not what was stored")
        except ValueError as error:
            yield Problem("episode", str(row.source), f"damaged: {error}")
    for source in sorted(due):
        yield Problem("episode", source, "the events have it, the rows do not")


# Mending ------------------------------------------------------------------------------------------------------------


def repair(t: Transaction, embedder: Embedder | None = None) -> tuple[list[str], list[str]]:
    """Restore from the events rows, vectors and links that were changed outside the bank.

    Returns the ids of the restored records, and of the rows that no event created: those are forgotten. Damaged
    vectors, or those foreign to the ``embedder``, are remade at the bank's next query. Stored episodes cannot be
    restored. Raises :class:`MemoryStoreError` if the events were changed too.
    """
    problems = audit(t, embedder=embedder)
    if changed := [problem for problem in problems if problem.where in ("chain", "event")]:
        raise MemoryStoreError(
            f"The bank '{t.bank}' cannot be repaired: its events were changed too ({changed[0]}). Restore the "
            "database from a copy."
        )
    folding = t.rebuilt()
    due = {record.id: record for record in folding.whole()}
    wrong = {problem.id for problem in problems if problem.where in ("record", "vector")}
    # All rows are deleted first, since any of them may hold the dedup key of another, or of a tombstone.
    if any(not row.id or type(row.id) is not str for row in t.rows()):  # no record can have such an id
        t.sql.execute(delete(RECORD).where(RECORD.c.bank == t.bank))
        wrong |= due.keys()
    t.delete(RECORD, "id", wrong & due.keys())
    t.delete(VECTOR, "id", wrong)
    forgotten = t.forget(*sorted(wrong - due.keys()), why=_WHY)
    stored = set(t.links())
    if odd := stored ^ set(folding.links):
        t.sql.execute(delete(LINK).where(LINK.c.bank == t.bank))
        if folding.links:
            t.sql.execute(insert(LINK), [{"bank": t.bank, **asdict(link)} for link in folding.links])
    wrong |= {end for link in odd for end in (link.source, link.target)}
    again = [numbered(due[id], due[id].version + 1, t.rev) for id in sorted(wrong & due.keys())]
    # An event without changes for each, so that every index reads the record again.
    t.delete(RECORD, "id", [one.id for one in again])
    if again:
        t.sql.execute(insert(RECORD), [as_json(one) for one in again])
    orphaned = VECTOR.c.id.notin_(select(RECORD.c.id).where(RECORD.c.bank == t.bank))
    t.sql.execute(delete(VECTOR).where(VECTOR.c.bank == t.bank, orphaned))
    t.tell(t.event("repair", one.id, "", _WHY, change=dump({})) for one in again)
    return [one.id for one in again], forgotten
