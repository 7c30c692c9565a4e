"""What may enter a bank and in which state at best, how a lesson becomes a record that later episodes extend, and which
records contradict each other.

Decisions on plain data. Trust follows from the origin of a text, never from what it says about itself: a verified
episode of ours makes a text ours, and nothing else does. Typed effects are compared exactly; what free texts mean to
one another is unknown until a judge has decided (:mod:`gvla2.memory.review`).
"""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from numbers import Real
from typing import Any, TypeVar

from gvla2.errors import Gvla2Error, kept_alive
from gvla2.memory.contracts import Evidence, Lesson, MemoryEpisode, Verdict, Verifier
from gvla2.memory.options import BankOptions
from gvla2.memory.records import (
    MAX_PHRASINGS,
    MAX_QUERY,
    OUTCOMES,
    TYPES,
    LifecycleState,
    Record,
    Trust,
    clean,
    dedup_key,
    dump,
    finite,
    record_id,
    source_id,
)

log = logging.getLogger(__name__)

MAX_SOURCES = 32
LARGEST = 1e9
"""Upper limit of an effect's numbers, in any unit."""


def weigh(
    lesson: Lesson,
    verdict: Verdict,
    options: BankOptions | None = None,
    *,
    trust: Trust = "own",
    ungrounded: str = "",
) -> tuple[LifecycleState | None, str]:
    """The state of a lesson in the bank at best, None when it is not stored, and why.

    Verified lessons of ours may become active; foreign, uncertain and unjudged ones are provisional, and so is a
    model's lesson without evidence (``ungrounded`` says why). A failed episode teaches constraints, never recipes.
    ``options.admission`` False is the ablation that admits all lessons of ours; ``options.failures`` False learns
    nothing from failures.
    """
    options = options or BankOptions()
    if not lesson.content.strip():
        return None, "A lesson without words was left out."
    failed = verdict.outcome == "verified_fail"
    if not options.failures and (failed or lesson.type == "failure_avoidance"):
        return None, "Learning from failures is switched off."
    if failed and lesson.type != "failure_avoidance":
        return None, "A recipe from a failed episode was left out: failures only teach constraints."
    note = ungrounded
    if not note and trust != "own":
        note = "it comes from outside, and no episode of ours has confirmed it yet"
    elif not note and options.admission and verdict.outcome in ("uncertain", "unavailable"):
        note = f"the outcome {'is uncertain' if verdict.outcome == 'uncertain' else 'could not be judged'}"
    return "provisional" if note else "active", note


T = TypeVar("T")


def answer_of(call: Callable[[], T], wanted: type[T], instead: Callable[[str], T], who: str) -> T:
    """The answer of an untrusted component; what there is ``instead``, for a reason, if it raises or is not ``wanted``.

    ``who`` begins each sentence about the component: "The verifier 'mine' of plugin 'mine'".
    """
    try:
        with kept_alive():
            given = call()
    except Gvla2Error as error:
        return instead(str(error))
    except Exception as error:
        log.info("%s crashed.", who, exc_info=True)
        return instead(f"{who} crashed: {type(error).__name__}: {error}")
    if not isinstance(given, wanted):
        return instead(f"{who} returned {type(given).__name__}, not a {wanted.__name__}.")
    return given


def verdict_of(verifier: Verifier, evidence: Evidence, name: str = "", who: str = "") -> Verdict:
    """The verifier's verdict; ``unavailable``, with the reason, if it raises or returns anything else.

    ``name`` is the verifier's in that verdict; without ``who`` its class is named. Whether scores lie in [0, 1] is for
    :func:`credible`.
    """
    who = who or f"The verifier '{name or type(verifier).__name__}'"

    def unavailable(reason: str) -> Verdict:
        return Verdict.unavailable(reason, name)

    given = answer_of(lambda: verifier.verify(evidence), Verdict, unavailable, who)
    numbers = (given.quality, given.confidence, *dict(given.criteria).values())
    if given.outcome not in OUTCOMES or not all(isinstance(number, Real) for number in numbers):
        known = f"outcomes are {', '.join(OUTCOMES)}, and scores are numbers"
        return unavailable(f"{who} returned an invalid verdict ({given!r:.200}): {known}.")
    return given


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
    due = Verdict.from_criteria({"R": min(max(verdict.quality, 0.0), 1.0)}).outcome
    if {verdict.outcome, due} == {"verified_success", "verified_fail"}:
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


def new_record(
    bank: str,
    lesson: Lesson,
    episode: MemoryEpisode,
    verdict: Verdict,
    now: float,
    *,
    state: LifecycleState = "active",
    note: str = "",
    trust: Trust = "own",
    key: str = "",
) -> Record:
    """The record, of version 0, of a lesson that is new to the bank; its dedup ``key`` follows from the lesson."""
    key = key or dedup_key(lesson.type, lesson.content, episode.task.skill, lesson.effect)
    judged = verdict.outcome != "unavailable"
    verifier = {
        "verifier": verdict.verifier[:64],
        "criteria": finite(verdict.criteria),
        "reasons": [reason[:300] for reason in verdict.reasons[:8]],
    }
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
        verifier=dump(verifier),
        skill=clean(episode.task.skill, 64),
        effect=dump(dict(lesson.effect)) if lesson.effect else "",
        provenance=provenance(None, episode),
        note=note,
        trust=trust,
    )


def restarted(old: Record, fresh: Record, episode: MemoryEpisode) -> Record:
    """Verified evidence in place of unverified evidence; the record keeps its id, age, text and phrasings."""
    kept = {
        name: getattr(old, name)
        for name in ("id", "content", "created", "used", "usage", "recalled", "version", "rev")
    }
    query = phrasings(old.query, episode.task.query)
    return replace(fresh, **kept, query=query, provenance=provenance(old, episode))


def confirmed(record: Record, fresh: Record, episode: MemoryEpisode, verdict: Verdict, now: float) -> Record:
    """The record after one more episode, whose own record would be ``fresh``, confirms it."""
    quality, confidence = record.quality, record.confidence
    if verdict.outcome != "unavailable":
        quality, confidence = pooled_quality(record.quality, record.count, verdict.quality)
    effect = pooled_effects(record.effect_json(), fresh.effect_json())
    return replace(
        record,
        quality=quality,
        confidence=confidence,
        effect=dump(effect) if effect else "",
        verifier=fresh.verifier,
        query=phrasings(record.query, episode.task.query),
        provenance=provenance(record, episode),
        count=record.count + 1,
        updated=now,
    )


def warns(record: Record) -> bool:
    """Whether a record is a constraint that a verified failure supports."""
    return record.outcome == "verified_fail" and record.type == "failure_avoidance"


def evidence(record: Record) -> float:
    """The evidence for a record: quality R times its episodes; the worse its episode, the better a constraint."""
    support = 1.0 - record.quality if warns(record) else record.quality
    return round(support * max(record.count, 1), 6)


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
        source = source_id(episode.source)
        sources = [other for other in sources if other != source] + [source]
    made_by = {str(k)[:64]: str(v)[:200] for k, v in episode.provenance.items()}
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


def conflict_of(first: Record, second: Record) -> str:
    """How the typed effects of two records contradict each other, "" if they don't or there are none."""
    if not (first.effect and second.effect) or (first.skill and second.skill and first.skill != second.skill):
        return ""
    return effects_conflict(first.effect_json() or {}, second.effect_json() or {})


def effects_conflict(first: Mapping[str, Any], second: Mapping[str, Any]) -> str:
    """How two typed effects contradict each other, "" if they don't.

    Disjoint bounds; means too far apart for their deviations (or by half, for single successes without any); a
    parameter both forbidden and successful. Two programs never do: there are many ways to succeed.
    """
    kinds = (first.get("kind"), second.get("kind"))
    if "program" in kinds or not _same_parameter(first, second):
        return ""
    name = str(first.get("parameter"))
    if "forbid" in kinds:
        return f"{name} is forbidden and succeeded" if "prior" in kinds else ""
    try:
        a, b = float(first.get("value", math.nan)), float(second.get("value", math.nan))
        deviations = [float(effect.get("sd", 0.0)) for effect in (first, second)]
        counts = [max(int(effect.get("count", 1)), 1) for effect in (first, second)]
    except (TypeError, ValueError, OverflowError):
        return ""
    if not all(map(math.isfinite, (a, b, *deviations))):
        return ""
    scale = max(abs(a), abs(b))
    if kinds == ("bound", "bound"):
        ops = (first.get("op", ">="), second.get("op", ">="))
        low, high = (a, b) if ops[0] == ">=" else (b, a)
        if set(ops) == {">=", "<="} and low - high > 1e-9 * scale:
            return f"{name} at least {low:.4g} against at most {high:.4g}"
    if kinds == ("prior", "prior"):
        squares = sum((n - 1) * sd**2 for n, sd in zip(counts, deviations, strict=True))
        pooled = math.sqrt(squares / max(sum(counts) - 2, 1))
        if abs(a - b) > max(3.0 * pooled, (0.5 if min(counts) < 3 else 0.25) * scale):
            return f"{name} {a:.4g} against {b:.4g}"
    return ""


def _same_parameter(first: Mapping[str, Any], second: Mapping[str, Any]) -> bool:
    """Whether both are about one parameter of one skill and object, if given; metres and shares of a side are not
    comparable.
    """
    if any(str(first.get(name) or "") != str(second.get(name) or "") for name in ("parameter", "scale")):
        return False
    given = [(first.get(name), second.get(name)) for name in ("skill", "object")]
    return all(not mine or not theirs or mine == theirs for mine, theirs in given)
