"""Import of foreign memories into a bank, in one transaction."""

from __future__ import annotations

import os
import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from gvla2.errors import MemoryStoreError
from gvla2.memory.curation.trust import Origin
from gvla2.memory.interop.states import STATES, LineError, ReadRecord, parse, read_record
from gvla2.memory.storage.store import Store

Line = tuple[str, int, Mapping[str, Any]]
"""A file's name, a line's number from 1, and the JSON object that it holds."""


@dataclass(frozen=True)
class Remark:
    """A remark on a line. ``broken`` when it could not be read, else it was read as ``why`` says."""

    file: str
    line: int
    why: str
    broken: bool = True

    def __str__(self) -> str:
        return f"{self.file}, line {self.line}: {self.why}"


@dataclass(frozen=True)
class Imported:
    """The result for a path: ids of the new records, how many lessons were already ``known`` to the bank, how many of
    the new ones are ``held_back`` as provisional, and remarks on lines.
    """

    added: tuple[str, ...]
    known: int
    held_back: int
    remarks: tuple[Remark, ...]

    @property
    def broken(self) -> tuple[Remark, ...]:
        """The lines that could not be read."""
        return tuple(remark for remark in self.remarks if remark.broken)


def import_path(
    store: Store,
    bank: str,
    path: Path,
    *,
    trusted: bool = False,
    source: str = "import",
    actor: str = "import",
    now: float | None = None,
) -> Imported:
    """Read a file or folder into ``bank``; a path that was imported before adds nothing.

    Records from others are provisional until verified episodes of two independent sources confirm them, whatever a file
    says about itself; an import is one ``source``. ``trusted`` is for the user's own backup: records keep their
    lifecycle state and trust. The bank embeds new records at its next query. Raises :class:`MemoryStoreError` when the
    path or the store cannot be read; nothing is stored then.
    """
    lines, remarks = read_path(path)
    at, origin = time.time() if now is None else now, Origin(trusted, source)
    entries: list[ReadRecord] = []
    for file, number, fields in lines:
        try:
            entries.append(read_record(fields, file, bank, at, origin))
            remarks += [Remark(file, number, note, broken=False) for note in entries[-1].notes]
        except (LineError, ValueError, OverflowError, RecursionError) as error:  # the others are read
            remarks.append(Remark(file, number, str(error)))
        except (TypeError, AttributeError) as error:
            remarks.append(Remark(file, number, f"the wordings of the summary are damaged: {error}"))
    ids: dict[str, str] = {}
    new: dict[str, ReadRecord] = {}
    with store.writing(bank, actor=actor, now=at) as tx:
        stored = tx.by_keys({entry.record.dedup_key for entry in entries})
        for entry in entries:
            record = entry.record
            there = stored.get(record.dedup_key)
            ids.setdefault(entry.key, record.id if there is None else there.id)
            if there is None:
                new.setdefault(record.id, entry)
        for entry in new.values():  # a note names records by their ids here
            note = " ".join(ids.get(word, word) for word in entry.record.note.split(" "))
            judged = entry.record.outcome in ("verified_success", "verified_fail")
            tx.put(replace(entry.record, note=note), action="import", origin=str(origin) if judged else "")
        ties = [
            (id, kind, ids.get(one, id)) for id in new for kind, told in new[id].links.items() for one in told
        ]
        tx.link_many({tie: "imported" for tie in ties if tie[0] != tie[2] and tie[1]})
    held = sum(entry.record.state == "provisional" for entry in new.values())
    return Imported(tuple(new), len(entries) - len(new), held, tuple(remarks))


def read_path(path: Path) -> tuple[list[Line], list[Remark]]:
    """The JSON objects of a file or folder, and remarks on its other lines; empty ones are skipped.

    Raises :class:`MemoryStoreError` when there is nothing to read, or no line is a record.
    """
    lines: list[Line] = []
    remarks: list[Remark] = []
    try:
        for file in _files(path):
            with file.open("rb") as stream:
                for number, raw in enumerate(stream, 1):
                    try:
                        lines += [(file.name, number, parse(raw))] if raw.strip() else []
                    except LineError as error:
                        remarks.append(Remark(file.name, number, str(error)))
    except OSError as error:
        place = error.filename or path
        raise MemoryStoreError(f"Cannot read {place}: {error.strerror or error}.") from error
    fits = any("memory_id" in fields and "content" in fields for _, _, fields in lines)
    if not fits and (lines or (remarks and not path.is_dir())):
        raise MemoryStoreError(f"{path} is not a memory: no line has memory_id and content.")
    return lines, remarks


def _files(path: Path) -> list[Path]:
    if not os.path.exists(path):  # noqa: PTH110  # Path.exists raises for names that no file system takes
        raise MemoryStoreError(
            f"There is nothing at {path}. Give a .jsonl file, or a folder with active.jsonl."
        )
    if not path.is_dir():  # a pipe works like a file: `... | gvla2 memory import /dev/stdin`
        return [path]
    found = [file for state in STATES if (file := path / f"{state}.jsonl").is_file()]
    if not found:
        raise MemoryStoreError(
            f"{path} has no active.jsonl, provisional.jsonl, summary.jsonl or archive.jsonl; a memory of the released "
            "code has them in a folder of the model's name."
        )
    return found
