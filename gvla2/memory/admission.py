"""What may enter a bank and in which state at best, and how a lesson becomes a record that later episodes extend.

Decisions on plain data. Trust follows from the origin of a text, never from what it says about itself: a verified
episode of ours makes a text ours, and nothing else does.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gvla2.memory.contracts import Lesson, MemoryEpisode, Verdict
from gvla2.memory.options import BankOptions
from gvla2.memory.records import (
    MAX_PHRASINGS,
    MAX_QUERY,
    TYPES,
    LifecycleState,
    Record,
    Trust,
    clean,
    dump,
    finite,
    record_id,
)

FAILED, SUCCEEDED = 0.35, 0.70
"""A quality R up to the first is a verified failure, from the second on a verified success."""
MAX_SOURCES = 32
LARGEST = 1e9
"""Upper limit of an effect's numbers, in any unit."""


@dataclass(frozen=True)
class Weighed:
    """A weighed lesson: its ``state`` in the bank at best, or None when it is not stored; ``note`` says why.

    ``trust`` is that of its origin. Its dedup ``key`` and unit ``vector`` (D,) are added on storing.
    """

    lesson: Lesson
    state: LifecycleState | None
    note: str = ""
    trust: Trust = "own"
    key: str = ""
    vector: NDArray[np.float32] = field(default_factory=lambda: np.zeros(0, np.float32))


def weigh(
    lesson: Lesson,
    verdict: Verdict,
    options: BankOptions | None = None,
    *,
    trust: Trust = "own",
    ungrounded: str = "",
) -> Weighed:
    """Decide on one lesson.

    Verified lessons of ours may become active; foreign, uncertain and unjudged ones are provisional, and so is a
    model's lesson without evidence (``ungrounded`` says why). A failed episode teaches constraints, never recipes.
    ``options.admission`` False is the ablation that admits all lessons of ours; ``options.failures`` False learns
    nothing from failures.
    """
    options = options or BankOptions()
    if not lesson.content.strip():
        return Weighed(lesson, None, "A lesson without words was left out.")
    failed = verdict.outcome == "verified_fail"
    if not options.failures and (failed or lesson.type == "failure_avoidance"):
        return Weighed(lesson, None, "Learning from failures is switched off.")
    if failed and lesson.type != "failure_avoidance":
        why = "A recipe from a failed episode was left out: failures only teach constraints."
        return Weighed(lesson, None, why)
    note = ungrounded
    if not note and trust != "own":
        note = "it comes from outside, and no episode of ours has confirmed it yet"
    elif not note and options.admission and verdict.outcome in ("uncertain", "unavailable"):
        note = f"the outcome {'is uncertain' if verdict.outcome == 'uncertain' else 'could not be judged'}"
    return Weighed(lesson, "provisional" if note else "active", note, trust)


def credible(verdict: Verdict) -> tuple[Verdict, str]:
    """The verdict as far as it is valid, and a note on what was wrong with it.

    Scores outside [0, 1] make it unavailable. An outcome that contradicts its own score R (a success of R <= .35, a
    failure of R >= .70) is uncertain.
    """
    if verdict.outcome == "unavailable":
        return verdict, ""
    who = f"The verifier '{verdict.verifier or 'unnamed'}'"
    scores = (verdict.quality, verdict.confidence, *verdict.criteria.values())
    if not all(-1e-6 <= score <= 1 + 1e-6 for score in scores):  # nor is NaN
        note = f"{who} gave scores that are not in [0, 1]: its verdict counts as unavailable."
        return Verdict.unavailable(note, verdict.verifier), note
    refuted = {"verified_success": verdict.quality <= FAILED, "verified_fail": verdict.quality >= SUCCEEDED}
    if refuted.get(verdict.outcome):
        claim = f"{verdict.outcome} with R = {verdict.quality:.2f}"
        return replace(verdict, outcome="uncertain"), f"{who} said {claim}: its verdict counts as uncertain."
    return verdict, ""


def invalid(lesson: Lesson) -> str:
    """Why a lesson of any origin cannot be stored; "" if it can."""
    if lesson.type not in TYPES:
        return f"there is no type '{lesson.type}', only {', '.join(TYPES)}"
    if why := invalid_json(lesson.effect):
        return f"its effect is not valid JSON ({why})"
    for name, lowest in (("value", -LARGEST), ("sd", 0.0), ("count", 0.0)):
        number = (lesson.effect or {}).get(name, lowest)
        if not isinstance(number, int | float) or not lowest <= number <= LARGEST:
            return f"its effect has {name} {str(number)[:40]}"
    return ""


def invalid_json(data: Any) -> str:
    """Why data cannot be stored as JSON, "" if it can."""
    try:
        dump(dict(data or {})).encode()
    except (TypeError, ValueError, RecursionError) as error:
        return str(error)
    return ""


def new_record(bank: str, candidate: Weighed, episode: MemoryEpisode, verdict: Verdict, now: float) -> Record:
    """The record, of version 0, of a lesson that is new to the bank."""
    lesson, key = candidate.lesson, candidate.key
    judged = verdict.outcome != "unavailable"
    verifier = {
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
        verifier=dump(verifier),
        signature=dump(finite(episode.task.signature)),
        skill=clean(episode.task.skill, 64),
        effect=dump(dict(lesson.effect)) if lesson.effect else "",
        provenance=provenance(None, episode),
        trust=candidate.trust,
    )


def restarted(old: Record, fresh: Record, episode: MemoryEpisode) -> Record:
    """Verified evidence in place of unverified evidence; the record keeps its id, age, text and phrasings."""
    kept = {
        name: getattr(old, name)
        for name in ("id", "content", "dedup_key", "created", "used", "usage", "recalled", "version", "rev")
    }
    query = phrasings(old.query, episode.task.query)
    return replace(fresh, **kept, query=query, provenance=provenance(old, episode))


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
    """Sort key of contradicting records: the first one stays, by trust, evidence, then the later one, then ids."""
    return int(record.trust != "own"), -evidence(record), -record.updated, record.id


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
