"""A bank as JSON lines: one record a line, its fields by name.

Lines of a file are untrusted: a broken one is reported, the others are admitted like any other lessons.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from gvla2.errors import MemoryStoreError, OutputError
from gvla2.io.files import write_whole
from gvla2.memory.admission import invalid
from gvla2.memory.contracts import Lesson, MemoryTask, Verdict
from gvla2.memory.learning import JudgedEpisode, OpenBank, admit
from gvla2.memory.records import OUTCOMES, TYPES, as_json, load_object
from gvla2.memory.store import Store

_OBJECTS = ("verifier", "effect", "provenance")
"""Fields that are JSON objects."""


@dataclass(frozen=True)
class Imported:
    """The result for a file: ids of the records that are ``added`` as active and of those ``held_back`` as provisional,
    how many lessons the bank knew already or did not take (``known``), how many archived records were ``left_out``,
    and the ``broken`` lines with their numbers.
    """

    added: tuple[str, ...]
    held_back: tuple[str, ...]
    known: int
    left_out: int
    broken: tuple[str, ...]


def export_jsonl(store: Store, bank: str, path: Path) -> int:
    """Write all records of a bank to a new file; their number.

    Raises :class:`OutputError` when the path is taken or cannot be written; nothing is left there then.
    """
    with store.reading(bank) as view:
        records = view.records()
    lines = []
    for record in sorted(records, key=lambda r: (r.created, r.id)):
        line = as_json(record)
        line |= {name: load_object(line[name]) if line[name] else None for name in _OBJECTS}
        for own in ("bank", "version", "rev"):
            del line[own]
        lines.append(json.dumps(line, allow_nan=False) + "\n")
    try:
        if path.exists() or path.is_symlink():
            raise OutputError(
                f"{path} already exists, and an export never replaces anything. Choose another path."
            )
        write_whole(path, "".join(lines).encode())
    except (OSError, RuntimeError) as error:  # RuntimeError: a circular link
        raise OutputError(f"Cannot write {path}: {getattr(error, 'strerror', '') or error}.") from error
    return len(lines)


def import_jsonl(bank: OpenBank, path: Path, *, trusted: bool = False, source: str = "import") -> Imported:
    """Admit the lessons of a file; a file that was imported before adds nothing.

    Lessons from others are provisional until a verified episode of ours confirms them, whatever a file says about
    itself. ``trusted`` vouches for your own export: its active lessons that are yours become active. Archived records
    are left out; evidence counts as one episode. Raises :class:`MemoryStoreError` when the file or the store cannot be
    read.
    """
    try:
        with path.open("rb") as stream:  # a pipe works like a file
            lines = [(number, raw) for number, raw in enumerate(stream, 1) if raw.strip()]
    except OSError as error:
        raise MemoryStoreError(
            f"Cannot read {path}: {error.strerror or error}. Give a .jsonl file of `gvla2 memory export`."
        ) from error
    judged: list[JudgedEpisode] = []
    broken: list[str] = []
    left_out = 0
    for number, raw in lines:
        try:
            line = load_object(raw.decode("utf-8-sig").strip())
            if line.get("state") == "archive":
                left_out += 1
                continue
            own = trusted and line.get("state", "active") == "active" and line.get("trust", "own") == "own"
            judged.append(JudgedEpisode.lesson(*_lesson(line), source, own=own))
        except (ValueError, TypeError, RecursionError, ArithmeticError) as error:
            broken.append(f"{path.name}, line {number}: {error}")
    if broken and not judged:
        raise MemoryStoreError(f"{path} is not an export of a memory: {broken[0]}.")
    done = admit(bank, judged)
    known = len(done.merged) + done.discarded
    return Imported(done.added, done.provisional, known, left_out, tuple(broken))


def _lesson(line: Mapping[str, Any]) -> tuple[Lesson, Verdict, MemoryTask]:
    """The lesson of a line, its verdict and its task; raises :class:`ValueError` for one that has none."""
    if not isinstance(content := line.get("content"), str) or not content.strip():
        raise ValueError("'content' is missing or empty")
    lesson = Lesson(line.get("type", TYPES[0]), content, line.get("effect"))
    outcome = line.get("outcome", "uncertain")
    if outcome not in OUTCOMES:
        raise ValueError(f"its outcome '{str(outcome)[:40]}' is not one of {', '.join(OUTCOMES)}")
    if wrong := invalid(lesson):
        raise ValueError(wrong)
    quality, confidence = (float(line.get(name, 0.5)) for name in ("quality", "confidence"))
    if not (0 <= quality <= 1 and 0 <= confidence <= 1):
        raise ValueError(f"its quality {quality:g} and confidence {confidence:g} must be between 0 and 1")
    verdict = Verdict(outcome, quality, confidence, verifier="import")
    query, skill = (line.get(name) or "" for name in ("query", "skill"))
    if not (isinstance(query, str) and isinstance(skill, str)):
        raise ValueError("'query' and 'skill' are texts")
    f"{query}{skill}".encode()  # a lone surrogate, which no database takes, raises ValueError
    return lesson, verdict, MemoryTask(query, skill)
