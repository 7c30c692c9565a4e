"""The memory's tables, for SQLite and PostgreSQL alike, and the rows of its chain of events, links and episodes.

Every decision about a bank is an event. An event has a header (bank, seq, rev, at, actor, action, record, target) and a
payload (why, scores, change, origin, state). ``digest = H(salt, payload)`` and ``hash = H(prev, header, digest)``:
forgetting erases salt and payload, and the chain still holds. ``change`` is JSON: the whole record when it is created,
``{field: [before, after]}`` when it is changed, ``{"episode": digest, "source": source}`` when an episode is stored,
and "" for a decision that changed nothing. ``state`` is the digest of the record's row after the event, "" if the
event changed no row: a row that differs from its last ``state`` was changed outside the bank.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields
from typing import Any

from sqlalchemy import BigInteger, Column, Float, Index, LargeBinary, MetaData, Table, Text, UniqueConstraint
from sqlalchemy.types import TypeEngine

from gvla2.memory.contracts import MemoryTask
from gvla2.memory.records import COLUMN_TYPES, COLUMNS, Record, as_json, dump, load_object

SCHEMA_VERSION = 5
"""Version of the tables, kept in ``memory_meta``; any other is refused."""
GENESIS = ""
"""``prev`` of a bank's first event."""


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
    state: str
    salt: bytes
    digest: str
    prev: str
    hash: str

    @property
    def payload(self) -> tuple[str, ...]:
        """The part that can be forgotten."""
        return self.why, self.scores, self.change, self.origin, self.state

    @property
    def header(self) -> tuple[object, ...]:
        """The part that stays, from ``bank`` to ``target``."""
        return self.bank, self.seq, self.rev, self.at, self.actor, self.action, self.record, self.target

    @property
    def damage(self) -> str:
        """What is wrong with the stored row, "" if nothing: columns whose values cannot have been stored."""
        values = zip(EVENT_COLUMNS, _EVENT_TYPES, strict=True)
        wrong = [name for name, kind in values if type(getattr(self, name)) is not kind]
        return f"damaged: {', '.join(wrong)} cannot be read" if wrong or not math.isfinite(self.at) else ""

    @property
    def erased(self) -> bool:
        """Whether the payload was forgotten."""
        return not self.salt

    def change_json(self) -> dict[str, Any]:
        """What changed, see the module."""
        return load_object(self.change) if self.change else {}


EVENT_COLUMNS: tuple[str, ...] = tuple(one.name for one in fields(Event))
_EVENT_TYPES = [{"float": float, "int": int, "bytes": bytes}.get(str(one.type), str) for one in fields(Event)]


def payload_digest(salt: bytes, payload: Sequence[str]) -> str:
    """Digest of a payload; the random salt keeps anyone from guessing a forgotten one."""
    return hashlib.sha256(salt + dump(list(payload)).encode()).hexdigest()


def digest_of(*data: object) -> str:
    """Digest of JSON data: of (prev, *header, payload digest) an event's hash, of (at, data) an episode's digest."""
    return hashlib.sha256(dump(list(data)).encode()).hexdigest()


def row_digest(record: Record) -> str:
    """Digest of a record's row, except ``rev``, which a link changes without an event of the record."""
    columns = as_json(record)
    del columns["rev"]
    return hashlib.sha256(dump(columns).encode()).hexdigest()


@dataclass(frozen=True, slots=True)
class Link:
    """``source`` refers to ``target``; ``kind`` is conflict or dismissed (a judge found none), or a plugin's own."""

    source: str
    kind: str
    target: str
    at: float


@dataclass(frozen=True)
class StoredEpisode:
    """An episode as replay needs it. ``source`` identifies it in its bank; saving it again replaces it.

    ``at`` is seconds since the epoch; ``facts`` are named JSON observations (an exit status); ``judged`` counts the
    verdicts so far; ``records`` are the ids of the records that it taught: forgetting one of them forgets the episode
    too.
    """

    source: str
    at: float
    task: MemoryTask
    transcript: str = ""
    facts: Mapping[str, Any] = field(default_factory=dict)
    judged: int = 0
    records: tuple[str, ...] = ()

    def to_json(self) -> str:
        """Canonical JSON without ``source`` and ``at``; raises ``ValueError`` or ``TypeError`` for invalid facts."""
        data = asdict(self)
        del data["source"], data["at"]
        return dump(data).encode("utf-8", "replace").decode()

    @classmethod
    def from_json(cls, source: object, at: object, text: object) -> StoredEpisode:
        """The episode of :meth:`to_json`; raises ``ValueError`` for anything else."""
        try:
            data = load_object(str(text))
            task = MemoryTask(data["task"]["query"], skill=data["task"]["skill"])
            if not isinstance(source, str) or not isinstance(at, float) or not math.isfinite(at):
                raise ValueError("no source or no time")
            return cls(
                source, at, task, transcript=str(data["transcript"]), facts=dict(data["facts"]),
                judged=int(data.get("judged", 1)), records=tuple(data["records"]),
            )  # fmt: skip
        except (KeyError, TypeError, AttributeError, RecursionError) as error:
            raise ValueError(f"not an episode: {error}") from error


class _Bytes(LargeBinary):
    """Bytes as they are stored: SQLAlchemy's own fail at a damaged row that holds something else."""

    result_processor = TypeEngine.result_processor


METADATA = MetaData()
_FLOAT = Float(53)
_NUMBERED = {"seq": BigInteger, "rev": BigInteger, "at": _FLOAT, "salt": _Bytes}


def _column(name: str, kind: Any = Text, *, key: bool = False) -> Column[Any]:
    return Column(name, kind, primary_key=key, nullable=False, autoincrement=False)


META = Table("memory_meta", METADATA, _column("key", key=True), _column("value"))
"""Facts about the database: ``schema``."""

BANK = Table(
    "memory_bank",
    METADATA,
    _column("bank", key=True),
    *(_column(name, _NUMBERED.get(name, Text)) for name in ("rev", "seq", "hash", "at")),
)
"""A bank and the head of its chain. Each transaction advances this row."""

RECORD = Table(
    "memory",
    METADATA,
    *(
        _column(name, {str: Text, int: BigInteger, float: _FLOAT}[kind], key=name in ("id", "bank"))
        for name, kind in zip(COLUMNS, COLUMN_TYPES, strict=True)
    ),
    UniqueConstraint("bank", "dedup_key"),
    Index("memory_by_rev", "bank", "rev"),
)
"""Records. JSON columns are text, so that one damaged row cannot spoil a query."""

VECTOR = Table(
    "memory_vector",
    METADATA,
    *(_column(name, key=True) for name in ("bank", "id")),
    _column("model"),
    _column("dimension", BigInteger),
    _column("vector", _Bytes),
)
"""The embedding of a record's text, float32 little-endian: derived data, outside the chain of events."""

LINK = Table(
    "memory_link",
    METADATA,
    *(_column(name, key=True) for name in ("bank", "source", "kind", "target")),
    _column("at", _FLOAT),
    Index("memory_link_by_target", "target", "bank"),
)
"""One record refers to another of its bank."""

EVENT = Table(
    "memory_event",
    METADATA,
    *(_column(name, _NUMBERED.get(name, Text), key=name in ("bank", "seq")) for name in EVENT_COLUMNS),
    Index("memory_event_by_record", "bank", "record"),
)
"""The chain of decisions."""

EPISODE = Table(
    "memory_episode",
    METADATA,
    *(_column(name, key=True) for name in ("bank", "source")),
    _column("name"),
    _column("at", _FLOAT),
    _column("data"),
)
"""The episodes for replay: the JSON of a :class:`StoredEpisode`. ``name`` is random, and events use it: a source in
their headers could never be forgotten."""

TABLES: tuple[Table, ...] = tuple(METADATA.sorted_tables)
