"""The plain peer: records as JSON lines, read and written whole, as in the paper's released code."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields
from functools import lru_cache
from pathlib import Path

from gvla2.memory.records import Record

FILE = "active.jsonl"
CONFLICT = 0.3
_NEGATIONS = frozenset(("no", "not", "never", "avoid", "cannot", "without", "don't", "dont"))


@dataclass(frozen=True)
class PeerLesson:
    """A record as the peer knows it. ``created`` is in seconds since the epoch; ``outcome`` a verdict's."""

    id: str
    query: str
    content: str
    type: str
    outcome: str
    confidence: float
    quality: float
    created: float
    usage: int = 0

    @classmethod
    def of(cls, record: Record) -> PeerLesson:
        """The same lesson."""
        return cls(**{field.name: getattr(record, field.name) for field in fields(cls)})


class PlainPeer:
    """Active records as JSON lines in a folder, one file. ``now`` is in seconds since the epoch."""

    name = "JSONL, linear"

    def fill(self, folder: Path, lessons: Sequence[PeerLesson]) -> None:
        """One line per record."""
        folder.mkdir(parents=True, exist_ok=True)
        with (folder / FILE).open("w", encoding="utf-8") as file:
            file.writelines(json.dumps(asdict(lesson), ensure_ascii=False) + "\n" for lesson in lessons)

    def load(self, folder: Path) -> list[PeerLesson]:
        """All lines, parsed."""
        path = folder / FILE
        if not path.exists():
            return []
        with path.open(encoding="utf-8") as file:
            return [PeerLesson(**json.loads(line)) for line in file if line.strip()]

    def contradict(self, first: str, second: str) -> bool:
        """One has a word of negation, the other none, and they share words."""
        negated = [bool(_all_words(text) & _NEGATIONS) for text in (first, second)]
        return negated[0] != negated[1] and _shared(first, second) >= CONFLICT


@lru_cache(maxsize=50_000)
def _all_words(text: str) -> frozenset[str]:
    return frozenset(re.findall(r"[a-z0-9_']+", text.lower()))


@lru_cache(maxsize=250_000)
def _words(text: str) -> frozenset[str]:
    return frozenset(re.findall(r"[a-z0-9_]{3,}", text.lower()))


def _shared(first: str, second: str) -> float:
    one, two = _words(first), _words(second)
    return len(one & two) / len(one | two) if one and two else 0.0
