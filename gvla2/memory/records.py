"""The stored form of a memory record: m = (i, q, c, y, s, z, kappa, R, u, d, L, v) of the paper, and more."""

from __future__ import annotations

import hashlib
import json
import math
import unicodedata
from collections.abc import Mapping
from typing import Any, ClassVar, cast

import numpy as np
from numpy.typing import NDArray
from sqlalchemy import LargeBinary, Text, UniqueConstraint
from sqlalchemy.orm import registry
from sqlmodel import Field, SQLModel

from gvla2.memory.contracts import LifecycleState, Outcome, RecordType

SCHEMA_VERSION = 1
"""Version of the tables below, kept in ``memory_meta``; a database of a later one is refused."""

tables = registry()


class MemoryTables(SQLModel, registry=tables):
    """Keeps these tables apart from any other SQLModel table of the same process."""


class Meta(MemoryTables, table=True):
    """Facts about the database itself, such as its schema version."""

    __tablename__: ClassVar[Any] = "memory_meta"

    key: str = Field(primary_key=True)
    value: str


class Record(MemoryTables, table=True):
    """One lesson in a bank.

    ``query`` are the instructions it came from, one a line; ``count`` how many episodes say the same; ``usage`` how
    often it was recalled for an episode that was then verified as a success, ``recalled`` how often for one whose
    outcome was verified either way. Times are seconds since the epoch. ``version`` counts the changes of this row,
    ``rev`` numbers all changes of its bank. JSON columns are text, so that one damaged row cannot spoil a query.
    ``embedding`` is float32, little-endian, made by ``embedding_model``.
    """

    __tablename__: ClassVar[Any] = "memory"
    __table_args__ = (UniqueConstraint("bank", "dedup_key"),)

    id: str = Field(primary_key=True)
    bank: str = Field(index=True)
    query: str = Field(sa_type=Text)
    content: str = Field(sa_type=Text)
    type: str
    state: str = Field(index=True)
    outcome: str
    confidence: float
    quality: float
    count: int = 1
    usage: int = 0
    recalled: int = 0
    dedup_key: str
    links: str = "[]"
    verifier: str = "{}"
    signature: str = "{}"
    skill: str = ""
    effect: str = ""
    provenance: str = "{}"
    note: str = ""
    embedding: bytes = Field(default=b"", sa_type=LargeBinary)
    embedding_model: str = ""
    created: float
    updated: float
    version: int = 1
    rev: int

    @property
    def record_type(self) -> RecordType:
        """The type, as the contract spells it."""
        return cast(RecordType, self.type)

    @property
    def lifecycle(self) -> LifecycleState:
        """The state, as the contract spells it."""
        return cast(LifecycleState, self.state)

    @property
    def verified_as(self) -> Outcome:
        """The outcome, as the contract spells it."""
        return cast(Outcome, self.outcome)

    def effect_json(self) -> dict[str, Any] | None:
        """The typed effect, or None; raises ``ValueError`` where the column is damaged."""
        return _json_object(self.effect) if self.effect else None

    def signature_json(self) -> dict[str, float]:
        """The scene's signature; raises ``ValueError`` where the column is damaged."""
        return {k: float(v) for k, v in _json_object(self.signature).items()}

    def conflicts(self) -> int:
        """How many records contradict this one; raises ``ValueError`` where the column is damaged."""
        links = json.loads(self.links)
        if not isinstance(links, list):
            raise ValueError("links are not a list")
        return sum(isinstance(link, dict) and link.get("kind") == "conflict" for link in links)

    def vector(self, model: str, dimension: int) -> NDArray[np.float32]:
        """(dimension,) unit row; zero where it was made by another model or is damaged."""
        stored = np.frombuffer(self.embedding[: len(self.embedding) // 4 * 4], dtype="<f4")
        if self.embedding_model != model or stored.shape != (dimension,) or not np.isfinite(stored).all():
            return np.zeros(dimension, dtype=np.float32)
        return stored.astype(np.float32)


def _json_object(text: str) -> dict[str, Any]:
    data = json.loads(text)
    if not isinstance(data, dict):
        raise ValueError("not a JSON object")
    return data


def dump(data: Any) -> str:
    """JSON with sorted keys: the same data give the same text. Raises ``ValueError`` for NaN and infinity."""
    return json.dumps(data, sort_keys=True, ensure_ascii=False, separators=(",", ":"), allow_nan=False)


def clean(text: str, limit: int) -> str:
    """Text that any database takes: no NUL, no lone surrogates, at most ``limit`` characters."""
    return text[:limit].replace("\x00", "").encode("utf-8", "replace").decode("utf-8")


def finite(numbers: Mapping[str, float]) -> dict[str, float]:
    """The entries that are finite numbers."""
    return {str(k): float(v) for k, v in numbers.items() if math.isfinite(float(v))}


def dedup_key(kind: RecordType, content: str, skill: str, effect: Mapping[str, Any] | None) -> str:
    """Two lessons of one key say the same: equal words (case, width and spacing aside) and the same parameter.

    The effect's numbers are left out: they are what merging pools.
    """
    words = " ".join(unicodedata.normalize("NFKC", content).casefold().split())
    about = [str((effect or {}).get(name, "")) for name in ("kind", "parameter", "op", "skill")]
    return hashlib.blake2b(dump([kind, words, skill, about]).encode(), digest_size=16).hexdigest()


def record_id(kind: RecordType, bank: str, key: str) -> str:
    """A short, stable id: the same lesson in the same bank has the same one on every machine."""
    prefix = {"procedural_hint": "hint", "failure_avoidance": "avoid", "tool_usage": "tool"}[kind]
    return f"{prefix}-{hashlib.blake2b(dump([bank, key]).encode(), digest_size=6).hexdigest()}"
