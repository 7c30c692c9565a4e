"""Is a bank what its events say? Every way in which it may have been damaged or tampered with, named."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from gvla2.errors import MemoryStoreError
from gvla2.memory.contracts import Embedder
from gvla2.memory.records import COLUMNS, FORGOTTEN, damage_of
from gvla2.memory.storage.episodes import StoredEpisode
from gvla2.memory.storage.events import GENESIS, Event, chain_hash, episode_digest, payload_digest
from gvla2.memory.storage.forgetting import PENDING
from gvla2.memory.storage.rebuilding import Folding
from gvla2.memory.storage.view import View, vector_of

_TOGETHER = 1024
_OWN = 0.99
"""Cosine from which a vector is that of a text, whatever the order of additions."""


@dataclass(frozen=True, slots=True)
class Problem:
    """What is wrong with a bank: ``where`` (chain, event, record, vector, link, episode, file), which ``id``."""

    where: str
    id: str
    what: str

    def __str__(self) -> str:
        return f"{self.where} {self.id}: {self.what}." if self.id else f"{self.where}: {self.what}."


def audit(view: View, bank: str, head: str = "") -> list[Problem]:
    """All problems of a bank; ``head`` is "SEQ:HASH" of an event that it must have."""
    folding = Folding()
    problems = list(_chain(view, bank, folding))
    problems += _kept_head(view, bank, head) if head else ()
    problems += _records(view, bank, folding)
    problems += _vectors(view, bank)
    problems += _links(view, bank, folding)
    problems += _episodes(view, bank, folding)
    if view.meta(PENDING):
        problems.append(Problem("file", "", "bytes of what was forgotten may be left in it: compact it"))
    return problems


def foreign_vectors(view: View, bank: str, embedder: Embedder) -> list[Problem]:
    """The vectors of the embedder's model that were not made of what their records say, as after a swap.

    Only who has the embedder can tell.
    """
    rows = [
        row
        for row in view.vector_rows(bank)
        if row.model == embedder.model and row.state not in (None, FORGOTTEN)
    ]
    problems = []
    for start in range(0, len(rows), _TOGETHER):
        some = {row.id: vector_of(row.dimension, row.vector) for row in rows[start : start + _TOGETHER]}
        records = [record for record in view.records(bank, ids=some) if some[record.id] is not None]
        made = (
            np.asarray(embedder.embed([record.text for record in records])) if records else np.zeros((0, 1))
        )
        for record, own in zip(records, made, strict=True):
            stored = np.asarray(some[record.id])
            length = np.linalg.norm(stored) * np.linalg.norm(own)
            alike = stored.shape == own.shape and float(stored @ own) >= _OWN * length
            if own.any() and not (alike and length > 0):
                problems.append(Problem("vector", record.id, "it was not made of what the record says"))
    return problems


def _chain(view: View, bank: str, folding: Folding) -> Iterable[Problem]:
    """Walk the events: numbers, hashes, digests, times; fold them on the way."""
    prev, seq, rev, at = GENESIS, 0, 0, -math.inf
    erased: list[Event] = []
    forgotten: dict[str, int] = {}
    for event in view.stream_events(bank):
        where = str(event.seq)
        if event.seq != seq + 1:
            yield Problem("chain", where, f"events {seq + 1} to {event.seq - 1} are missing")
        elif event.prev != prev:
            yield Problem("chain", where, "it does not follow the event before it")
        if _hash(event) != event.hash:
            yield Problem("event", where, "its header was changed: the hash is another")
        if event.erased:
            erased.append(event)
        elif payload_digest(event.salt, event.payload) != event.digest:
            yield Problem("event", where, "what it says was changed: the digest is another")
        if event.at < at or event.rev < rev:
            yield Problem("event", where, "it is older than the event before it")
        if event.action.partition(":")[0] == "forget":
            forgotten[event.record] = event.seq
        wrong = folding.apply(event)
        if wrong:
            yield Problem("event", where, wrong)
        prev, seq, rev, at = event.hash, event.seq, event.rev, event.at
    for event in erased:
        if max(forgotten.get(event.record, 0), forgotten.get(event.target, 0)) <= event.seq:
            yield Problem("event", str(event.seq), "it was erased, and nothing was forgotten afterwards")
    head = view.head(bank)
    if head is not None and (head.rev, head.seq, head.hash) != (rev, seq, prev):
        told = f"event {head.seq}" if head.seq != seq else "another hash or number of its transaction"
        yield Problem("chain", "", f"it ends with event {seq}, the bank's own row says {told}")
    if head is None and seq:
        yield Problem("chain", "", "the bank's own row is missing")


def _kept_head(view: View, bank: str, head: str) -> Iterable[Problem]:
    """Whether the chain still has an event that was its last once."""
    place, colon, hash_ = head.strip().partition(":")
    if not colon or not place.isdecimal() or not hash_:
        raise MemoryStoreError(
            f"{head!r} is no head of a chain: give SEQ:HASH, as the statistics of a bank have them."
        )
    seq = int(place)
    events = view.events(bank, seq - 1, 1) if seq else []
    if not events or events[0].seq != seq:
        yield Problem(
            "chain", place, "the head that was kept elsewhere is missing: the end of the chain was cut off"
        )
    elif events[0].hash != hash_:
        yield Problem(
            "chain", place, "it is another than the head that was kept elsewhere: the chain was written anew"
        )


def _hash(event: Event) -> str:
    try:
        return chain_hash(event.prev, event.header, event.digest)
    except (ValueError, TypeError):
        return ""


def _records(view: View, bank: str, folding: Folding) -> Iterable[Problem]:
    missing = set(folding.rows)
    for row in view.rows(bank):
        id = str(row.id)
        missing.discard(id)
        damage = damage_of(tuple(row))
        if damage:
            yield Problem("record", id, f"damaged: {damage}")
        elif id not in folding.rows:
            yield Problem("record", id, "no event created it")
        else:
            said = folding.rows[id]
            differing = [name for name, value in zip(COLUMNS, row, strict=True) if said.get(name) != value]
            if differing:
                yield Problem("record", id, f"{', '.join(differing)} differ from what the events say")
    for id in sorted(missing):
        yield Problem("record", id, "the events have it, the rows do not")


def _vectors(view: View, bank: str) -> Iterable[Problem]:
    models = view.models(bank)
    for row in view.vector_rows(bank):
        id, model, dimension, stored, state = tuple[Any, ...](row)
        if state in (None, FORGOTTEN):
            yield Problem("vector", id, "it belongs to no record")
        elif vector_of(dimension, stored) is None:
            yield Problem("vector", id, "damaged: not finite, or of another length than it says")
        elif models.get(model) != dimension:
            yield Problem("vector", id, f"{dimension} numbers, others of '{model}' have {models.get(model)}")


def _links(view: View, bank: str, folding: Folding) -> Iterable[Problem]:
    stored = {(link.source, link.kind, link.target): link.at for link in view.links(bank)}
    for key in sorted({*stored, *folding.links}):
        if stored.get(key) != folding.links.get(key):
            kind = (
                "it differs from" if key in stored and key in folding.links else "it is not in both rows and"
            )
            yield Problem("link", " ".join(key), f"{kind} events")


def _episodes(view: View, bank: str, folding: Folding) -> Iterable[Problem]:
    missing = set(folding.episodes)
    for row in view.episode_rows(bank):
        source, at, data = row.source, row.at, row.data
        missing.discard(source)
        try:
            StoredEpisode.from_json(source, at, data)
            digest = episode_digest(at, data)
        except (ValueError, TypeError, AttributeError, RecursionError) as error:
            yield Problem("episode", str(source), f"damaged: {error}")
            continue
        if folding.episodes.get(source) != digest:
            yield Problem("episode", source, "it is not what was stored")
    for source in sorted(missing):
        yield Problem("episode", source, "the events have it, the rows do not")
