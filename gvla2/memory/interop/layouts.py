"""What a line of each released layout means, and how a record is told in the layout ``states``."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from types import MappingProxyType
from typing import Any

from gvla2.memory.contracts import TYPES, LifecycleState, Outcome, RecordType
from gvla2.memory.interop.lines import LONGEST_TEXT, Line, LineError, text_field
from gvla2.memory.records import Record, clean, finite

STATES: tuple[LifecycleState, ...] = ("active", "provisional", "summary", "archive")
"""The lifecycle states in the order of their files."""
_SPELT: Mapping[Outcome, str] = {
    "verified_success": "success succeeded verified_success pass passed true",
    "verified_fail": "fail failed failure verified_fail verified_failure false",
    "uncertain": "uncertain unknown unverified none",
    "unavailable": "unavailable",
}
"""Every spelling of a status that the releases have used."""
OUTCOMES: Mapping[str, Outcome] = MappingProxyType(
    {"": "uncertain", **{word: outcome for outcome, words in _SPELT.items() for word in words.split()}}
)
QUALITIES: Mapping[Outcome, float] = MappingProxyType(
    {"verified_success": 0.8, "verified_fail": 0.2, "uncertain": 0.5, "unavailable": 0.5}
)
"""Quality R of a line that has a verdict and no score; its confidence follows as 2|R - .5|."""
_HEADING = re.compile(r"^[ \t]*#[ \t]*Memory[ \t]+Item\b[^\n]*", re.MULTILINE | re.IGNORECASE)
_FIELD = re.compile(r"^[ \t]*##[ \t]*(title|description|content)\b[ \t:]*", re.MULTILINE | re.IGNORECASE)
_FENCE = re.compile(r"^[ \t]*```\w*[ \t]*$", re.MULTILINE)


@dataclass(frozen=True)
class Entry:
    """One lesson of a line, in our words.

    ``key`` names it in its source; ``task_id`` the task that taught it. Times are seconds since the epoch, None
    where the layout does not say. ``supersedes`` and ``conflicts`` are keys of others; ``ours`` what only our own
    exports tell. ``notes`` say what was understood how.
    """

    key: str
    task_id: str
    query: str
    content: str
    type: RecordType
    state: LifecycleState
    outcome: Outcome
    quality: float
    confidence: float
    usage: int = 0
    created: float | None = None
    used: float | None = None
    supersedes: tuple[str, ...] = ()
    conflicts: tuple[str, ...] = ()
    verifier: Mapping[str, Any] = field(default_factory=dict)
    ours: Mapping[str, Any] = field(default_factory=dict)
    notes: tuple[str, ...] = ()


def read_states(line: Line) -> list[Entry]:
    """The one record of a line; raises :class:`LineError` when it has no id or says nothing.

    The file's name tells the state, as it does for the released code; the line's own word where the name does not.
    """
    fields, notes = line.fields, list[str]()
    told = text_field(fields, "state")
    named = line.file.removesuffix(".jsonl")
    state = next((s for word in (named, told) for s in STATES if s == word), None)
    if state is None:
        raise LineError(f"neither the file's name nor 'state' ('{told}') is one of {', '.join(STATES)}")
    outcome, quality = _verdict(text_field(fields, "verifier_label") or fields.get("source_status"), notes)
    scored, confidence = share(fields.get("quality_score")), share(fields.get("confidence"))
    quality = quality if scored is None else scored
    criteria, ours = fields.get("verifier_criteria"), fields.get("gvla2")
    scores = criteria if isinstance(criteria, Mapping) else {}
    return [
        Entry(
            key=text_field(fields, "memory_id", needed=True)[:1000],
            task_id=text_field(fields, "task_id"),
            query=text_field(fields, "query"),
            content=text_field(fields, "content", needed=True),
            type=_type(text_field(fields, "memory_type"), outcome, notes),
            state=state,
            outcome=outcome,
            quality=quality,
            confidence=2 * abs(quality - 0.5) if confidence is None else confidence,
            usage=count(fields.get("use_count")),
            created=_when(fields.get("created_at")),
            used=_when(fields.get("last_used_at")),
            supersedes=_names(fields.get("supersedes")),
            conflicts=_names(fields.get("conflicts_with")),
            verifier={
                "verifier": text_field(fields, "verifier_model"),
                "criteria": {str(name): n for name, v in scores.items() if (n := number(v)) is not None},
                "reasons": [],
            },
            ours=ours if isinstance(ours, Mapping) else {},
            notes=tuple(notes),
        )
    ]


def write_states(record: Record, replaces: list[str], conflicts: list[str]) -> dict[str, Any]:
    """All fields of the layout, and under ``gvla2`` what it has no field for."""
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
        "supersedes": replaces,
        "conflicts_with": conflicts,
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
            "count": record.count,
            "recalled": record.recalled,
            "trust": record.trust,
        },
    }


def read_items(line: Line) -> list[Entry]:
    """The records of a line, one an item; raises :class:`LineError` when it teaches nothing."""
    value = line.fields.get("memory_items")
    texts: list[str] = []
    for item in [value] if isinstance(value, str) else value if isinstance(value, list) else [None]:
        if isinstance(item, Mapping):
            texts.append(_joined({name: str(text) for name, text in item.items()}))
        elif isinstance(item, str):
            cuts = [match.start() for match in _HEADING.finditer(item)][1:]
            texts += [lesson_of(item[a:b]) for a, b in zip([0, *cuts], [*cuts, len(item)], strict=True)]
        else:
            raise LineError("'memory_items' holds what is neither text nor an object")
    if not any(texts):
        raise LineError("'memory_items' says nothing")
    return _taught(line, "query", "status", [text for text in texts if text])


def read_robot(line: Line) -> list[Entry]:
    """The one record of a line; raises :class:`LineError` when it says nothing.

    The reason of a failure is part of what was learnt: the text alone is often a recipe.
    """
    text = text_field(line.fields, "memory_text", needed=True)
    reason = text_field(line.fields, "failure_reason").strip()
    failed = _verdict(line.fields.get("outcome"), [])[0] != "verified_success"
    return _taught(line, "task_text", "outcome", [f"{text}\nFailed: {reason}" if reason and failed else text])


def _taught(line: Line, query: str, status: str, texts: list[str]) -> list[Entry]:
    """What a line about a whole task taught: a lesson for each text, with one verdict."""
    fields, notes = line.fields, list[str]()
    task = text_field(fields, "task_id")
    outcome, quality = _verdict(fields.get(status), notes)
    return [
        Entry(
            key=f"{task}#{line.number}.{place}",
            task_id=task,
            query=text_field(fields, query),
            content=text,
            type=_type("", outcome, notes),
            state="active" if outcome.startswith("verified") else "provisional",
            outcome=outcome,
            quality=quality,
            confidence=2 * abs(quality - 0.5),
            usage=count(fields.get("use_count")),
            created=_when(fields.get("created_at")),
            notes=tuple(notes) if place == 0 else (),
        )
        for place, text in enumerate(texts)
    ]


READERS: Mapping[str, tuple[tuple[str, ...], Callable[[Line], list[Entry]]]] = MappingProxyType(
    {
        "states": (("memory_id", "content"), read_states),
        "items": (("memory_items",), read_items),
        "robot": (("memory_text", "task_text"), read_robot),
    }
)
"""Of each layout the fields that a line of it has, and how it is read."""


def lesson_of(item: str) -> str:
    """What an item says, a line for each of title, description and content; "" when it says nothing.

    Text without such headings, a workflow or a whole trajectory, is the lesson as it stands.
    """
    start = _HEADING.search(item)
    body = _FENCE.sub("", clean(item, LONGEST_TEXT)[start.end() if start else 0 :])
    marks = list(_FIELD.finditer(body)) if start else []
    if not marks:
        return body.strip()
    ends = [mark.start() for mark in marks[1:]] + [len(body)]
    return _joined({m[1].lower(): body[m.end() : end] for m, end in zip(marks, ends, strict=True)})


def _joined(fields: Mapping[str, str]) -> str:
    parts = (clean(fields.get(n, ""), LONGEST_TEXT).strip() for n in ("title", "description", "content"))
    return "\n".join(part for part in parts if part)


def _verdict(status: object, notes: list[str]) -> tuple[Outcome, float]:
    """Outcome and quality R for a status without a score; a word that nobody knows is ``uncertain``."""
    outcome = OUTCOMES.get(str("" if status is None else status).strip().casefold())
    if outcome is None:
        notes.append(f"its status '{str(status)[:40]}' is not known")
    return outcome or "uncertain", QUALITIES[outcome or "uncertain"]


def _type(told: str, outcome: Outcome, notes: list[str]) -> RecordType:
    """The type of a lesson that calls itself ``told``: a recipe from a failure is a thing to avoid."""
    kind = next((known for known in TYPES if known == told), None)
    if told and kind is None:
        notes.append(f"its type '{told}' is not known")
    if outcome == "verified_fail" and kind in (None, "procedural_hint"):
        return "failure_avoidance"
    return kind or "procedural_hint"


def _when(value: object) -> float | None:
    """Seconds since the epoch of a number or an ISO date (UTC where it names no zone); None if it is neither."""
    if isinstance(value, str):
        try:
            date = datetime.fromisoformat(value.strip())
            value = (date if date.tzinfo else date.replace(tzinfo=UTC)).timestamp()
        except (ValueError, OverflowError):
            return None
    found = number(value)
    return found if found is not None and 0 <= found < 4e11 else None


def _date(seconds: float) -> str | None:
    """The ISO date in UTC; None for a time that no calendar has, as a clock gone wrong gives it."""
    try:
        return datetime.fromtimestamp(seconds, UTC).isoformat()
    except (ValueError, OverflowError, OSError):
        return None


def number(value: object) -> float | None:
    """A number as a finite float; None for what is no number, or beyond all floats."""
    try:
        found = float(value) if isinstance(value, int | float) and not isinstance(value, bool) else math.nan
    except OverflowError:  # JSON's whole numbers have no bound
        return None
    return found if math.isfinite(found) else None


def share(value: object) -> float | None:
    """A number held to [0, 1]; None for what is no number."""
    found = number(value)
    return None if found is None else min(max(found, 0.0), 1.0)


def count(value: object) -> int:
    """A count; 0 for what is none."""
    return int(min(max(number(value) or 0.0, 0.0), 2.0**53))


def _names(value: object) -> tuple[str, ...]:
    """A list of ids; what is no text in it is left out."""
    return tuple(clean(v, 1000) for v in value if isinstance(v, str)) if isinstance(value, list) else ()
