"""The memory's tables, for SQLite and PostgreSQL alike, and the digests of its chain of events.

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
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any, NamedTuple

from sqlalchemy import (
    BigInteger,
    Column,
    Float,
    Index,
    LargeBinary,
    MetaData,
    Row,
    Table,
    Text,
    UniqueConstraint,
)
from sqlalchemy.types import TypeEngine

from gvla2.memory.contracts import MemoryTask
from gvla2.memory.records import COLUMN_TYPES, COLUMNS, Record, as_json, dump, load_object

SCHEMA_VERSION = 6
"""Version of the tables, kept in ``memory_meta``; any other is refused."""
GENESIS = ""
"""``prev`` of a bank's first event."""
HEADER = ("bank", "seq", "rev", "at", "actor", "action", "record", "target")
"""The columns of an event that stay."""
PAYLOAD = ("why", "scores", "change", "origin", "state")
"""The columns of an event that can be forgotten."""


class _Bytes(LargeBinary):
    """Bytes as they are stored: SQLAlchemy's own fail at a damaged row that holds something else."""

    result_processor = TypeEngine.result_processor


METADATA = MetaData()
_KINDS = {
    **dict(zip(COLUMNS, COLUMN_TYPES, strict=True)),
    **{"seq": int, "rev": int, "dimension": int, "at": float, "salt": bytes, "vector": bytes},
}
"""Python types of the columns, where they are not text."""
_TYPES: Mapping[type, Any] = {str: Text, int: BigInteger, float: Float(53), bytes: _Bytes}


def _columns(names: str, keys: str = "") -> Iterator[Column[Any]]:
    for name in names.split():
        kind = _TYPES[_KINDS.get(name, str)]
        yield Column(name, kind, primary_key=name in keys.split(), nullable=False, autoincrement=False)


META = Table("memory_meta", METADATA, *_columns("key value", "key"))
"""Facts about the database: ``schema``."""

BANK = Table("memory_bank", METADATA, *_columns("bank rev seq hash at", "bank"))
"""A bank and the head of its chain. Each transaction advances this row."""

RECORD = Table(
    "memory",
    METADATA,
    *_columns(" ".join(COLUMNS), "id bank"),
    UniqueConstraint("bank", "dedup_key"),
    Index("memory_by_rev", "bank", "rev"),
)
"""Records. JSON columns are text, so that one damaged row cannot spoil a query."""

VECTOR = Table("memory_vector", METADATA, *_columns("bank id model dimension vector", "bank id"))
"""The embedding of a record's text, float32 little-endian: derived data, outside the chain of events."""

LINK = Table(
    "memory_link",
    METADATA,
    *_columns("bank source kind target at", "bank source kind target"),
    Index("memory_link_by_target", "target", "bank"),
)
"""One record refers to another of its bank."""

EVENT = Table(
    "memory_event",
    METADATA,
    *_columns(" ".join((*HEADER, *PAYLOAD, "salt digest prev hash")), "bank seq"),
    Index("memory_event_by_record", "bank", "record"),
)
"""The chain of decisions, each with its ``actor``, ``action``, ``record`` (and ``target``), reason and scores.

``at`` is in seconds since the epoch and never runs backwards within a bank; ``seq`` counts from 1 without gaps; ``rev``
is the number of the transaction. ``scores`` and ``change`` are canonical JSON. ``origin`` is the source of the evidence
behind the decision, "" for none: a record's trust follows from its origins. A forgotten payload has no ``salt``.
"""

EPISODE = Table("memory_episode", METADATA, *_columns("bank source name at data", "bank source"))
"""The episodes for replay: the JSON of a :class:`StoredEpisode`. ``name`` is random, and events use it: a source in
their headers could never be forgotten."""

TABLES: tuple[Table, ...] = tuple(METADATA.sorted_tables)


def event_damage(event: Row[Any]) -> str:
    """What is wrong with a stored event, "" if nothing: columns whose values cannot have been stored."""
    wrong = [name for name, value in event._asdict().items() if type(value) is not _KINDS.get(name, str)]
    return f"damaged: {', '.join(wrong)} cannot be read" if wrong or not math.isfinite(event.at) else ""


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


class Link(NamedTuple):
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
    def from_json(cls, source: str, at: float, text: object) -> StoredEpisode:
        """The episode of :meth:`to_json`; raises ``ValueError`` for anything else."""
        try:
            data = load_object(str(text))
            task = MemoryTask(data["task"]["query"], skill=data["task"]["skill"])
            kept = str(data["transcript"]), dict(data["facts"]), int(data["judged"]), tuple(data["records"])
            return cls(source, at, task, *kept)
        except (KeyError, TypeError, AttributeError, RecursionError) as error:
            raise ValueError(f"not an episode: {error}") from error
