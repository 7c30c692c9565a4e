"""A bank's tables besides records: the chain of events, links, and the learnt episodes.

Every decision about a bank is an event, and its rows can be rebuilt from the events.

An event has a header (seq, rev, at, actor, action, record, target) and a payload (why, scores, change, origin).
``digest = H(salt, payload)`` and ``hash = H(prev, header, digest)``: forgetting erases salt and payload, the chain
still holds. What ``change`` holds, by action:

* ``link:KIND``: nothing; ``record`` and ``target`` are the ends.
* ``forget``: the tombstone of a record; nothing where ``record`` names an episode.
* ``forget:part``: other events of the record were erased, as they mentioned a forgotten one; the whole record.
* ``episode``: ``{"episode": digest, "source": source}`` of the JSON saved under a source. ``record`` is a random
  name, which stays when the source is forgotten.
* any other: the whole record when it is created, ``{field: [before, after]}`` when it is changed,
  and "" for a decision that changed nothing. A change implies version + 1 and the event's rev.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields
from typing import Any

from gvla2.memory.contracts import MemoryTask, Verdict
from gvla2.memory.records import COLUMNS, FORGOTTEN, Record, clean, damage_of, dump, load_object

GENESIS = ""
"""``prev`` of a bank's first event."""

RESERVED = frozenset({"link", "forget", "episode"})
"""Actions that the store itself writes."""
MAX_TRANSCRIPT = 200_000


@dataclass(frozen=True, slots=True)
class Event:
    """One decision: its ``actor``, ``action``, ``record`` (and ``target``), reason and scores.

    ``at`` is in seconds since the epoch and never runs backwards within a bank; ``seq`` counts from 1 without gaps;
    ``rev`` is the number of the transaction. ``scores`` and ``change`` are canonical JSON. ``origin`` is the source of
    the evidence behind the decision, "" for none: a record's trust follows from its origins.
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
    origin: str
    salt: bytes
    digest: str
    prev: str
    hash: str

    @property
    def payload(self) -> tuple[str, str, str, str]:
        """The part that can be forgotten."""
        return self.why, self.scores, self.change, self.origin

    @property
    def header(self) -> tuple[object, ...]:
        """The part that stays, from ``bank`` to ``target``."""
        return self.bank, self.seq, self.rev, self.at, self.actor, self.action, self.record, self.target

    @property
    def damage(self) -> str:
        """What is wrong with the stored row, "" if nothing: the columns whose values cannot have been stored."""
        kinds = zip(EVENT_COLUMNS, _TYPES, strict=True)
        wrong = [name for name, kind in kinds if type(getattr(self, name)) is not kind]
        wrong += [] if wrong or math.isfinite(self.at) else ["at"]
        return f"damaged: {', '.join(wrong)} cannot be read" if wrong else ""

    @property
    def erased(self) -> bool:
        """Whether the payload was forgotten."""
        return not self.salt

    def change_json(self) -> dict[str, Any]:
        """What changed, see the module."""
        return load_object(self.change) if self.change else {}


EVENT_COLUMNS: tuple[str, ...] = tuple(field.name for field in fields(Event))
_TYPES = [{"float": float, "int": int, "bytes": bytes}.get(str(one.type), str) for one in fields(Event)]


@dataclass(frozen=True, slots=True)
class Link:
    """``source`` refers to ``target``; ``kind`` is conflict, merged, replaces or summary_of, or a plugin's own."""

    source: str
    kind: str
    target: str
    at: float


def payload_digest(salt: bytes, payload: Sequence[str]) -> str:
    """Digest of the payload (why, scores, change, origin); the random salt keeps anyone from guessing it."""
    return hashlib.sha256(salt + dump(list(payload)).encode()).hexdigest()


def chain_hash(prev: str, header: Sequence[object], digest: str) -> str:
    """Hash of the permanent part (``header``: bank to target, in the order of :class:`Event`), and of all events
    before.
    """
    return hashlib.sha256(dump([prev, *header, digest]).encode()).hexdigest()


def episode_digest(at: float, data: str) -> str:
    """The digest of a stored episode in the chain."""
    return hashlib.sha256(dump([at, data]).encode()).hexdigest()


@dataclass
class Folding:
    """A bank rebuilt by applying its events one by one; ``episodes`` are the digests of its episodes by source."""

    rows: dict[str, dict[str, Any]] = field(default_factory=dict)
    ties: dict[tuple[str, str, str], float] = field(default_factory=dict)
    episodes: dict[str, str] = field(default_factory=dict)
    _sources: dict[str, str] = field(default_factory=dict)
    _blurred: set[str] = field(default_factory=set)
    """Records with an erased event: later events need not fit, until one has the whole record."""

    @property
    def records(self) -> tuple[Record, ...]:
        """The records after the events so far, by id."""
        return tuple(record for record in self.whole() if record.state != FORGOTTEN)

    @property
    def links(self) -> tuple[Link, ...]:
        """The links, by source, kind and target."""
        return tuple(Link(*key, at) for key, at in sorted(self.ties.items()))

    def whole(self) -> list[Record]:
        """The sound records, including tombstones, by id."""
        return [Record(**row) for _, row in sorted(self.rows.items()) if not _damaged(row)]

    def apply(self, event: Event) -> str:
        """Apply the next event; returns what does not fit, "" if nothing."""
        if event.damage:
            self._blurred.add(event.record)
            return event.damage
        verb, _, kind = event.action.partition(":")
        if verb == "link":
            key = (event.record, kind, event.target)
            self.ties[key] = event.at
            self._touch((event.record, event.target), event.rev)
            return ""
        if verb == "forget" and not kind:  # even if it was erased, as when the same id is forgotten again
            for key in [key for key in self.ties if event.record in (key[0], key[2])]:
                del self.ties[key]
                self._touch({key[0], key[2]} - {event.record}, event.rev)
        if event.erased:
            self._blurred.add(event.record)
            return ""
        try:
            change = event.change_json()
        except (ValueError, RecursionError):
            return "its change is not valid JSON"
        if verb == "episode":
            source = self._sources[event.record] = str(change.get("source", event.record))
            self.episodes[source] = str(change.get("episode"))
            return ""
        if verb == "forget" and not change:
            self.episodes.pop(self._sources.get(event.record, event.record), None)
            return ""
        return self._change(event, change) if event.change else ""

    def _touch(self, ends: Iterable[str], rev: int) -> None:
        """The ends of a link count as changed, except a missing (forgotten) one."""
        for row in map(self.rows.get, ends):
            if row is not None and row["state"] != FORGOTTEN:
                row["rev"] = rev

    def _change(self, event: Event, change: dict[str, Any]) -> str:
        if "id" in change:
            if wrong := _damaged(change):
                return wrong
            self.rows[event.record] = change
            self._blurred.discard(event.record)
            return ""
        row, blurred = self.rows.get(event.record), event.record in self._blurred
        if row is None:
            return "" if blurred else "it changes a record that was never created"
        wrong = ""
        for name, pair in change.items():
            if name not in row or not isinstance(pair, list) or len(pair) != 2:
                return "it lacks the old or the new value"
            if type(pair[1]) is not type(row[name]):
                return f"its {name} is of a wrong type"
            if row[name] != pair[0] and not blurred:
                wrong = f"{name} did not have the old value that it gives"
            row[name] = pair[1]
        row["version"] += 1
        row["rev"] = event.rev
        return wrong


def _damaged(row: Mapping[str, Any]) -> str:
    """What is wrong with a rebuilt record, "" if nothing."""
    return damage_of(tuple(row[name] for name in COLUMNS)) if set(row) == set(COLUMNS) else "it lacks columns"


@dataclass(frozen=True)
class StoredEpisode:
    """An episode as replay needs it. ``source`` identifies it in its bank; saving it again replaces it.

    ``at`` is seconds since the epoch; ``facts`` are named JSON observations (an exit status); ``verdicts`` those given
    up to now, oldest first; ``records`` the ids of the records that it taught: forgetting one of them forgets the
    episode too.
    """

    source: str
    at: float
    task: MemoryTask
    transcript: str = ""
    facts: Mapping[str, Any] = field(default_factory=dict)
    verdicts: tuple[Verdict, ...] = ()
    records: tuple[str, ...] = ()

    def to_json(self) -> str:
        """Canonical JSON without ``source`` and ``at``; raises ``ValueError`` or ``TypeError`` for unsound facts."""
        data = asdict(self) | {"transcript": clean(self.transcript, MAX_TRANSCRIPT)}
        del data["source"], data["at"]
        return dump(data).encode("utf-8", "replace").decode()

    @classmethod
    def from_json(cls, source: object, at: object, text: object) -> StoredEpisode:
        """The episode of :meth:`to_json`; raises ``ValueError`` for anything else."""
        try:
            data = load_object(str(text))
            if not isinstance(source, str) or not isinstance(at, float) or not math.isfinite(at):
                raise ValueError("no source or no time")
            return cls(
                source=source,
                at=at,
                task=MemoryTask(**_frozen(data["task"])),
                transcript=str(data["transcript"]),
                facts=dict(data["facts"]),
                verdicts=tuple(Verdict(**_frozen(verdict)) for verdict in data["verdicts"]),
                records=tuple(data["records"]),
            )
        except (KeyError, TypeError, AttributeError, RecursionError) as error:
            raise ValueError(f"not an episode: {error}") from error


def _frozen(data: Mapping[str, Any]) -> dict[str, Any]:
    """Lists converted back to tuples."""
    return {name: tuple(value) if isinstance(value, list) else value for name, value in data.items()}
