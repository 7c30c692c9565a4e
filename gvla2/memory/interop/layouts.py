"""What a line of each released layout means, and how a record is told in it."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from types import MappingProxyType
from typing import Any

from gvla2.errors import ConfigurationError
from gvla2.memory.contracts import TYPES, LifecycleState, Outcome, RecordType
from gvla2.memory.interop.lines import LONGEST_TEXT, Line, LineError, kind_of, text_field
from gvla2.memory.records import Record, clean, finite

STATES: tuple[LifecycleState, ...] = ("active", "provisional", "summary", "archive")
"""The lifecycle states in the order of their files."""
OUTCOMES: Mapping[str, Outcome] = MappingProxyType(
    {
        **dict.fromkeys(
            ("success", "succeeded", "verified_success", "pass", "passed", "true"), "verified_success"
        ),
        **dict.fromkeys(
            ("fail", "failed", "failure", "verified_fail", "verified_failure", "false"), "verified_fail"
        ),
        **dict.fromkeys(("uncertain", "unknown", "unverified", "", "none"), "uncertain"),
        "unavailable": "unavailable",
    }
)
"""Every spelling of a status that the releases have used."""
QUALITIES: Mapping[Outcome, float] = MappingProxyType(
    {"verified_success": 0.8, "verified_fail": 0.2, "uncertain": 0.5, "unavailable": 0.5}
)
"""Quality R of a line that has a verdict and no score; its confidence follows as 2|R - .5|."""
_HEADING = re.compile(r"^[ \t]*#[ \t]*Memory[ \t]+Item\b[^\n]*", re.MULTILINE | re.IGNORECASE)
_FIELD = re.compile(r"^[ \t]*##[ \t]*(title|description|content)\b[ \t:]*", re.MULTILINE | re.IGNORECASE)
_FENCE = re.compile(r"^[ \t]*```\w*[ \t]*$", re.MULTILINE)
_OURS = ("skill", "effect", "signature", "count", "recalled", "trust")


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


@dataclass(frozen=True)
class Told:
    """A record for a line, with the ids that it ``replaces`` and that it is in ``conflict`` with."""

    record: Record
    replaces: tuple[str, ...] = ()
    conflict: tuple[str, ...] = ()


@dataclass(frozen=True)
class Layout:
    """A layout: whether a line ``fits`` it, how a line is read, and how a record is told."""

    name: str
    fits: Callable[[Mapping[str, Any]], bool]
    read: Callable[[Line], list[Entry]]
    write: Callable[[Told], dict[str, Any]]


def layout_named(name: str) -> Layout:
    """The layout; raises :class:`ConfigurationError` with those that exist."""
    if name not in LAYOUTS:
        raise ConfigurationError(f"No memory layout '{name}'. Available: {', '.join(LAYOUTS)}.")
    return LAYOUTS[name]


# states ---------------------------------------------------------------------------------------------------------------


def read_states(line: Line) -> list[Entry]:
    """The one record of a line; raises :class:`LineError` when it has no id or says nothing.

    The file's name tells the state, as it does for the released code; the line's own word where the name does not.
    """
    fields, notes = line.fields, list[str]()
    told = text_field(fields, "state")
    named = line.file.rpartition("/")[2].removesuffix(".jsonl")
    state = next((s for s in STATES if s == named), None) or next((s for s in STATES if s == told), None)
    if state is None:
        raise LineError(f"neither the file's name nor 'state' ('{told}') is one of {', '.join(STATES)}")
    if told and told != state:
        notes.append(f"it calls itself '{told}' in the file of the {state} ones: taken as {state}")
    outcome, quality = _verdict(text_field(fields, "verifier_label") or fields.get("source_status"), notes)
    scored, confidence = share(fields.get("quality_score")), share(fields.get("confidence"))
    quality = quality if scored is None else scored
    criteria = fields.get("verifier_criteria")
    ours = fields.get("gvla2")
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
            created=_when(fields, "created_at", notes),
            used=_when(fields, "last_used_at", notes),
            supersedes=_names(fields.get("supersedes")),
            conflicts=_names(fields.get("conflicts_with")),
            verifier={
                "verifier": text_field(fields, "verifier_model"),
                "criteria": {str(k): n for k, v in criteria.items() if (n := number(v)) is not None}
                if isinstance(criteria, Mapping)
                else {},
                "reasons": [],
            },
            ours={name: ours[name] for name in _OURS if name in ours} if isinstance(ours, Mapping) else {},
            notes=tuple(notes),
        )
    ]


def write_states(told: Told) -> dict[str, Any]:
    """All fields of the layout, and under ``gvla2`` what it has no field for."""
    record = told.record
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
        "supersedes": list(told.replaces),
        "conflicts_with": list(told.conflict),
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


# items ----------------------------------------------------------------------------------------------------------------


def read_items(line: Line) -> list[Entry]:
    """The records of a line, one an item; raises :class:`LineError` when it teaches nothing."""
    fields, notes = line.fields, list[str]()
    value = fields.get("memory_items")
    if not isinstance(value, str | list):
        raise LineError("'memory_items' is neither text nor a list")
    texts: list[str] = []
    for place, item in enumerate([value] if isinstance(value, str) else value):
        if isinstance(item, Mapping):
            told = {name: clean(text, LONGEST_TEXT) for name, text in item.items() if isinstance(text, str)}
            texts.append(_joined(told))
        elif isinstance(item, str):
            cuts = [match.start() for match in _HEADING.finditer(item)][1:]
            texts += [lesson_of(item[a:b]) for a, b in zip([0, *cuts], [*cuts, len(item)], strict=True)]
        else:
            raise LineError(f"'memory_items[{place}]' is {kind_of(item)}, neither text nor an object")
    if not any(texts):
        raise LineError("'memory_items' says nothing")
    task = text_field(fields, "task_id")
    outcome, quality = _verdict(fields.get("status"), notes)
    created = _when(fields, "created_at", notes)
    return [
        Entry(
            key=f"{task}#{line.number}.{place}",
            task_id=task,
            query=text_field(fields, "query"),
            content=text,
            type=_type("", outcome, notes),
            state="active" if outcome.startswith("verified") else "provisional",
            outcome=outcome,
            quality=quality,
            confidence=2 * abs(quality - 0.5),
            usage=count(fields.get("use_count")),
            created=created,
            notes=tuple(notes) if place == 0 else (),
        )
        for place, text in enumerate(texts)
        if text
    ]


def write_items(told: Told) -> dict[str, Any]:
    """One record as a task with one item."""
    record = told.record
    return {
        "task_id": next(iter(record.sources()), ""),
        "query": record.query,
        "memory_items": [record.content],
        "status": {"verified_success": "success", "verified_fail": "fail"}.get(record.outcome, "uncertain"),
        "created_at": record.created,
        "use_count": record.usage,
    }


def lesson_of(item: str) -> str:
    """What an item says, a line for each of title, description and content; "" when it says nothing.

    Text without such headings, a workflow or a whole trajectory, is the lesson as it stands.
    """
    item = clean(item, LONGEST_TEXT)
    start = _HEADING.search(item)
    body = _FENCE.sub("", item[start.end() :] if start else item)
    marks = list(_FIELD.finditer(body)) if start else []
    if not marks:
        return body.strip()
    ends = [mark.start() for mark in marks[1:]] + [len(body)]
    return _joined({m[1].lower(): body[m.end() : end].strip() for m, end in zip(marks, ends, strict=True)})


def _joined(fields: Mapping[str, str]) -> str:
    parts = (fields.get(name, "").strip() for name in ("title", "description", "content"))
    return "\n".join(part for part in parts if part)


# robot ----------------------------------------------------------------------------------------------------------------


def read_robot(line: Line) -> list[Entry]:
    """The one record of a line; raises :class:`LineError` when it says nothing.

    The reason of a failure is part of what was learnt: the text alone is often a recipe.
    """
    fields, notes = line.fields, list[str]()
    task = text_field(fields, "task_id")
    outcome, quality = _verdict(fields.get("outcome"), notes)
    text, reason = (
        text_field(fields, "memory_text", needed=True),
        text_field(fields, "failure_reason").strip(),
    )
    return [
        Entry(
            key=f"{task}#{line.number}",
            task_id=task,
            query=text_field(fields, "task_text"),
            content=f"{text}\nFailed: {reason}" if reason and outcome != "verified_success" else text,
            type=_type("", outcome, notes),
            state="active" if outcome.startswith("verified") else "provisional",
            outcome=outcome,
            quality=quality,
            confidence=2 * abs(quality - 0.5),
            notes=tuple(notes),
        )
    ]


def write_robot(told: Told) -> dict[str, Any]:
    """One task's line."""
    record = told.record
    return {
        "task_id": next(iter(record.sources()), record.id),
        "task_text": record.query,
        "outcome": {"verified_success": "success", "verified_fail": "failure"}.get(
            record.outcome, "uncertain"
        ),
        "failure_reason": None,
        "memory_text": record.content,
        "tags": [],
        "embedding": None,
    }


LAYOUTS: Mapping[str, Layout] = MappingProxyType(
    {
        "states": Layout("states", lambda f: "memory_id" in f and "content" in f, read_states, write_states),
        "items": Layout("items", lambda f: "memory_items" in f, read_items, write_items),
        "robot": Layout("robot", lambda f: "memory_text" in f and "task_text" in f, read_robot, write_robot),
    }
)


# Words and numbers ----------------------------------------------------------------------------------------------------


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
    if outcome == "verified_fail" and kind == "procedural_hint":
        notes.append("a recipe from a failure is taken as something to avoid")
    if outcome == "verified_fail" and kind in (None, "procedural_hint"):
        return "failure_avoidance"
    return kind or "procedural_hint"


def _when(fields: Mapping[str, Any], name: str, notes: list[str]) -> float | None:
    """Seconds since the epoch of a number or an ISO date (UTC where it names no zone); None if it is neither."""
    value = fields.get(name)
    told: object = value
    if isinstance(value, str):
        try:
            date = datetime.fromisoformat(value.strip())
            value = (date if date.tzinfo else date.replace(tzinfo=UTC)).timestamp()
        except (ValueError, OverflowError):
            value = None
    found = number(value)
    if found is not None and 0 <= found < 4e11:
        return found
    if told not in (None, ""):
        notes.append(f"'{name}' is no time")
    return None


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
