"""Foreign memories into a bank, in one transaction."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from gvla2.memory.contracts import LifecycleState
from gvla2.memory.interop.entry import Entry
from gvla2.memory.interop.lines import Remark
from gvla2.memory.interop.reading import read_path
from gvla2.memory.records import Record, clean, dedup_key, dump, record_id
from gvla2.memory.screening.instructions import screen
from gvla2.memory.storage.store import Store
from gvla2.memory.storage.transaction import Transaction


@dataclass(frozen=True)
class Imported:
    """What became of a path: ids of the records that are new, how many lessons the bank ``known`` already had,
    how many of the new ones are ``quarantined``, and remarks on lines.
    """

    layout: str
    added: tuple[str, ...]
    known: int
    quarantined: int
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
    provisional: bool = False,
    actor: str = "import",
    now: float | None = None,
) -> Imported:
    """Read a file or folder into ``bank``; a path that was imported before adds nothing.

    Records keep the lifecycle state that they had; ``provisional`` holds all that are not archived back until they
    are verified here. Text that reads like instructions is held back always. The bank embeds what is new when it is
    asked next; what a layout brings of embeddings is of unknown models and is only kept for export.
    Raises :class:`MemoryStoreError` when the path or the store cannot be read; nothing is stored then.
    """
    found, entries, remarks = read_path(path, layout)
    at = time.time() if now is None else now
    batch = _Batch(bank, at, provisional)
    with store.writing(bank, actor=actor, now=at) as tx:
        for entry in entries:
            batch.put(tx, entry)
        batch.link(tx, entries)
    return Imported(found.name, tuple(batch.added), batch.known, batch.quarantined, tuple(remarks))


class _Batch:
    """The lessons of one path on their way into a transaction."""

    def __init__(self, bank: str, now: float, provisional: bool) -> None:
        self.bank, self.now, self.provisional = bank, now, provisional
        self.added: list[str] = []
        self.known = self.quarantined = 0
        self._ids: dict[str, str] = {}
        self._new: set[str] = set()

    def put(self, tx: Transaction, entry: Entry) -> None:
        """Store a lesson unless the bank has it: the same words, or the same line of the same source."""
        key = dedup_key(entry.type, entry.content, "", None)
        known = tx.by_key(key)
        if known is not None and (source := _source_of(known)) and source != _source(entry):
            # Another line of that memory says the same words; each keeps its own line, governance may merge them.
            key = dedup_key(entry.type, dump([key, *_source(entry)]), "", None)
            known = tx.by_key(key)
        if known is not None:
            self.known += 1
            self._ids.setdefault(entry.key, known.id)
            return
        record = self._record(entry, key)
        why = f"{entry.trace['file']}, line {entry.trace['line']}"
        tx.put(record, action="import", why=why)
        self.added.append(record.id)
        self._ids.setdefault(entry.key, record.id)
        self._new.add(entry.key)

    def link(self, tx: Transaction, entries: Sequence[Entry]) -> None:
        """Links among the lessons that are new; ids that nothing here has stay in what is kept of the line."""
        for entry in entries:
            if entry.key not in self._new:
                continue
            for kind, targets in (("replaces", entry.supersedes), ("conflict", entry.conflicts)):
                for target in dict.fromkeys(targets):
                    if target in self._ids and self._ids[target] != self._ids[entry.key]:
                        tx.link(self._ids[entry.key], kind, self._ids[target], why="imported")

    def _record(self, entry: Entry, key: str) -> Record:
        state, note = entry.state, ""
        if screen(f"{entry.query}\n{entry.content}"):
            self.quarantined += 1
            state, note = _held_back(state), "quarantined: the text reads like instructions"
        elif self.provisional:
            state, note = _held_back(state), "imported, not verified here"
        created = self.now if entry.created is None else min(entry.created, self.now)
        used = min(entry.used or 0.0, self.now)
        return Record(
            id=record_id(entry.type, self.bank, key),
            bank=self.bank,
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
            usage=entry.usage,
            recalled=entry.usage,
            verifier=clean(dump(dict(entry.verifier) or {}), 10**7),
            provenance=dump(
                {
                    "made_by": {"import": str(entry.trace["layout"])},
                    "sources": [clean(entry.task_id, 200)] if entry.task_id else [],
                    "imported": {**_storable(entry), "key": clean(entry.key, 1000)},
                }
            ),
            note=note,
        )


def _held_back(state: LifecycleState) -> LifecycleState:
    return state if state == "archive" else "provisional"


def _storable(entry: Entry) -> dict[str, object]:
    return {
        name: clean(value, 10**8) if isinstance(value, str) else value for name, value in entry.trace.items()
    }


def _source(entry: Entry) -> tuple[str, str]:
    """What tells a line of a memory from the others, wherever the file lies now."""
    return str(entry.trace["layout"]), clean(entry.key, 1000)


def _source_of(record: Record) -> tuple[str, str] | None:
    try:
        imported = record.provenance_json().get("imported")
    except ValueError:
        return None
    if not isinstance(imported, dict):
        return None
    return str(imported.get("layout")), str(imported.get("key"))
