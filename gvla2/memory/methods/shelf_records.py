"""The records that stand on a shelf: how a lesson of an entry is kept, and how it grows when it is learnt again."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, replace

from gvla2.memory.contracts import Lesson, MemoryEpisode, Verdict
from gvla2.memory.curation.merging import merge_effects, merge_quality
from gvla2.memory.records import Record, clean, dump, finite, record_id

MAX_PHRASINGS = 8
MAX_SOURCES = 32
MAX_QUERY = 4000
LONGEST = 100_000


@dataclass(frozen=True)
class Draft:
    """An entry to be kept: its ``lessons``, the leading one first.

    Drafts of the same ``key`` are one entry, whose evidence is pooled; "" makes an entry of its own each time.
    """

    lessons: tuple[Lesson, ...]
    key: str = ""


def fresh(
    bank: str,
    name: str,
    place: int,
    key: str,
    lesson: Lesson,
    episode: MemoryEpisode,
    verdict: Verdict,
    now: float,
) -> Record:
    """The record of a lesson at ``place`` of the entry ``name``; ``key`` tells it from all others."""
    judged = verdict.outcome != "unavailable"
    made_by = {clean(str(k), 64): clean(str(v), 200) for k, v in episode.provenance.items()}
    return Record(
        id=record_id(lesson.type, bank, key),
        bank=bank,
        query=phrasings("", episode.task.query),
        content=clean(lesson.content, LONGEST),
        type=lesson.type,
        state="active",
        outcome=verdict.outcome,
        confidence=verdict.confidence if judged else 0.0,
        quality=verdict.quality if judged else 0.5,
        dedup_key=key,
        created=now,
        updated=now,
        verifier=dump({"verifier": clean(verdict.verifier, 64), "criteria": finite(verdict.criteria)}),
        signature=dump(finite(episode.task.signature)),
        skill=clean(episode.task.skill, 64),
        effect=dump(dict(lesson.effect)) if lesson.effect else "",
        provenance=dump(
            {
                "made_by": made_by,
                "sources": [clean(episode.source, 200)] if episode.source else [],
                "entry": name,
                "place": place,
            }
        ),
    )


def grown(known: Record, lesson: Lesson, episode: MemoryEpisode, verdict: Verdict, now: float) -> Record:
    """One more episode has led to the same entry."""
    quality, confidence = known.quality, known.confidence
    if verdict.outcome != "unavailable":
        quality, confidence = merge_quality(known.quality, known.count, verdict.quality)
    effect = merge_effects(known.effect_json(), lesson.effect)
    provenance = known.provenance_json()
    sources = [*known.sources(), clean(episode.source, 200)] if episode.source else known.sources()
    provenance["sources"] = list(dict.fromkeys(sources))[-MAX_SOURCES:]
    return replace(
        known,
        query=phrasings(known.query, episode.task.query),
        quality=quality,
        confidence=confidence,
        count=known.count + 1,
        effect=dump(effect) if effect else "",
        provenance=dump(provenance),
        updated=max(known.updated, now),
    )


def phrasings(known: str, query: str) -> str:
    """Distinct instructions, one a line, the first ones kept."""
    new = " ".join(clean(query, MAX_QUERY).split())
    lines = [line for line in known.split("\n") if line]
    return "\n".join(lines if not new or new in lines or len(lines) >= MAX_PHRASINGS else [*lines, new])


def home_of(record: Record) -> tuple[str, int] | None:
    """The entry that a record belongs to and its place in it; None for a record that no shelf has put there."""
    try:
        provenance: Mapping[str, object] = json.loads(record.provenance)
        name, place = provenance["entry"], provenance["place"]
    except (ValueError, KeyError, TypeError):
        return None
    return (name, place) if isinstance(name, str) and isinstance(place, int) else None


def digest(text: str) -> str:
    """A short key of a text."""
    return hashlib.blake2b(text.encode("utf-8", "surrogatepass"), digest_size=16).hexdigest()
