"""The layout ``robot``: a line a task that the arm has tried."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from gvla2.memory.interop.entry import Entry, confidence_of, kept, original, verdict_of
from gvla2.memory.interop.lines import Line, text_field

NAME = "robot"
STATUS = {"verified_success": "success", "verified_fail": "failure"}


def fits(fields: Mapping[str, Any]) -> bool:
    """Whether a line is of this layout."""
    return "memory_text" in fields and "task_text" in fields


def read(line: Line) -> list[Entry]:
    """The one record of a line; raises :class:`LineError` when it says nothing.

    The reason of a failure is part of what was learnt: the text alone is often a recipe.
    """
    fields = line.fields
    task = text_field(fields, "task_id")
    outcome, quality, said = verdict_of(fields.get("outcome"))
    text = text_field(fields, "memory_text", needed=True)
    reason = text_field(fields, "failure_reason").strip()
    return [
        Entry(
            key=f"{task}#{line.number}",
            task_id=task,
            query=text_field(fields, "task_text"),
            content=f"{text}\nFailed: {reason}" if reason and outcome != "verified_success" else text,
            type="failure_avoidance" if outcome == "verified_fail" else "procedural_hint",
            state="active" if outcome in STATUS else "provisional",
            outcome=outcome,
            quality=quality,
            confidence=confidence_of(quality),
            trace={"layout": NAME, "file": line.file, "line": line.number, "fields": kept(fields)},
            notes=said,
        )
    ]


def write(group: Sequence[Entry]) -> dict[str, Any]:
    """One task's line: as it was read, save what has changed since."""
    (entry,) = group
    told: dict[str, Any] = {
        "task_id": entry.task_id or entry.key,
        "task_text": entry.query,
        "outcome": STATUS.get(entry.outcome, "uncertain"),
        "failure_reason": None,
        "memory_text": entry.content,
        "tags": [],
        "embedding": None,
    }
    fields = original(entry, NAME)
    if fields is None:
        return told
    (before,) = read(Line("", 0, fields))
    if before.query != entry.query:
        fields |= {"task_text": told["task_text"], "embedding": None}  # made from the text that was
    if before.content != entry.content:
        fields |= {"memory_text": told["memory_text"], "failure_reason": None}
    if before.outcome != entry.outcome:
        fields["outcome"] = told["outcome"]
    return fields
