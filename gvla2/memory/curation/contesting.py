"""Whether two lessons contradict each other, or are one."""

from __future__ import annotations

from dataclasses import dataclass

from gvla2.memory.curation.likeness import about, jaccard, same_subject, surface
from gvla2.memory.meaning.conflicts import Said, conflict
from gvla2.memory.records import Record

SUSPECT = 0.5


@dataclass(frozen=True)
class Compared:
    """How two typed effects contradict each other ("" for not), and how likely two texts do, None for no telling."""

    effect: str = ""
    suspicion: float | None = None


def compare(first: Record, second: Record) -> Compared:
    """Compare two records."""
    found = conflict(_said(first), _said(second))
    if found is None:
        return Compared()
    return Compared(found.why) if first.effect and second.effect else Compared("", 1.0)


def same_lesson(first: Record, second: Record) -> bool:
    """Whether two records say the same."""
    if not same_subject(first, second):
        return False
    concepts = jaccard(about(first.content).items, about(second.content).items)
    return surface(first.content, second.content) >= 0.8 or concepts >= 0.5


def _said(record: Record) -> Said:
    return Said(record.record_type, record.content, record.skill, record.effect_json(), record.query)
