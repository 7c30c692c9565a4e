"""How a record is made from a lesson, and how later episodes extend it: pooled evidence, and phrasings."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from gvla2.memory.contracts import MemoryEpisode, Verdict
from gvla2.memory.curation.admission import Weighed
from gvla2.memory.curation.trust import LEVELS
from gvla2.memory.records import MAX_PHRASINGS, MAX_QUERY, Record, clean, dump, finite, record_id

MAX_SOURCES = 32


def new_record(bank: str, candidate: Weighed, episode: MemoryEpisode, verdict: Verdict, now: float) -> Record:
    """The record, of version 0, of a lesson that is new to the bank."""
    lesson, key = candidate.lesson, candidate.key
    judged = verdict.outcome != "unavailable"
    told = {
        "verifier": clean(verdict.verifier, 64),
        "criteria": finite(verdict.criteria),
        "reasons": [clean(reason, 300) for reason in verdict.reasons[:8]],
    }
    return Record(
        id=record_id(lesson.type, bank, key),
        bank=bank,
        query=phrasings("", episode.task.query),
        content=lesson.content,
        type=lesson.type,
        state=candidate.state or "provisional",
        outcome=verdict.outcome,
        confidence=verdict.confidence if judged else 0.0,
        quality=verdict.quality if judged else 0.5,
        dedup_key=key,
        created=now,
        updated=now,
        verifier=dump(told),
        signature=dump(finite(episode.task.signature)),
        skill=clean(episode.task.skill, 64),
        effect=dump(dict(lesson.effect)) if lesson.effect else "",
        provenance=provenance(None, episode),
        trust=candidate.trust,
    )


def restarted(old: Record, fresh: Record, episode: MemoryEpisode) -> Record:
    """Verified evidence in place of unverified evidence; the record keeps its id, age and phrasings."""
    kept = {name: getattr(old, name) for name in ("id", "dedup_key", "created", "used", "usage", "recalled")}
    query = phrasings(old.query, episode.task.query)
    told = provenance(old, episode)
    return replace(fresh, **kept, query=query, provenance=told, version=old.version, rev=old.rev)


def confirmed(record: Record, fresh: Record, episode: MemoryEpisode, verdict: Verdict, now: float) -> Record:
    """The record after one more episode, whose own record would be ``fresh``, confirms it."""
    quality, confidence = record.quality, record.confidence
    if verdict.outcome != "unavailable":
        quality, confidence = pooled_quality(record.quality, record.count, verdict.quality)
    effect = pooled_effects(record.effect_json(), fresh.effect_json())
    signature = dict(fresh.signature_json())
    for name, value in record.signature_json().items():
        signature[name] = (value * record.count + signature.get(name, value)) / (record.count + 1)
    return replace(
        record,
        quality=quality,
        confidence=confidence,
        effect=dump(effect) if effect else "",
        signature=dump(signature),
        verifier=fresh.verifier,
        query=phrasings(record.query, episode.task.query),
        provenance=provenance(record, episode),
        count=record.count + 1,
        updated=now,
    )


def counted(record: Record, episode: MemoryEpisode) -> bool:
    """Whether the record already rests on the episode, which counts only once."""
    return bool(episode.source) and clean(episode.source, 200) in record.sources()


def repeated(record: Record, fresh: Record) -> Record:
    """The record after an episode that it rests on repeats it: no more weight, but a tighter bound applies."""
    effect = record.effect_json()
    if not effect or effect.get("kind") != "bound":
        return record
    return replace(record, effect=dump(pooled_effects(effect, fresh.effect_json())))


def warns(record: Record) -> bool:
    """Whether a record is a constraint that a verified failure supports."""
    return record.outcome == "verified_fail" and record.type == "failure_avoidance"


def support(record: Record) -> float:
    """Quality R of what a record says, in [0, 1]: the worse its episode, the better a constraint."""
    return 1.0 - record.quality if warns(record) else record.quality


def evidence(record: Record) -> float:
    """The evidence for a record: its support times its episodes."""
    return round(support(record) * max(record.count, 1), 6)


def standing(record: Record) -> tuple[int, float, float, str]:
    """Sort key of contradicting records, of which the first stays: trust, evidence, then the later one, then ids."""
    return -LEVELS.index(record.trust), -evidence(record), -record.updated, record.id


def phrasings(known: str, query: str) -> str:
    """Distinct instructions, one per line, the first ones kept, so that other phrasings find the record too."""
    lines = [line for line in known.split("\n") if line]
    for part in query.split("\n") if known else [query]:
        new = " ".join(clean(part, MAX_QUERY).split())
        if new and new not in lines and len(lines) < MAX_PHRASINGS:
            lines.append(new)
    return "\n".join(lines)


def provenance(known: Record | None, episode: MemoryEpisode) -> str:
    """Its maker, and its sources including this episode; other entries stay."""
    others = known.provenance_json() if known is not None else {}
    sources = list(known.sources()) if known is not None else []
    if episode.source:
        source = clean(episode.source, 200)
        sources = [other for other in sources if other != source] + [source]
    made_by = {clean(str(k), 64): clean(str(v), 200) for k, v in episode.provenance.items()}
    return dump({**others, "made_by": made_by, "sources": sources[-MAX_SOURCES:]})


def pooled_quality(quality: float, count: int, new: float) -> tuple[float, float]:
    """Mean quality R over all episodes that say the same, and its confidence 2|R - .5|."""
    mean = (quality * count + new) / (count + 1)
    return mean, 2 * abs(mean - 0.5)


Effect = Mapping[str, Any] | None


def pooled_effects(first: Effect, second: Effect) -> dict[str, Any] | None:
    """Two effects on the same parameter as one, as JSON.

    Priors pool mean, deviation and count (parallel variance); the tighter of two bounds applies; a ban stays, and so
    does a program. If numbers are absent the first one stays.
    """
    if not first or not second:
        return dict(second or first or {}) or None
    kind = first.get("kind")
    if kind != second.get("kind") or (first.get("scale") or "") != (second.get("scale") or ""):
        return dict(second)
    try:
        if kind == "bound":
            tightest = max if second.get("op", ">=") == ">=" else min
            return {**second, "value": tightest(float(first["value"]), float(second["value"]))}
        if kind == "prior":  # mean and sample deviation of both groups together (Chan et al., 1983)
            n, m = max(int(first.get("count", 1)), 1), max(int(second.get("count", 1)), 1)
            a, b = float(first["value"]), float(second["value"])
            squares = (n - 1) * float(first.get("sd", 0.0)) ** 2 + (m - 1) * float(second.get("sd", 0.0)) ** 2
            squares += (b - a) ** 2 * n * m / (n + m)
            deviation = math.sqrt(squares / (n + m - 1))
            return {**second, "value": (a * n + b * m) / (n + m), "sd": deviation, "count": n + m}
    except (KeyError, TypeError, ValueError):
        return dict(first)
    return dict(first if kind == "program" else second)
