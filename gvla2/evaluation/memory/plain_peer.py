"""The plain peer: JSON lines, every record read and compared with difflib, as in the paper's released code.

Rewritten after that code's behaviour, with the same order of cost and every advantage that keeps it so: plain data
instead of validated models, words of a text looked up once, no file rewritten after a query, nothing flushed to disk.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields, replace
from difflib import SequenceMatcher
from functools import lru_cache
from pathlib import Path

from gvla2.memory.records import Record

FILE = "active.jsonl"
MATCH, MERGE, MERGE_WORDS, DISCARD, CONFLICT = 0.35, 0.80, 0.5, 0.95, 0.3
SIMILAR, CLUSTER, RETIRE_DAYS = 0.55, 3, 14.0
_PRIOR = {"verified_success": 0.30, "success": 0.25, "verified_fail": -0.10, "uncertain": -0.25}
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

    def retrieve(self, folder: Path, query: str, k: int, now: float) -> list[str]:
        """Read all, score all, sort all."""
        scored = []
        for record in self.load(folder):
            if record.outcome == "uncertain":
                continue
            age = max(now - record.created, 0.0) / 86400
            usage = min(math.log1p(record.usage) / 8, 0.2)
            stale = max(0.0, min(age / 365, 0.2) - usage / 2)
            if not record.outcome.endswith("success") and age > RETIRE_DAYS and not record.usage:
                stale = 0.25
            score = self.relevance(query, f"{record.query}\n{record.content}") + record.confidence
            score += _PRIOR.get(record.outcome, 0.05) + max(0.0, 0.25 - min(age / 90, 0.25)) + usage - stale
            scored.append((score, record.id))
        scored.sort(key=lambda pair: -pair[0])
        return [id for _, id in scored[:k]]

    def admit(self, folder: Path, lessons: Sequence[PeerLesson]) -> None:
        """The whole file is read and written again."""
        records = self.load(folder)
        for lesson in lessons:
            self._bring_in(lesson, records)
        self.fill(folder, records)

    def place(self, lesson: PeerLesson, records: list[PeerLesson]) -> str:
        """ADD, MERGE, REPLACE or DISCARD."""
        return self._decide(lesson, records)[0]

    def govern(self, records: list[PeerLesson], budget: int, now: float) -> int:
        """Retire, settle contradictions, summarise, cut to the budget: every record with every other."""
        kept = [
            r
            for r in records
            if r.outcome.endswith("success") or r.usage or now - r.created < RETIRE_DAYS * 86400
        ]
        kept.sort(key=lambda r: -self._worth(r, now))
        survivors: list[PeerLesson] = []
        for record in kept:
            if not any(
                other.type == record.type
                and _shared(other.content, record.content) >= SIMILAR - 0.1
                and self.contradict(other.content, record.content)
                for other in survivors
            ):
                survivors.append(record)
        clustered: set[str] = set()
        for kind in sorted({r.type for r in survivors}):
            group = [r for r in survivors if r.type == kind and r.outcome.endswith("success")]
            for record in group:
                if record.id in clustered:
                    continue
                alike = [
                    other
                    for other in group
                    if other.id != record.id
                    and other.id not in clustered
                    and self._similarity(record, other) >= SIMILAR
                ]
                if len(alike) + 1 >= CLUSTER and len({r.query for r in (record, *alike)}) > 1:
                    clustered |= {record.id, *(other.id for other in alike)}
        return min(sum(r.id not in clustered for r in survivors), budget)

    def contradict(self, first: str, second: str) -> bool:
        """One has a word of negation, the other none, and they share words."""
        negated = [bool(_all_words(text) & _NEGATIONS) for text in (first, second)]
        return negated[0] != negated[1] and _shared(first, second) >= CONFLICT

    def relevance(self, query: str, text: str) -> float:
        """Shared words, and difflib's ratio of the letters."""
        asked, said = _words(query), _words(text)
        if not asked or not said:
            return 0.0
        letters = SequenceMatcher(None, query.lower(), text.lower()).ratio()
        return 0.7 * len(asked & said) / len(asked | said) + 0.3 * letters

    def _bring_in(self, lesson: PeerLesson, records: list[PeerLesson]) -> None:
        action, best = self._decide(lesson, records)
        if action == "ADD" or best < 0:
            records.append(lesson)
        elif action == "MERGE":
            known = records[best]
            records[best] = replace(
                known,
                content=f"{known.content}\n{lesson.content}",
                confidence=max(known.confidence, lesson.confidence),
            )
        elif action == "REPLACE" and lesson.quality >= records[best].quality:
            records[best] = lesson

    def _decide(self, lesson: PeerLesson, records: Sequence[PeerLesson]) -> tuple[str, int]:
        best, score = -1, 0.0
        for place, record in enumerate(records):
            near = max(
                self.relevance(lesson.query, record.query),
                self.relevance(lesson.content, record.content),
                _shared(lesson.content, record.content),
            )
            if near > score:
                best, score = place, near
        if score < MATCH:
            return "ADD", -1
        content = records[best].content
        if self.contradict(lesson.content, content):
            return "REPLACE", best
        letters = SequenceMatcher(None, lesson.content, content).ratio()
        if letters >= DISCARD:
            return "DISCARD", best
        return (
            "MERGE" if letters >= MERGE or _shared(lesson.content, content) >= MERGE_WORDS else "ADD"
        ), best

    def _similarity(self, first: PeerLesson, second: PeerLesson) -> float:
        letters = SequenceMatcher(None, first.content.lower(), second.content.lower()).ratio()
        return max(
            self.relevance(first.query, second.query),
            self.relevance(first.content, second.content),
            _shared(first.content, second.content),
            0.8 * letters,
        )

    @staticmethod
    def _worth(record: PeerLesson, now: float) -> float:
        age = max(now - record.created, 0.0) / 86400
        worth = record.quality + record.confidence + (0.5 if record.outcome.endswith("success") else -0.3)
        return worth + min(0.1 * record.usage, 0.5) + max(0.0, 0.25 - min(age / 90, 0.25))


@lru_cache(maxsize=50_000)
def _all_words(text: str) -> frozenset[str]:
    return frozenset(re.findall(r"[a-z0-9_']+", text.lower()))


@lru_cache(maxsize=250_000)
def _words(text: str) -> frozenset[str]:
    return frozenset(re.findall(r"[a-z0-9_]{3,}", text.lower()))


def _shared(first: str, second: str) -> float:
    one, two = _words(first), _words(second)
    return len(one & two) / len(one | two) if one and two else 0.0
