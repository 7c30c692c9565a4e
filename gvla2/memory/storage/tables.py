"""The memory's tables. What is stored, event for event, is explained in :mod:`gvla2.memory.storage.events`."""

from __future__ import annotations

from typing import Any, ClassVar

from sqlalchemy import BigInteger, Index, LargeBinary, Text, UniqueConstraint
from sqlalchemy.engine import Dialect
from sqlalchemy.orm import registry
from sqlalchemy.schema import CreateIndex, CreateTable
from sqlmodel import Field, SQLModel

tables = registry()
_CLUSTERED = {"sqlite_with_rowid": False}


class MemoryTables(SQLModel, registry=tables):
    """Keeps these tables apart from any other SQLModel table of the same process."""


class MetaRow(MemoryTables, table=True):
    """Facts about the database itself: ``schema``, and ``scrub`` while forgotten bytes may be in the file."""

    __tablename__: ClassVar[Any] = "memory_meta"

    key: str = Field(primary_key=True)
    value: str


class BankRow(MemoryTables, table=True):
    """A bank and the head of its chain of events; who writes to the bank advances this row.

    ``models`` is JSON: the dimension of the vectors of each embedding model.
    """

    __tablename__: ClassVar[Any] = "memory_bank"
    __table_args__ = (_CLUSTERED,)

    bank: str = Field(primary_key=True)
    rev: int = Field(sa_type=BigInteger)
    seq: int = Field(sa_type=BigInteger)
    hash: str
    at: float
    models: str = "{}"


class RecordRow(MemoryTables, table=True):
    """A record, column for column a :class:`gvla2.memory.records.Record`.

    JSON columns are text, so that one damaged row cannot spoil a query.
    """

    __tablename__: ClassVar[Any] = "memory"
    __table_args__ = (UniqueConstraint("bank", "dedup_key"), Index("memory_by_rev", "bank", "rev"))

    id: str = Field(primary_key=True)
    bank: str = Field(primary_key=True)
    query: str = Field(sa_type=Text)
    content: str = Field(sa_type=Text)
    type: str
    state: str
    outcome: str
    confidence: float
    quality: float
    dedup_key: str
    created: float
    updated: float
    used: float
    count: int = Field(sa_type=BigInteger)
    usage: int = Field(sa_type=BigInteger)
    recalled: int = Field(sa_type=BigInteger)
    verifier: str = Field(sa_type=Text)
    signature: str = Field(sa_type=Text)
    skill: str
    effect: str = Field(sa_type=Text)
    provenance: str = Field(sa_type=Text)
    note: str = Field(sa_type=Text)
    version: int = Field(sa_type=BigInteger)
    rev: int = Field(sa_type=BigInteger)


class VectorRow(MemoryTables, table=True):
    """The embedding of a record's text, float32 little-endian: derived data, outside the chain of events."""

    __tablename__: ClassVar[Any] = "memory_vector"

    bank: str = Field(primary_key=True)
    id: str = Field(primary_key=True)
    model: str
    dimension: int
    vector: bytes = Field(sa_type=LargeBinary)


class LinkRow(MemoryTables, table=True):
    """One record refers to another of its bank."""

    __tablename__: ClassVar[Any] = "memory_link"
    __table_args__ = (Index("memory_link_by_target", "target", "bank"), _CLUSTERED)

    bank: str = Field(primary_key=True)
    source: str = Field(primary_key=True)
    kind: str = Field(primary_key=True)
    target: str = Field(primary_key=True)
    at: float


class EventRow(MemoryTables, table=True):
    """One decision, column for column a :class:`gvla2.memory.storage.events.Event`."""

    __tablename__: ClassVar[Any] = "memory_event"
    # Not clustered: rows of this size would spill over to pages of their own.
    __table_args__ = (Index("memory_event_by_record", "bank", "record"),)

    bank: str = Field(primary_key=True)
    seq: int = Field(primary_key=True, sa_type=BigInteger)
    rev: int = Field(sa_type=BigInteger)
    at: float
    actor: str
    action: str
    record: str
    target: str
    why: str = Field(sa_type=Text)
    scores: str = Field(sa_type=Text)
    change: str = Field(sa_type=Text)
    salt: bytes = Field(sa_type=LargeBinary)
    digest: str
    prev: str
    hash: str


class EpisodeRow(MemoryTables, table=True):
    """What replay verifies again; ``data`` is the JSON of a :class:`gvla2.memory.storage.episodes.StoredEpisode`."""

    __tablename__: ClassVar[Any] = "memory_episode"

    bank: str = Field(primary_key=True)
    source: str = Field(primary_key=True)
    rev: int = Field(sa_type=BigInteger)
    at: float
    data: str = Field(sa_type=Text)


def create_statements(dialect: Dialect) -> list[str]:
    """The SQL that creates all tables and indices."""
    statements = []
    for table in tables.metadata.sorted_tables:
        statements.append(str(CreateTable(table).compile(dialect=dialect)))
        indices = sorted(table.indexes, key=lambda index: str(index.name))
        statements += [str(CreateIndex(index).compile(dialect=dialect)) for index in indices]
    return statements


def table_columns() -> dict[str, tuple[str, ...]]:
    """The names of all tables' columns by the tables' names."""
    return {
        table.name: tuple(column.name for column in table.columns) for table in tables.metadata.sorted_tables
    }
