"""A lesson between a foreign layout and the bank."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from gvla2.memory.contracts import TYPES, LifecycleState, Outcome, RecordType
from gvla2.memory.interop.lines import LineError, parse
from gvla2.memory.interop.vocabulary import QUALITIES, outcome_of, seconds_of

STATES: tuple[LifecycleState, ...] = ("active", "provisional", "summary", "archive")
"""The lifecycle states in the order of their files."""


@dataclass(frozen=True)
class Entry:
    """One lesson, in our words and in none of a layout's.

    ``key`` names it in its source; ``task_id`` the task that taught it. Times are seconds since the epoch, None
    where the layout does not say. ``supersedes`` and ``conflicts`` are keys of others. ``trace`` is what the layout
    needs to write the line as it was, JSON; it goes with the record. ``notes`` say what was understood how.
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
    trace: Mapping[str, Any] = field(default_factory=dict)
    notes: tuple[str, ...] = ()


def confidence_of(quality: float) -> float:
    """2|R - .5|, as for a verdict."""
    return 2 * abs(quality - 0.5)


def lesson_type(told: str, outcome: Outcome) -> tuple[RecordType, tuple[str, ...]]:
    """The type of a lesson that calls itself ``told``: a recipe from a failure is a thing to avoid."""
    kind = next((t for t in TYPES if t == told), None)
    failed = outcome == "verified_fail"
    if kind is None:
        why = (f"its type '{told}' is not known",) if told else ()
        return ("failure_avoidance" if failed else "procedural_hint"), why
    if failed and kind == "procedural_hint":
        return "failure_avoidance", ("a recipe from a failure is taken as something to avoid",)
    return kind, ()


def verdict_of(status: object) -> tuple[Outcome, float, tuple[str, ...]]:
    """Outcome, quality R and a note for a status without a score; a word that nobody knows is ``uncertain``."""
    outcome = outcome_of(status)
    if outcome is None:
        return "uncertain", QUALITIES["uncertain"], (f"its status '{str(status)[:40]}' is not known",)
    return outcome, QUALITIES[outcome], ()


def when(value: object, name: str) -> tuple[float | None, tuple[str, ...]]:
    """A time, and a note where something is there that is none."""
    found = seconds_of(value)
    wrong = found is None and value not in (None, "")
    return found, ((f"'{name}' is no time",) if wrong else ())


def kept(fields: Mapping[str, Any]) -> str:
    """A line's own fields as ASCII text: any database takes it, and it reads back as it was, order included."""
    return json.dumps(fields, allow_nan=False)


def original(entry: Entry, layout: str) -> dict[str, Any] | None:
    """The fields of the line that an entry came from; None where it came from elsewhere, or they are damaged."""
    text = entry.trace.get("fields")
    if entry.trace.get("layout") != layout or not isinstance(text, str):
        return None
    try:
        return parse(text)
    except LineError:
        return None
