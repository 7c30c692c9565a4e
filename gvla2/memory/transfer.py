"""A bank as JSON lines: one record a line, its fields by name.

Lines of a file are untrusted: a broken one is reported, the others are admitted like any other lessons.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

from gvla2.errors import Gvla2Error, MemoryStoreError, OutputError
from gvla2.io.files import write_whole
from gvla2.memory.admission import invalid
from gvla2.memory.contracts import Lesson, MemoryTask, Verdict
from gvla2.memory.learning import JudgedEpisode, admit
from gvla2.memory.ledger import OpenBank
from gvla2.memory.records import OUTCOMES, TYPES, Record, finite, load_object
from gvla2.memory.store import Store

_OBJECTS = ("verifier", "signature", "effect", "provenance")
"""Fields that are JSON objects."""
_LEFT_OUT = ("bank", "version", "rev")


@dataclass(frozen=True)
class Exported:
    """The file written, its lines (one per record), and how many records of other states were left out."""

    file: Path
    records: int
    left_out: int


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


class LineError(Gvla2Error):
    """A line that is not a record; the message says why."""


def export_jsonl(store: Store, bank: str, path: Path, *, states: Sequence[str] | None = None) -> Exported:
    """Write the records of a bank, those in ``states`` (all by default), to a new file.

    Raises :class:`OutputError` when the path is taken or cannot be written; nothing is left there then.
    """
    with store.reading(bank) as view:
        everything = view.records()
    shown = [record for record in everything if states is None or record.state in states]
    lines = []
    for record in sorted(shown, key=lambda r: (r.created, r.id)):
        line: dict[str, Any] = {
            column.name: getattr(record, column.name)
            for column in fields(Record)
            if column.name not in _LEFT_OUT
        }
        line |= {name: load_object(line[name]) if line[name] else None for name in _OBJECTS}
        lines.append(json.dumps(line, ensure_ascii=True, allow_nan=False))
    try:
        if path.exists() or path.is_symlink():
            raise OutputError(
                f"{path} already exists, and an export never replaces anything. Choose another path."
            )
        write_whole(path, "".join(f"{line}\n" for line in lines).encode())
    except (OSError, RuntimeError) as error:  # RuntimeError: a circular link
        raise OutputError(f"Cannot write {path}: {getattr(error, 'strerror', '') or error}.") from error
    return Exported(path, len(shown), len(everything) - len(shown))


def import_jsonl(bank: OpenBank, path: Path, *, trusted: bool = False, source: str = "import") -> Imported:
    """Admit the lessons of a file; a file that was imported before adds nothing.

    Lessons from others are provisional until verified episodes of two independent sources confirm them, whatever a file
    says about itself; an import is one ``source``. ``trusted`` vouches for your own export: its active lessons that are
    yours become active. Archived records are left out; evidence counts as one episode. Raises
    :class:`MemoryStoreError` when the file or the store cannot be read.
    """
    judged: list[JudgedEpisode] = []
    broken: list[str] = []
    left_out = 0
    for number, raw in _lines(path):
        try:
            line = _line(raw)
            if line.get("state") == "archive":
                left_out += 1
                continue
            own = trusted and line.get("state", "active") == "active" and line.get("trust", "own") == "own"
            judged.append(JudgedEpisode.lesson(*_lesson(line), source, own=own))
        except (LineError, ValueError, TypeError, RecursionError) as error:
            broken.append(f"{path.name}, line {number}: {error}")
    if broken and not judged:
        raise MemoryStoreError(f"{path} is not an export of a memory: {broken[0]}.")
    done = admit(bank, judged)
    known = len(done.merged) + done.discarded
    return Imported(done.added, done.provisional, known, left_out, tuple(broken))


def _lines(path: Path) -> list[tuple[int, bytes]]:
    """The numbered lines of a file that are not empty; a pipe works like a file."""
    try:
        with path.open("rb") as stream:
            return [(number, raw) for number, raw in enumerate(stream, 1) if raw.strip()]
    except OSError as error:
        raise MemoryStoreError(
            f"Cannot read {path}: {error.strerror or error}. Give a .jsonl file of `gvla2 memory export`."
        ) from error


def _line(raw: bytes) -> dict[str, Any]:
    try:
        return load_object(raw.decode("utf-8-sig").strip())
    except UnicodeDecodeError as error:
        raise LineError(f"it is not UTF-8 (byte {error.start})") from error
    except (ValueError, RecursionError) as error:
        raise LineError(f"it is not a JSON object: {str(error)[:100]}") from error


def _lesson(line: Mapping[str, Any]) -> tuple[Lesson, Verdict, MemoryTask]:
    """The lesson of a line, its verdict and its task; raises :class:`LineError` for one that has none."""
    if not isinstance(content := line.get("content"), str) or not content.strip():
        raise LineError("'content' is missing or empty")
    texts = {name: str(line.get(name) or "") for name in ("query", "skill")}
    objects = {name: line.get(name) or {} for name in ("effect", "signature")}
    if wrong := next((name for name, value in objects.items() if not isinstance(value, dict)), ""):
        raise LineError(f"'{wrong}' is not an object")
    kind = _one_of(line, "type", TYPES, "procedural_hint")
    outcome = _one_of(line, "outcome", OUTCOMES, "uncertain")
    lesson = Lesson(kind, content, objects["effect"] or None)
    if wrong := invalid(lesson):
        raise LineError(wrong)
    quality, confidence = (float(line.get(name, 0.5)) for name in ("quality", "confidence"))
    verdict = Verdict(outcome, quality, confidence, verifier="import")
    return lesson, verdict, MemoryTask(texts["query"], finite(objects["signature"]), texts["skill"])


def _one_of(line: Mapping[str, Any], name: str, known: Sequence[Any], default: str) -> Any:
    value = line.get(name, default)
    if value not in known:
        raise LineError(f"its {name} '{str(value)[:40]}' is not one of {', '.join(known)}")
    return value
