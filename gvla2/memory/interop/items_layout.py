"""The older layout ``items``: a line a task, with all that was learnt from it in ``memory_items``."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any

from gvla2.memory.interop.entry import Entry, confidence_of, kept, original, verdict_of, when
from gvla2.memory.interop.lines import Line, LineError, text_field
from gvla2.memory.interop.memory_items import items_of, lesson_of
from gvla2.memory.interop.vocabulary import count

NAME = "items"
STATUS = {"verified_success": "success", "verified_fail": "fail"}


def fits(fields: Mapping[str, Any]) -> bool:
    """Whether a line is of this layout."""
    return "memory_items" in fields


def read(line: Line) -> list[Entry]:
    """The records of a line, one an item; raises :class:`LineError` when it teaches nothing.

    All of the line but its items (trajectories, say) goes with the first record.
    """
    shape, found = items_of(line.fields.get("memory_items"))
    if not found:
        raise LineError("'memory_items' says nothing")
    rest = {name: value for name, value in line.fields.items() if name != "memory_items"}
    order = list(line.fields)
    made: list[Entry] = []
    for (element, piece), raw in found:
        trace = {
            "layout": NAME,
            "file": line.file,
            "line": line.number,
            "at": [element, piece],
            "shape": shape,
            "raw": json.dumps(raw, allow_nan=False),
        }
        if not made:
            trace |= {
                "fields": kept(rest),
                "order": order,
                "silent": _silent(line.fields["memory_items"], found),
            }
        made.append(_entry(rest, raw, f"{line.number}.{element}.{piece}", trace))
    return made


def _silent(items: Any, found: Sequence[tuple[tuple[int, int], object]]) -> dict[str, Any]:
    """Elements of a list that say nothing, by their place: they come back, too."""
    if not isinstance(items, list):
        return {}
    speaking = {element for (element, _), _ in found}
    return {str(place): item for place, item in enumerate(items) if place not in speaking}


def _entry(fields: Mapping[str, Any], raw: Any, place: str, trace: Mapping[str, Any]) -> Entry:
    task = text_field(fields, "task_id")
    outcome, quality, said = verdict_of(fields.get("status"))
    created, dated = when(fields.get("created_at"), "created_at")
    return Entry(
        key=f"{task}#{place}",
        task_id=task,
        query=text_field(fields, "query"),
        content=lesson_of(raw),
        type="failure_avoidance" if outcome == "verified_fail" else "procedural_hint",
        state="active" if outcome in STATUS else "provisional",
        outcome=outcome,
        quality=quality,
        confidence=confidence_of(quality),
        usage=count(fields.get("use_count")),
        created=created,
        trace=trace,
        notes=(*said, *dated),
    )


def write(group: Sequence[Entry]) -> dict[str, Any]:
    """One task's line: items that came from it in their old places and wording, save what has changed since."""
    first = group[0]
    told = {
        "task_id": first.task_id,
        "query": first.query,
        "memory_items": _items(group),
        "status": STATUS.get(first.outcome, "uncertain"),
        "created_at": first.created or 0.0,
        "use_count": max(entry.usage for entry in group),
    }
    fields = original(first, NAME)
    if fields is None:
        return told
    before = _entry(fields, "", "", {})
    order = [str(name) for name in first.trace.get("order", fields)]
    whole = {name: told["memory_items"] if name == "memory_items" else fields.get(name) for name in order}
    if before.query != first.query:
        whole["query"] = told["query"]
    if before.outcome != first.outcome:
        whole["status"] = told["status"]
    if before.usage != told["use_count"]:
        whole["use_count"] = told["use_count"]
    return whole


def _items(group: Sequence[Entry]) -> Any:
    """The items as text or list: as they were where they still say the same."""
    silent = group[0].trace.get("silent") or {}
    listed: dict[int, list[Any]] = {int(place): [item] for place, item in silent.items()}
    for entry in group:
        raw = json.loads(str(entry.trace["raw"])) if "raw" in entry.trace else entry.content
        same = lesson_of(raw) == entry.content
        listed.setdefault(_place(entry)[0], []).append(raw if same else entry.content)
    elements = [raw[0] if len(raw) == 1 else _text(raw) for _, raw in sorted(listed.items())]
    if group[0].trace.get("shape") == "text" and len(elements) == 1:
        return elements[0]
    return elements


def _place(entry: Entry) -> tuple[int, int]:
    at = entry.trace.get("at")
    return (int(at[0]), int(at[1])) if isinstance(at, list) and len(at) == 2 else (0, 0)


def _text(parts: Sequence[Any]) -> str:
    """Pieces of one text; one that was reworded ends its line, so that the next heading stands at a line's start."""
    made = ""
    for part in parts:
        made += ("\n" if made and not made.endswith("\n") else "") + str(part)
    return made
