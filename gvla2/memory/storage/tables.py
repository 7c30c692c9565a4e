"""The memory's tables, declared once for SQLite and PostgreSQL, with the dataclasses' columns."""

from __future__ import annotations

from typing import Any

from sqlalchemy import BigInteger, Column, Float, Index, LargeBinary, MetaData, Table, Text, UniqueConstraint
from sqlalchemy.types import TypeEngine

from gvla2.memory.records import COLUMNS
from gvla2.memory.records import TYPES as RECORD_TYPES
from gvla2.memory.storage.events import EVENT_COLUMNS

SCHEMA_VERSION = 4
"""Version of the tables, kept in ``memory_meta``; any other is refused."""
PENDING = "scrub"
"""Key of ``memory_meta`` while bytes of something forgotten may be left in the files: a random token."""
METADATA = MetaData()


class _Bytes(LargeBinary):
    """Bytes as they are stored: SQLAlchemy's own fail at a damaged row that holds something else."""

    result_processor = TypeEngine.result_processor


_FLOAT = Float(53)
_NUMBERED = {"seq": BigInteger, "rev": BigInteger, "at": _FLOAT, "salt": _Bytes}


def _column(name: str, kind: Any = Text, *, key: bool = False) -> Column[Any]:
    return Column(name, kind, primary_key=key, nullable=False, autoincrement=False)


META = Table("memory_meta", METADATA, _column("key", key=True), _column("value"))
"""Facts about the database: ``schema``, and :data:`PENDING`."""

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
        for name, kind in zip(COLUMNS, RECORD_TYPES, strict=True)
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
"""The chain of decisions, see :mod:`gvla2.memory.storage.events`."""

EPISODE = Table(
    "memory_episode",
    METADATA,
    *(_column(name, key=True) for name in ("bank", "source")),
    _column("name"),
    _column("at", _FLOAT),
    _column("data"),
)
"""The episodes for replay: the JSON of a :class:`gvla2.memory.storage.events.StoredEpisode`. ``name`` is random, and
events use it: a source in their headers could never be forgotten.
"""

TABLES: tuple[Table, ...] = tuple(METADATA.sorted_tables)
