"""How a record is made of a lesson, and how it grows by what later episodes say."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gvla2.memory.contracts import Lesson, LifecycleState, MemoryEpisode, Verdict
from gvla2.memory.curation.admission import Streak, repeats
from gvla2.memory.curation.merging import merge_effects, merge_quality, merge_signatures
from gvla2.memory.records import MAX_PHRASINGS, MAX_QUERY, Record, clean, dump, finite, record_id

MAX_SOURCES = 32
SUMMED_UP = "summed up in "
"""How the note of an archived record begins whose words a summary tells."""


def new_record(
    bank: str,
    lesson: Lesson,
    state: LifecycleState,
    key: str,
    episode: MemoryEpisode,
    verdict: Verdict,
    now: float,
    streak: Streak | None = None,
) -> Record:
    """The record of a lesson that the bank does not know, of version 0."""
    judged = verdict.outcome != "unavailable"
    return Record(
        id=record_id(lesson.type, bank, key),
        bank=bank,
        query=phrasings("", episode.task.query),
        content=lesson.content,
        type=lesson.type,
        state=state,
        outcome=verdict.outcome,
        confidence=verdict.confidence if judged else 0.0,
        quality=verdict.quality if judged else 0.5,
        dedup_key=key,
        created=now,
        updated=now,
        verifier=verifier_json(verdict, streak),
        signature=dump(finite(episode.task.signature)),
        skill=clean(episode.task.skill, 64),
        effect=dump(dict(lesson.effect)) if lesson.effect else "",
        provenance=provenance(None, episode),
    )


def restarted(old: Record, fresh: Record, episode: MemoryEpisode) -> Record:
    """Verified evidence in place of unverified evidence; the record keeps its id, age and phrasings.

    Save those that its text only repeats: a copy of a likely question is not to be found by it.
    """
    lines = old.query.split("\n")
    if not fresh.effect:
        lines = [line for line in lines if not repeats(fresh.content, line)]
    return replace(
        fresh,
        id=old.id,
        dedup_key=old.dedup_key,
        query=phrasings("\n".join(lines), episode.task.query),
        created=old.created,
        used=old.used,
        usage=old.usage,
        recalled=old.recalled,
        provenance=provenance(old, episode),
        version=old.version,
        rev=old.rev,
    )


def confirmed(record: Record, fresh: Record, episode: MemoryEpisode, verdict: Verdict, now: float) -> Record:
    """One more episode, whose record would be ``fresh``, says what the record says: pooled evidence."""
    quality, confidence = record.quality, record.confidence
    if verdict.outcome != "unavailable":
        quality, natural = merge_quality(record.quality, record.count, verdict.quality)
        confidence = natural
        if verdict.confidence < 2 * abs(verdict.quality - 0.5) - 1e-9:
            # A verifier that is trusted less than its verdict says adds no more than it is trusted.
            pooled = (record.confidence * record.count + verdict.confidence) / (record.count + 1)
            confidence = min(natural, pooled)
    effect = merge_effects(record.effect_json(), fresh.effect_json())
    return replace(
        record,
        quality=quality,
        confidence=confidence,
        effect=dump(effect) if effect else "",
        signature=dump(merge_signatures(record.signature_json(), record.count, fresh.signature_json())),
        verifier=fresh.verifier,
        query=phrasings(record.query, episode.task.query),
        provenance=provenance(record, episode),
        count=record.count + 1,
        updated=now,
    )


def counted(record: Record, episode: MemoryEpisode) -> bool:
    """Whether the episode is among those that the record rests on already: its word counts once."""
    return bool(episode.source) and clean(episode.source, 200) in record.sources()


def repeated(record: Record, fresh: Record) -> Record:
    """The record after an episode that it rests on says it again: it weighs no more, but a tighter bound holds."""
    effect = record.effect_json()
    if not effect or effect.get("kind") != "bound":
        return record
    return replace(record, effect=dump(merge_effects(effect, fresh.effect_json())))


def moved(old: NDArray[np.float32] | None, count: int, new: NDArray[np.float32]) -> NDArray[np.float32]:
    """(D,) unit mean direction of a record of ``count`` episodes and of one more."""
    if old is None or old.shape != new.shape or not np.isfinite(old).all():
        return new
    total = old.astype(np.float64) * count + new
    length = float(np.linalg.norm(total))
    return (total / length).astype(np.float32) if length > 0 else new


def phrasings(known: str, query: str) -> str:
    """Distinct instructions, one a line, the first ones kept: other words for the same find the record too."""
    lines = [line for line in known.split("\n") if line]
    for part in query.split("\n") if known else [query]:
        new = " ".join(clean(part, MAX_QUERY).split())
        if new and new not in lines and len(lines) < MAX_PHRASINGS:
            lines.append(new)
    return "\n".join(lines)


def verifier_json(verdict: Verdict, streak: Streak | None) -> str:
    """What the verifier said, as a column."""
    said: dict[str, object] = {
        "verifier": clean(verdict.verifier, 64),
        "criteria": finite(verdict.criteria),
        "reasons": [clean(reason, 300) for reason in verdict.reasons[:8]],
    }
    if streak is not None and streak.length:
        said["streak"] = {"length": streak.length, "criteria": dict(streak.criteria)}
    return dump(said)


def provenance(known: Record | None, episode: MemoryEpisode) -> str:
    """Who made it, and the sources up to now with this episode's; what else was noted there stays."""
    sources: list[str] = []
    others: dict[str, Any] = {}
    try:
        if known is not None:
            sources, others = list(known.sources()), known.provenance_json()
    except (ValueError, TypeError, AttributeError):
        sources, others = [], {}
    if episode.source:
        source = clean(episode.source, 200)
        sources = [other for other in sources if other != source] + [source]
    made_by = {clean(str(k), 64): clean(str(v), 200) for k, v in episode.provenance.items()}
    return dump({**others, "made_by": made_by, "sources": sources[-MAX_SOURCES:]})
