"""The verbs of `gvla2 memory` that change a bank: import, export, forget, compact, repair, govern, replay."""

from __future__ import annotations

import os
import sys
import time
from pathlib import Path
from typing import Any

from gvla2.commands.memory_access import VerbRequest, WrongWordError, opened, opened_bank, record_of
from gvla2.commands.memory_answers import Answer
from gvla2.commands.tables import row, table
from gvla2.errors import MemoryStoreError
from gvla2.memory.interop.exporting import export_path
from gvla2.memory.interop.importing import import_path
from gvla2.memory.storage.audit import repair as mend
from gvla2.record.files import plain
from gvla2.record.text import count, one_line, printable

MOST_REMARKS = 20


def import_(request: VerbRequest) -> Answer:
    """Read a memory of the released layout; 1 when lines could not be read (the others are stored)."""
    config = request.config
    path = Path("/dev/stdin" if request.words[0] == "-" else request.words[0]).expanduser()
    if not os.path.exists(path):  # noqa: PTH110  # before a database is made for nothing; see read_path
        raise MemoryStoreError(
            f"There is nothing at {path}. Give a .jsonl file, or a folder with active.jsonl."
        )
    with opened(request, create=True) as store:
        done = import_path(store, config.bank, path, trusted=config.trusted, actor="gvla2 memory")
    told = [
        f"New in the bank '{config.bank}': {count(len(done.added), 'record')}; known already: {done.known}."
    ]
    if done.held_back:
        own = "." if config.trusted else " (trusted=true is for your own backup)."
        told.append(
            f"Provisional until verified episodes of two sources, or one of ours, confirm them: {done.held_back}{own}"
        )
    odd = [remark for remark in done.remarks if not remark.broken]
    for what, remarks in (("could not be read", done.broken), ("read with a remark", odd)):
        if remarks:
            told.append(f"{count(len(remarks), 'line')} {what}:")
        told += [str(remark) for remark in remarks[:MOST_REMARKS]]
        if len(remarks) > MOST_REMARKS:
            told.append(f"{count(len(remarks) - MOST_REMARKS, 'more line')}; --json has all.")
    return Answer(done, told, status=1 if done.broken else 0)


def export(request: VerbRequest) -> Answer:
    """Write the bank in the released layout."""
    config, path = request.config, Path(request.words[0]).expanduser()
    with opened(request) as store:
        # The states were checked by the configuration.
        done = export_path(store, config.bank, path, states=config.states or None)
    files = ", ".join(str(file) for file in done.files)
    told = [f"{count(done.records, 'record')}: {files}."]
    if done.left_out:
        told.append(f"Left out: {count(done.left_out, 'record')} of other states; states=[...] chooses.")
    return Answer(done, told)


def forget(request: VerbRequest) -> Answer:
    """Forget records for good, after asking."""
    with opened(request) as store:
        words = dict.fromkeys(request.words)
        with store.reading(request.bank) as view:
            records = [record_of(view, word, whole=request.yes) for word in words]
        if not request.yes:
            for record in records:
                print(f"{printable(record.id)}: {one_line(record.content, 200)}", file=sys.stderr)
            if not _confirmed(len(records)):
                return Answer({"forgotten": []}, ["Nothing was forgotten."], status=1)
        with store.writing(request.bank, actor="gvla2 memory", now=time.time()) as tx:
            gone = tx.forget(*(record.id for record in records), why="asked for")
    told = [f"Forgotten for good: {', '.join(gone) or 'nothing'}.", *tx.also]
    return Answer({"forgotten": gone, "also": tx.also}, told)


def _confirmed(count: int) -> bool:
    if not sys.stdin.isatty():
        raise WrongWordError("Forgetting cannot be undone, and there is no terminal to ask on: add --yes.")
    what = "it" if count == 1 else f"these {count}"
    print(f"Forget {what} for good? It cannot be undone. [y/N] ", end="", file=sys.stderr, flush=True)
    return sys.stdin.readline().strip().casefold() in ("y", "yes")


def compact(request: VerbRequest) -> Answer:
    """Free space; with archived_days=N also forget records archived for longer."""
    days, now = request.config.archived_days, time.time()
    gone: list[str] = []
    with opened(request) as store:
        before = store.stats(request.bank)["bytes"]
        if days is not None:
            with store.writing(request.bank, actor="gvla2 memory", now=now) as tx:
                held = tx.records(["archive"])
                old = [record.id for record in held if record.updated < now - days * 86400.0]
                gone = tx.forget(*old, why="archived long ago")
        if not gone:  # else forgetting has already freed the space
            store.compact()
        after = store.stats(request.bank)["bytes"]
    told = f"{before / 1e6:.2f} MB before, {after / 1e6:.2f} MB now"
    if days is not None:
        told += f"; forgotten: {count(len(gone), 'archived record')}"
    return Answer({"bytes_before": before, "bytes": after, "forgotten": len(gone)}, [f"{told}."])


def repair(request: VerbRequest) -> Answer:
    """Restore rows, vectors and links from the events; returns 1 when something is still wrong."""
    with opened_bank(request) as bank, opened(request) as store:
        with store.writing(request.bank, actor="gvla2 memory", now=time.time()) as tx:
            records, forgotten = mend(tx, bank.embedder)
        left = bank.verify()
    told = [f"Restored from the events: {', '.join(records) or 'nothing'}."]
    if forgotten:
        told.append(f"Removed, because no event created it: {', '.join(forgotten)}.")
    told += [f"Still wrong: {problem}" for problem in left]
    return Answer({"repaired": records, "forgotten": forgotten, "problems": left}, told, int(bool(left)))


def govern(request: VerbRequest) -> Answer:
    """One pass over the whole bank: stale failures, conflicts, summaries, the budget."""
    with opened_bank(request) as bank:
        return _changes(bank.govern(), "The bank needs no changes.")


def replay(request: VerbRequest) -> Answer:
    """Verify stored episodes again: provisional, contested or low-confidence records."""
    verifier = request.registry.build(request.config, "verifier")
    with opened_bank(request) as bank:
        return _changes(bank.replay(verifier), "No stored episode changed a record.")


def _changes(made: Any, nothing: str) -> Answer:
    """A pass's changes: a line for each non-empty field of its result."""
    data = plain(made)
    listing = table("what", "which")
    for name, value in (data if isinstance(data, dict) else {"changes": data}).items():
        for item in value if isinstance(value, list) else [value]:
            words = ", ".join(f"{k} {v}" for k, v in item.items()) if isinstance(item, dict) else str(item)
            if item not in (0, None, "", {}, []):
                row(listing, name, one_line(words, 300))
    return Answer(data, [listing] if listing.row_count else [nothing])
