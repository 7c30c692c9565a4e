"""The chain of events: every decision about a bank, from which its rows can be built again.

An event has a header (seq, rev, at, actor, action, record, target) and a payload (why, scores, change).
``digest = H(salt, payload)`` and ``hash = H(prev, header, digest)``: forgetting erases salt and payload, the chain
still holds. What ``change`` holds, by action:

* ``link:KIND`` and ``unlink:KIND``: nothing; ``record`` and ``target`` are the ends.
* ``forget``: the tombstone of a record; nothing where ``record`` names an episode.
* ``forget:part``: other events of the record were erased, as they quoted one that was forgotten; the whole record.
* ``episode``: ``{"episode": digest, "source": source}`` of the JSON saved under a source. ``record`` is a random
  name, which stays when the source is forgotten; in older banks there is no "source", and ``record`` is it.
* any other: the whole record when it is created, ``{field: [before, after]}`` when it is changed, and "" for a
  decision that changed nothing. Of a change, version + 1 and the event's rev go without saying.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

from gvla2.memory.records import dump, load_object

GENESIS = ""
"""What the first event of a bank has for ``prev``."""

RESERVED = frozenset({"link", "unlink", "forget", "episode"})
"""Actions that the store itself writes."""


@dataclass(frozen=True, slots=True)
class Event:
    """One decision: who (``actor``), what (``action``), about which ``record`` (and ``target``), why, by which scores.

    ``at`` is in seconds since the epoch and never runs backwards within a bank; ``seq`` counts from 1 without gaps;
    ``rev`` is the number of the transaction. ``scores`` and ``change`` are canonical JSON.
    """

    bank: str
    seq: int
    rev: int
    at: float
    actor: str
    action: str
    record: str
    target: str
    why: str
    scores: str
    change: str
    salt: bytes
    digest: str
    prev: str
    hash: str

    @property
    def erased(self) -> bool:
        """Whether the payload was forgotten."""
        return not self.salt

    def scores_json(self) -> dict[str, float]:
        """The scores that led to the decision."""
        return load_object(self.scores) if self.scores else {}

    def change_json(self) -> dict[str, Any]:
        """What changed, see the module."""
        return load_object(self.change) if self.change else {}


EVENT_COLUMNS: tuple[str, ...] = tuple(field.name for field in fields(Event))


@dataclass(frozen=True, slots=True)
class Link:
    """``source`` refers to ``target``; ``kind`` is conflict, merged, replaces or summary_of, or a plugin's own."""

    source: str
    kind: str
    target: str
    at: float


def payload_digest(salt: bytes, why: str, scores: str, change: str) -> str:
    """Digest of what can be forgotten; the random salt keeps anyone from guessing the text afterwards."""
    return hashlib.sha256(salt + dump([why, scores, change]).encode()).hexdigest()


def chain_hash(
    prev: str,
    bank: str,
    seq: int,
    rev: int,
    at: float,
    actor: str,
    action: str,
    record: str,
    target: str,
    digest: str,
) -> str:
    """Hash of what can never be forgotten, and of all events before."""
    header = dump([prev, bank, seq, rev, at, actor, action, record, target, digest])
    return hashlib.sha256(header.encode()).hexdigest()


def difference(before: Mapping[str, Any], after: Mapping[str, Any]) -> dict[str, list[Any]]:
    """``{field: [before, after]}`` of what differs, version and rev aside."""
    return {
        name: [before[name], value]
        for name, value in after.items()
        if name not in ("version", "rev") and before[name] != value
    }
