"""The interface of a peer: a memory in JSON lines files, measured beside the bank."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from gvla2.memory.records import Record


@dataclass(frozen=True)
class PeerLesson:
    """A record as peers know it. ``created`` is in seconds since the epoch; ``status`` a verdict's outcome."""

    id: str
    query: str
    content: str
    type: str
    status: str
    confidence: float
    quality: float
    created: float
    usage: int = 0

    @classmethod
    def of(cls, record: Record) -> PeerLesson:
        """The same lesson."""
        return cls(
            record.id,
            record.query,
            record.content,
            record.type,
            record.outcome,
            record.confidence,
            record.quality,
            record.created,
            record.usage,
        )


class Peer(Protocol):
    """A memory of JSON lines in a folder. ``now`` is in seconds since the epoch."""

    @property
    def name(self) -> str:
        """Its name in the table."""
        ...

    def fill(self, folder: Path, lessons: Sequence[PeerLesson]) -> None:
        """Write these as the active records."""
        ...

    def load(self, folder: Path) -> list[Any]:
        """Read the active records. A damaged file may raise anything."""
        ...

    def retrieve(self, folder: Path, query: str, k: int, now: float) -> list[str]:
        """Ids of the ``k`` best records, from the file."""
        ...

    def admit(self, folder: Path, lessons: Sequence[PeerLesson]) -> None:
        """Read the file, consolidate each lesson with it, and write it again."""
        ...

    def place(self, lesson: PeerLesson, records: list[Any]) -> str:
        """Consolidate one lesson with loaded records; the decision's name."""
        ...

    def govern(self, records: list[Any], budget: int, now: float) -> int:
        """A pass over loaded records; how many stay active."""
        ...

    def contradict(self, first: str, second: str) -> bool:
        """Whether two contents contradict each other."""
        ...

    def relevance(self, query: str, text: str) -> float:
        """How well a text fits a query."""
        ...
