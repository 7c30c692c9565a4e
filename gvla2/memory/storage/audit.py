"""Is a bank what its events say? Every way in which it may have been damaged or tampered with, named."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

from gvla2.errors import MemoryStoreError
from gvla2.memory.forgetting.scrubbing import PENDING, pending
from gvla2.memory.records import COLUMNS, damage_of
from gvla2.memory.storage.episodes import StoredEpisode
from gvla2.memory.storage.events import GENESIS, Event, chain_hash, payload_digest
from gvla2.memory.storage.rebuilding import Folding
from gvla2.memory.storage.transaction import episode_digest
from gvla2.memory.storage.view import View, vector_of


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
    for path in pending(view.meta(PENDING)):
        problems.append(Problem("file", path, "bytes of what was forgotten may be left in it: compact it"))
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
        elif payload_digest(event.salt, event.why, event.scores, event.change) != event.digest:
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
    if head is not None and head != (rev, seq, prev):
        told = f"event {head[1]}" if head[1] != seq else "another hash or number of its transaction"
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
        return chain_hash(
            event.prev,
            event.bank,
            event.seq,
            event.rev,
            event.at,
            event.actor,
            event.action,
            event.record,
            event.target,
            event.digest,
        )
    except (ValueError, TypeError):
        return ""


def _records(view: View, bank: str, folding: Folding) -> Iterable[Problem]:
    missing = set(folding.rows)
    for row in view.rows(bank):
        id = str(row[0])
        missing.discard(id)
        damage = damage_of(row)
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
    for id, model, dimension, stored, owned in view.vector_rows(bank):
        if not owned:
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
    for source, at, data in view.episode_rows(bank):
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
