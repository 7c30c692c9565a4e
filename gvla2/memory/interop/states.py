"""A record as one line of JSON: the fields of the released code, and under ``gvla2`` whatever it has no field for.

Lines are untrusted: a broken one is reported, the others are read.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any

from gvla2.errors import Gvla2Error
from gvla2.memory.contracts import TYPES, LifecycleState, Outcome, RecordType
from gvla2.memory.curation.summaries import summary_of
from gvla2.memory.curation.trust import LEVELS, Origin, believed, trust_of
from gvla2.memory.injection_patterns import screen
from gvla2.memory.records import Record, clean, dedup_key, dump, finite, load_object, record_id

STATES: tuple[LifecycleState, ...] = ("active", "provisional", "summary", "archive")
"""The lifecycle states in the order of their files."""
LONGEST_TEXT = 100_000
"""Characters of a field."""
_TEXTS = (
    "memory_id", "content", "query", "task_id", "state", "memory_type", "verifier_label", "verifier_model"
)  # fmt: skip
_LINE_ENDS = {0x85: "\\u0085", 0x2028: "\\u2028", 0x2029: "\\u2029"}
_LINKS = {"replaces": "supersedes", "conflict": "conflicts_with"}
"""The released code's fields for kinds of links; the others are under ``gvla2``."""
_SPELT: Mapping[Outcome, str] = {
    "verified_success": "success succeeded verified_success pass passed true",
    "verified_fail": "fail failed failure verified_fail verified_failure false",
    "uncertain": "uncertain unknown unverified none",
    "unavailable": "unavailable",
}
"""Every spelling of a status that the releases have used; none at all is uncertain."""
_OUTCOMES = {word: outcome for outcome, words in _SPELT.items() for word in words.split()}
_QUALITIES: Mapping[Outcome, float] = {"verified_success": 0.8, "verified_fail": 0.2}
"""Quality R of a line that has a verdict and no score, else .5; its confidence follows as 2|R - .5|."""


class LineError(Gvla2Error):
    """A line that is not a record; the message says why."""


@dataclass(frozen=True)
class ReadRecord:
    """A parsed line: a record, its ``key`` in its source, ``links`` by kind to others' keys, and ``notes`` on it."""

    key: str
    record: Record
    links: Mapping[str, Sequence[str]]
    notes: tuple[str, ...]


def parse(raw: bytes) -> dict[str, Any]:
    """One JSON object; raises :class:`LineError` for anything else, NaN and infinities included."""
    try:
        return load_object(raw.decode("utf-8-sig", "surrogatepass").strip())
    except UnicodeDecodeError as error:
        raise LineError(f"it is not UTF-8 (byte {error.start})") from error
    except (ValueError, RecursionError) as error:
        raise LineError(f"it is not a JSON object: {str(error)[:100]}") from error


def to_bytes(rows: Iterable[Mapping[str, Any]]) -> bytes:
    """A whole file, in the released code's format.

    Unicode's own line ends are escaped: the released readers would cut the line there.
    """
    texts = (json.dumps(row, ensure_ascii=False, allow_nan=False).translate(_LINE_ENDS) for row in rows)
    return "".join(f"{text}\n" for text in texts).encode()


def read_record(fields: Mapping[str, Any], file: str, bank: str, now: float, origin: Origin) -> ReadRecord:
    """The record of a line for ``bank``; raises :class:`LineError` when it has no id or content.

    The ``file``'s name gives the state, else the line's own field; but a record not believed by its ``origin`` is
    provisional, whatever the line says. Of links under ``gvla2`` it then has only those that forgetting follows, and no
    note, sources, or summary's wordings.
    """
    told, notes = {name: _text(fields, name) for name in _TEXTS}, list[str]()
    for name in ("memory_id", "content"):
        if not told[name].strip():
            raise LineError(f"'{name}' is missing or empty")
    words = (file.removesuffix(".jsonl"), told["state"])
    state = next((state for word in words for state in STATES if state == word), None)
    if state is None:
        raise LineError(f"neither the file's name nor 'state' ('{words[1]}') is one of {', '.join(STATES)}")
    said = told["verifier_label"] or fields.get("source_status")
    status = "" if said is None else str(said)
    outcome = _OUTCOMES.get(status.strip().casefold(), "uncertain")
    if status.strip().casefold() not in {"", *_OUTCOMES}:
        notes.append(f"its status '{status[:40]}' is not known, it was read as {outcome}")
    called = told["memory_type"]
    kind: RecordType = next((known for known in TYPES if known == called), "procedural_hint")
    if called not in ("", kind):
        notes.append(f"its type '{called}' is not known, it was read as {kind}")
    if outcome == "verified_fail" and kind == "procedural_hint":
        kind = "failure_avoidance"  # a recipe from a failure is a thing to avoid
    key_there, content, query = told["memory_id"][:1000], told["content"], told["query"]
    quality = number(fields.get("quality_score"), 0.0, 1.0)
    quality = _QUALITIES.get(outcome, 0.5) if quality is None else quality
    confidence = number(fields.get("confidence"), 0.0, 1.0)
    ours = _mapping(fields, "gvla2")
    vouched = ours if origin.own else {}
    outcome = "unavailable" if (outcome, ours.get("outcome")) == ("uncertain", "unavailable") else outcome
    effect, skill = _mapping(ours, "effect"), clean(str(ours.get("skill") or ""), 64)
    summed = clean(str(vouched.get("summary_key", "")), 64)
    key = summed or dedup_key(kind, content, skill, effect)
    screened = screen(f"{query}\n{content}")
    trust = trust_of([origin], screened=bool(screened))
    if vouched.get("trust") in LEVELS:
        trust = min(trust, vouched["trust"], key=LEVELS.index)
    note = clean(str(vouched.get("note", "")), 1000)
    if not believed(trust) and state != "archive":
        state, note = "provisional", screened or "it was imported, and is not yet confirmed here"
    created, used = _when(fields.get("created_at")), min(_when(fields.get("last_used_at")) or 0.0, now)
    created = now if created is None else min(created, now)
    usage = count(fields.get("use_count"))
    criteria, task = _numbers(_mapping(fields, "verifier_criteria")), told["task_id"][:200]
    provenance = {"made_by": {"import": "states"}, "sources": [task] if task else []}
    provenance |= _mapping(vouched, "provenance")
    record = Record(
        id=record_id("summary" if summed else kind, bank, key),
        bank=bank,
        query=query,
        content=content,
        type=kind,
        state=state,
        outcome=outcome,
        confidence=2 * abs(quality - 0.5) if confidence is None else confidence,
        quality=quality,
        dedup_key=key,
        created=created,
        updated=max(created, used),
        used=used,
        count=max(count(ours.get("count")), 1),
        usage=usage,
        recalled=max(usage, count(ours.get("recalled"))),
        verifier=dump({"verifier": told["verifier_model"], "criteria": criteria, "reasons": []}),
        signature=dump(_numbers(_mapping(ours, "signature"))),
        skill=skill,
        effect=dump(dict(effect)) if effect else "",
        provenance=dump({**provenance, "key": key_there}),
        note=note,
        trust=trust,
    )
    if state == "summary":
        summary_of([record], now)  # raises for wordings that are none
    links = {kind: _names(fields.get(name)) for kind, name in _LINKS.items()}
    for link, others in _mapping(ours, "links").items():
        if origin.own or link in ("merged", "summary_of"):
            links[clean(link, 64)] = _names(others)
    return ReadRecord(key_there, record, links, tuple(notes))


def write_record(record: Record, links: Mapping[str, Sequence[str]]) -> dict[str, Any]:
    """The fields of a line; ``links`` are the ids that the record has links to, by kind."""
    judged = record.outcome in ("verified_success", "verified_fail", "uncertain")
    verifier = record.verifier_json()
    return {
        "memory_id": record.id,
        "task_id": next(iter(record.sources()), ""),
        "query": record.query,
        "content": record.content,
        "memory_type": record.type,
        "source_status": record.outcome if judged else "uncertain",
        "state": record.state,
        "confidence": record.confidence,
        "quality_score": record.quality,
        "created_at": _date(record.created),
        "last_used_at": _date(record.used) if record.usage and record.used else None,
        "use_count": record.usage,
        "dedup_key": f"{record.type}:{record.id}",
        **{name: list(links.get(kind, ())) for kind, name in _LINKS.items()},
        "embedding": None,
        "verifier_score": record.quality if judged else None,
        "verifier_confidence": record.confidence if judged else None,
        "verifier_label": record.outcome if judged else None,
        "verifier_criteria": finite(verifier.get("criteria") or {}),
        "verifier_model": verifier.get("verifier") or None,
        "gvla2": {
            "skill": record.skill,
            "effect": record.effect_json(),
            "signature": record.signature_json(),
            "provenance": record.provenance_json(),
            "summary_key": record.dedup_key if record.id.startswith("summary-") else "",
            "links": {kind: list(told) for kind, told in links.items() if kind not in _LINKS},
            **{name: getattr(record, name) for name in ("count", "recalled", "trust", "outcome", "note")},
        },
    }


def _text(fields: Mapping[str, Any], name: str) -> str:
    """A text field, safe for a database; "" if it is absent or null. Numbers (ids) become their text.

    Raises :class:`LineError` when it is something else.
    """
    value = fields.get(name)
    if isinstance(value, int | float) and not isinstance(value, bool):
        value = str(value)
    if value is not None and not isinstance(value, str):
        raise LineError(f"'{name}' is not text")
    return clean(value or "", LONGEST_TEXT)


def _mapping(fields: Mapping[str, Any], name: str) -> Mapping[str, Any]:
    value = fields.get(name)
    return value if isinstance(value, Mapping) else {}


def _numbers(told: Mapping[str, Any]) -> dict[str, float]:
    """The entries that are numbers."""
    return {str(name): found for name, value in told.items() if (found := number(value)) is not None}


def _names(value: object) -> tuple[str, ...]:
    """A list of ids, without entries that are not text."""
    return tuple(clean(v, 1000) for v in value if isinstance(v, str)) if isinstance(value, list) else ()


def _when(value: object) -> float | None:
    """Seconds since the epoch of a number or an ISO date (UTC without a zone); None if it is neither."""
    if isinstance(value, str):
        try:
            date = datetime.fromisoformat(value.strip())
            value = (date if date.tzinfo else date.replace(tzinfo=UTC)).timestamp()
        except (ValueError, OverflowError):
            return None
    found = number(value)
    return found if found is not None and 0 <= found < 4e11 else None


def _date(seconds: float) -> str | None:
    """The ISO date in UTC; None for a time outside the calendar, as from a broken clock."""
    try:
        return datetime.fromtimestamp(seconds, UTC).isoformat()
    except (ValueError, OverflowError, OSError):
        return None


def number(value: object, low: float = -math.inf, high: float = math.inf) -> float | None:
    """A number as a finite float clipped to [low, high]; None if it is not a number, or out of float range."""
    try:
        found = float(value) if isinstance(value, int | float) and not isinstance(value, bool) else math.nan
    except OverflowError:  # JSON's integers are unbounded
        return None
    return min(max(found, low), high) if math.isfinite(found) else None


def count(value: object) -> int:
    """A count; 0 if it is not one."""
    return int(number(value, 0.0, 2.0**53) or 0)
