"""A bank as a foreign memory: whole on disk, or not there."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from gvla2.errors import OutputError
from gvla2.memory.contracts import LifecycleState
from gvla2.memory.interop import items_layout, states_layout
from gvla2.memory.interop.entry import STATES, Entry
from gvla2.memory.interop.lines import to_bytes
from gvla2.memory.interop.reading import Layout, layout_named
from gvla2.memory.interop.replacing import place_of
from gvla2.memory.records import Record
from gvla2.memory.storage.store import Store
from gvla2.writing import write_whole

SERVED: tuple[LifecycleState, ...] = ("active", "summary")
"""What a layout without lifecycle states gets: whoever reads it takes every line for good."""


@dataclass(frozen=True)
class Exported:
    """The files written, their lines and records, and how many records of other states were left out."""

    layout: str
    files: tuple[Path, ...]
    lines: int
    records: int
    left_out: int


def export_path(
    store: Store,
    bank: str,
    path: Path,
    *,
    layout: str = states_layout.NAME,
    states: Sequence[LifecycleState] | None = None,
    overwrite: bool = False,
) -> Exported:
    """Write the records of a bank that are in ``states``: a folder for ``states``, a file for the other layouts.

    By default that is all of them where the layout has lifecycle states, else :data:`SERVED`. A record that came
    from a line of this layout is written as that line was, unknown fields included, save what has changed since.
    Raises :class:`OutputError` when the path is taken (``overwrite`` allows to replace an earlier export, and nothing
    else) or cannot be written; what was there is then still there.
    """
    chosen = layout_named(layout)
    served = tuple(states) if states is not None else STATES if chosen.name == states_layout.NAME else SERVED
    path = place_of(path, chosen, store.name, overwrite=overwrite)
    everything = store.records(bank)
    shown = [record for record in everything if record.state in served]
    groups = _lines(store, bank, shown, everything, chosen)
    rows: dict[str, list[dict[str, Any]]] = {}
    for group in groups:
        rows.setdefault(group[0].state, []).append(chosen.write(group))
    if chosen.name == states_layout.NAME:
        files = _write_folder(path, {f"{state}.jsonl": to_bytes(rows.get(state, [])) for state in STATES})
    else:
        write_whole(path, to_bytes(chosen.write(group) for group in groups))
        files = (path,)
    return Exported(chosen.name, files, len(groups), len(shown), len(everything) - len(shown))


def _lines(
    store: Store, bank: str, shown: Iterable[Record], everything: Iterable[Record], layout: Layout
) -> list[list[Entry]]:
    """The records as entries, those of one line together, in the order that they were read in."""
    keys = {record.id: _foreign_key(record, layout) or record.id for record in everything}
    targets: dict[tuple[str, str], list[str]] = {}
    for link in store.links(bank):
        if link.target in keys:
            targets.setdefault((link.source, link.kind), []).append(keys[link.target])
    there = set(keys.values())
    groups: dict[tuple[Any, ...], list[Entry]] = {}
    for record in sorted(shown, key=lambda r: _order(r, layout)):
        trace = _trace(record)
        came = trace if trace.get("layout") == layout.name else {}
        entry = _entry(record, keys[record.id], came, targets, there, layout)
        together = layout.name == items_layout.NAME and came
        at = (trace.get("file"), trace.get("line"), record.outcome) if together else (record.id,)
        groups.setdefault(at, []).append(entry)
    return list(groups.values())


def _entry(
    record: Record,
    key: str,
    trace: Mapping[str, Any],
    targets: Mapping[tuple[str, str], list[str]],
    there: set[str],
    layout: Layout,
) -> Entry:
    before = states_layout.links_of(trace) if layout.name == states_layout.NAME else ((), ())
    supersedes, conflicts = (
        # Old ids in their old order, those that nothing here has among them; what is new comes last.
        tuple(dict.fromkeys([*(t for t in old if t in now or t not in there), *now]))
        for old, now in zip(
            before, (targets.get((record.id, kind), []) for kind in ("replaces", "conflict")), strict=True
        )
    )
    return Entry(
        key=key,
        task_id=next(iter(record.sources()), ""),
        query=record.query,
        content=record.content,
        type=record.record_type,
        state=record.lifecycle,
        outcome=record.verified_as,
        quality=record.quality,
        confidence=record.confidence,
        usage=record.usage,
        created=record.created,
        used=record.used or None,
        supersedes=supersedes,
        conflicts=conflicts,
        verifier=record.verifier_json(),
        trace=trace,
    )


def _trace(record: Record) -> dict[str, Any]:
    trace = record.provenance_json().get("imported")
    return trace if isinstance(trace, dict) else {}


def _foreign_key(record: Record, layout: Layout) -> str:
    trace = _trace(record)
    return str(trace.get("key", "")) if trace.get("layout") == layout.name else ""


def _order(record: Record, layout: Layout) -> tuple[Any, ...]:
    """Imported lines first, in their order; then what was learnt here, oldest first."""
    trace = _trace(record)
    if trace.get("layout") != layout.name:
        return (1, "", record.created, 0, 0, record.id)
    at = trace.get("at") or [0, 0]
    return (0, str(trace.get("file")), float(trace.get("line", 0)), int(at[0]), int(at[1]), record.id)


def _write_folder(target: Path, files: Mapping[str, bytes]) -> tuple[Path, ...]:
    """All files aside in one folder, then the folder in its place."""
    target = target.absolute()
    try:
        aside = Path(tempfile.mkdtemp(prefix=f".{target.name}.", dir=target.parent))
    except OSError as error:
        raise OutputError(
            f"Cannot write in the folder '{target.parent}': {error.strerror or error}."
        ) from error
    try:
        fresh = aside / "new"
        fresh.mkdir()
        for name, content in files.items():
            write_whole(fresh / name, content)
        if target.exists():
            target.replace(aside / "old")
        try:
            fresh.replace(target)
        except OSError:
            if (aside / "old").exists():
                (aside / "old").replace(target)
            raise
    except OSError as error:
        raise OutputError(f"Cannot write '{target}': {error.strerror or error}.") from error
    finally:
        shutil.rmtree(aside, ignore_errors=True)
    _flush(target.parent)
    return tuple(target / name for name in files)


def _flush(folder: Path) -> None:
    """Make the new name durable, where the system lets a folder be flushed."""
    try:
        handle = os.open(folder, os.O_RDONLY)
    except OSError:
        return
    try:
        os.fsync(handle)
    except OSError:
        pass
    finally:
        os.close(handle)
