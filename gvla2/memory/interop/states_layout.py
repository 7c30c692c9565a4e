"""The layout ``states``: a folder of four files, one a lifecycle state, a record a line."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from gvla2.memory.interop.entry import (
    STATES,
    Entry,
    confidence_of,
    kept,
    lesson_type,
    original,
    verdict_of,
    when,
)
from gvla2.memory.interop.lines import Line, LineError, parse, text_field
from gvla2.memory.interop.vocabulary import count, date_of, names, numbers, share

NAME = "states"


def files_of(folder: Path) -> dict[str, Path]:
    """The files of this layout that a folder has, by state."""
    return {state: path for state in STATES if (path := folder / f"{state}.jsonl").is_file()}


def fits(fields: Mapping[str, Any]) -> bool:
    """Whether a line is of this layout."""
    return "memory_id" in fields and "content" in fields


def read(line: Line) -> list[Entry]:
    """The one record of a line; raises :class:`LineError` when it has no id or says nothing.

    The file's name tells the state, as it does for the released code; the line's own word where the name does not.
    """
    fields, notes = line.fields, []
    key = text_field(fields, "memory_id", needed=True)[:1000]
    content = text_field(fields, "content", needed=True)
    told = text_field(fields, "state")
    named = line.file.rpartition("/")[2].removesuffix(".jsonl")
    state = next((s for s in STATES if s == named), None) or next((s for s in STATES if s == told), None)
    if state is None:
        raise LineError(f"neither the file's name nor 'state' ('{told}') is one of {', '.join(STATES)}")
    if told and told != state:
        notes.append(f"it calls itself '{told}' in the file of the {state} ones: taken as {state}")
    label = text_field(fields, "verifier_label") or fields.get("source_status")
    outcome, quality, said = verdict_of(label)
    kind, typed = lesson_type(text_field(fields, "memory_type"), outcome)
    scored = share(fields.get("quality_score"))
    quality = quality if scored is None else scored
    confidence = share(fields.get("confidence"))
    created, dated = when(fields.get("created_at"), "created_at")
    used, last = when(fields.get("last_used_at"), "last_used_at")
    return [
        Entry(
            key=key,
            task_id=text_field(fields, "task_id"),
            query=text_field(fields, "query"),
            content=content,
            type=kind,
            state=state,
            outcome=outcome,
            quality=quality,
            confidence=confidence_of(quality) if confidence is None else confidence,
            usage=count(fields.get("use_count")),
            created=created,
            used=used,
            supersedes=names(fields.get("supersedes")),
            conflicts=names(fields.get("conflicts_with")),
            verifier={
                "verifier": text_field(fields, "verifier_model"),
                "criteria": numbers(fields.get("verifier_criteria")),
                "reasons": [],
            },
            trace={"layout": NAME, "file": line.file, "line": line.number, "fields": kept(fields)},
            notes=(*notes, *said, *typed, *dated, *last),
        )
    ]


def write(group: Sequence[Entry]) -> dict[str, Any]:
    """One record's fields: those of the line that it came from, save what has changed since."""
    (entry,) = group
    told, fields = _told(entry), original(entry, NAME)
    if fields is None:
        return told
    (before,) = read(Line(str(entry.trace.get("file", "")), 0, fields))
    follow = {
        "query": ("query",),
        "content": ("content", "dedup_key", "embedding"),
        "type": ("memory_type",),
        "state": ("state",),
        "outcome": ("source_status", "verifier_label"),
        "quality": ("quality_score", "verifier_score"),
        "confidence": ("confidence", "verifier_confidence"),
        "usage": ("use_count", "last_used_at"),
        "supersedes": ("supersedes",),
        "conflicts": ("conflicts_with",),
        "verifier": ("verifier_criteria", "verifier_model"),
    }
    for attribute, columns in follow.items():
        if getattr(before, attribute) != getattr(entry, attribute):
            fields |= {name: told[name] for name in columns}
    return fields


def _told(entry: Entry) -> dict[str, Any]:
    """All fields of the layout, as our record has them."""
    judged = entry.outcome in ("verified_success", "verified_fail", "uncertain")
    return {
        "memory_id": entry.key,
        "task_id": entry.task_id,
        "query": entry.query,
        "content": entry.content,
        "memory_type": entry.type,
        "source_status": entry.outcome if judged else "uncertain",
        "state": entry.state,
        "confidence": entry.confidence,
        "quality_score": entry.quality,
        "created_at": date_of(entry.created or 0.0),
        "last_used_at": date_of(entry.used) if entry.usage and entry.used is not None else None,
        "use_count": entry.usage,
        "dedup_key": f"{entry.type}:{entry.key}",
        "supersedes": list(entry.supersedes),
        "conflicts_with": list(entry.conflicts),
        "embedding": None,
        "verifier_score": entry.quality if judged else None,
        "verifier_confidence": entry.confidence if judged else None,
        "verifier_label": entry.outcome if judged else None,
        "verifier_criteria": dict(entry.verifier.get("criteria") or {}),
        "verifier_model": entry.verifier.get("verifier") or None,
    }


def links_of(trace: Mapping[str, Any]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """What a line of this layout said that it supersedes and conflicts with."""
    try:
        fields = parse(str(trace["fields"])) if trace.get("layout") == NAME else {}
    except (LineError, KeyError):
        fields = {}
    return names(fields.get("supersedes")), names(fields.get("conflicts_with"))
