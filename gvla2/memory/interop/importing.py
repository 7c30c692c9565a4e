"""Foreign memories into a bank, in one transaction."""

from __future__ import annotations

import os
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from gvla2.errors import ConfigurationError, MemoryStoreError
from gvla2.memory.contracts import Trust
from gvla2.memory.curation.trust import LEVELS, Origin, believed, trust_of
from gvla2.memory.injection_patterns import screen
from gvla2.memory.interop.layouts import READERS, STATES, Entry, count
from gvla2.memory.interop.lines import Line, LineError, Remark, read_lines
from gvla2.memory.records import Record, clean, dedup_key, dump, finite, record_id
from gvla2.memory.storage.store import Store, Transaction


@dataclass(frozen=True)
class Imported:
    """What became of a path: ids of the records that are new, how many lessons the bank ``known`` already had,
    how many of the new ones are ``held_back`` as provisional, and remarks on lines.
    """

    layout: str
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
    layout: str = "",
    trusted: bool = False,
    source: str = "import",
    actor: str = "import",
    now: float | None = None,
) -> Imported:
    """Read a file or folder into ``bank``; a path that was imported before adds nothing.

    What others have written is provisional until verified episodes of two independent sources bear it out, whatever
    a file says of itself; all that is imported is one ``source``. ``trusted`` is for one's own backup: records keep
    the lifecycle state and the trust that they had. The bank embeds what is new when it is asked next. Raises
    :class:`MemoryStoreError` when the path or the store cannot be read; nothing is stored then.
    """
    found, entries, remarks = read_path(path, layout)
    at = time.time() if now is None else now
    ids: dict[str, str] = {}
    new: dict[str, Record] = {}
    known = 0
    with store.writing(bank, actor=actor, now=at) as tx:
        made = [_record(entry, found, bank, at, Origin(trusted, source)) for entry in entries]
        stored = tx.by_keys({record.dedup_key for record in made})
        for entry, record in zip(entries, made, strict=True):
            there = new.get(record.id) or stored.get(record.dedup_key)
            ids.setdefault(entry.key, record.id if there is None else there.id)
            if there is not None:
                known += 1
                continue
            judged = entry.outcome in ("verified_success", "verified_fail")
            tx.put(record, action="import", origin=str(Origin(trusted, source)) if judged else "")
            new[record.id] = record
        _link(tx, entries, ids, new)
    held = sum(record.state == "provisional" for record in new.values())
    return Imported(found, tuple(new), known, held, tuple(remarks))


def _record(entry: Entry, layout: str, bank: str, now: float, origin: Origin) -> Record:
    effect = entry.ours.get("effect")
    effect = effect if isinstance(effect, dict) else None
    skill = clean(str(entry.ours.get("skill") or ""), 64)
    told = entry.ours.get("signature")
    signature = told if isinstance(told, dict) else {}
    key = dedup_key(entry.type, entry.content, skill, effect)
    screened = screen(f"{entry.query}\n{entry.content}")
    trust: Trust = trust_of([origin], screened=bool(screened))
    if origin.own and entry.ours.get("trust") in LEVELS:
        trust = min(trust, str(entry.ours["trust"]), key=LEVELS.index)  # type: ignore[arg-type]
    state, note = entry.state, ""
    if not believed(trust) and state != "archive":
        state, note = "provisional", screened or "it was imported, and nobody here has borne it out yet"
    created = now if entry.created is None else min(entry.created, now)
    used = min(entry.used or 0.0, now)
    return Record(
        id=record_id(entry.type, bank, key),
        bank=bank,
        query=entry.query,
        content=entry.content,
        type=entry.type,
        state=state,
        outcome=entry.outcome,
        confidence=entry.confidence,
        quality=entry.quality,
        dedup_key=key,
        created=created,
        updated=max(created, used),
        used=used,
        count=max(count(entry.ours.get("count")), 1),
        usage=entry.usage,
        recalled=max(entry.usage, count(entry.ours.get("recalled"))),
        verifier=dump(dict(entry.verifier)),
        signature=dump(finite({k: v for k, v in signature.items() if isinstance(v, int | float)})),
        skill=skill,
        effect=dump(effect) if effect else "",
        provenance=dump(
            {
                "made_by": {"import": layout},
                "sources": [clean(entry.task_id, 200)] if entry.task_id else [],
                "key": clean(entry.key, 1000),
            }
        ),
        note=note,
        trust=trust,
    )


def _link(tx: Transaction, entries: Sequence[Entry], ids: dict[str, str], new: dict[str, Any]) -> None:
    """Links among the lessons that are new."""
    for entry in entries:
        for kind, targets in (("replaces", entry.supersedes), ("conflict", entry.conflicts)):
            for target in dict.fromkeys(targets):
                if ids[entry.key] in new and ids.get(target, ids[entry.key]) != ids[entry.key]:
                    tx.link(ids[entry.key], kind, ids[target], why="imported")


def read_path(path: Path, layout: str = "") -> tuple[str, list[Entry], list[Remark]]:
    """The layout of a file or folder, all its lessons, and remarks on its lines, broken ones included.

    ``layout`` "" looks at the lines themselves. Raises :class:`MemoryStoreError` when there is nothing to read,
    or it is of no known layout.
    """
    if layout and layout not in READERS:
        raise ConfigurationError(f"No memory layout '{layout}'. Available: {', '.join(READERS)}.")
    lines: list[Line] = []
    remarks: list[Remark] = []
    try:
        for file in _files(path):
            found, broken = read_lines(file)
            lines += found
            remarks += broken
    except OSError as error:  # a folder that may not be looked into
        raise MemoryStoreError(f"Cannot read {path}: {error.strerror or error}.") from error
    chosen = layout or _layout_of(path, lines, bool(remarks))
    entries = []
    for line in lines:
        try:
            made = READERS[chosen][1](line)
        except (LineError, ValueError, OverflowError, RecursionError) as error:  # the others are read
            remarks.append(Remark(line.file, line.number, str(error)))
            continue
        entries += made
        remarks += [Remark(line.file, line.number, note, broken=False) for e in made for note in e.notes]
    return chosen, entries, remarks


def _files(path: Path) -> list[Path]:
    if not os.path.exists(path):  # noqa: PTH110  # Path.exists raises for names that no file system takes
        raise MemoryStoreError(
            f"There is nothing at {path}. Give a .jsonl file, or a folder with active.jsonl."
        )
    if not path.is_dir():  # a pipe is read like a file: `... | gvla2 memory import /dev/stdin`
        return [path]
    folders = [
        path,
        *sorted(inner for inner in path.iterdir() if inner.is_dir()),
    ]  # the releases' own: ROOT/MODEL
    found = [files for folder in folders if (files := _states(folder))]
    if len(found) == 1 or (found and found[0][0].parent == path):
        return found[0]
    which = (
        f" It has {', '.join(files[0].parent.name for files in found)}: give one of them." if found else ""
    )
    raise MemoryStoreError(
        f"{path} has no active.jsonl, provisional.jsonl, summary.jsonl or archive.jsonl.{which} "
        "Of another layout give the file."
    )


def _states(folder: Path) -> list[Path]:
    return [path for state in STATES if (path := folder / f"{state}.jsonl").is_file()]


def _layout_of(path: Path, lines: Sequence[Line], broken: bool) -> str:
    """The layout of the first line that fits one; an empty memory fits the first."""
    for line in lines:
        for name, (fields, _) in READERS.items():
            if all(field in line.fields for field in fields):
                return name
    if not lines and (path.is_dir() or not broken):
        return "states"
    raise MemoryStoreError(
        f"{path} is of no known layout: no line has memory_id and content, memory_items, or memory_text and "
        f"task_text. Layouts: {', '.join(READERS)}."
    )
