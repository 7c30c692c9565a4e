"""The verbs of `gvla2 memory` that change a bank: import, export, forget, compact, govern, replay."""

from __future__ import annotations

import sys
import time
from pathlib import Path
from typing import Any

from gvla2.commands.memory_access import Request, WrongWordError, opened, opened_bank, record_of
from gvla2.commands.memory_answers import Answer, one_line, plain, printable
from gvla2.commands.tables import row, table
from gvla2.errors import MemoryStoreError
from gvla2.memory.interop.exporting import export_path
from gvla2.memory.interop.importing import import_path

MOST_REMARKS = 20


def import_(request: Request) -> Answer:
    """Read a memory of the released layouts; 1 when lines could not be read (the others are stored)."""
    config, path = request.config, Path(request.words[0]).expanduser()
    if not path.exists():
        raise MemoryStoreError(
            f"There is nothing at {path}. Give a .jsonl file, or a folder with active.jsonl."
        )
    with opened(request, create=True) as store:
        done = import_path(
            store,
            config.bank,
            path,
            layout=config.layout,
            provisional=config.provisional,
            actor="gvla2 memory",
        )
    told = [
        f"{len(done.added)} records of the layout '{done.layout}' are new in the bank '{config.bank}'; "
        f"{done.known} were known."
    ]
    if done.quarantined:
        told.append(f"{done.quarantined} read like instructions: they are provisional.")
    told += [printable(str(remark)) for remark in done.remarks[:MOST_REMARKS]]
    if len(done.remarks) > MOST_REMARKS:
        told.append(f"{len(done.remarks) - MOST_REMARKS} more remarks; --json has all.")
    if done.broken:
        told.append(f"{len(done.broken)} lines could not be read.")
    return Answer(done, told, status=1 if done.broken else 0)


def export(request: Request) -> Answer:
    """Write the bank in one of the released layouts."""
    config, path = request.config, Path(request.words[0]).expanduser()
    with opened(request) as store:
        done = export_path(
            store,
            config.bank,
            path,
            layout=config.layout or "states",
            states=config.states or None,  # type: ignore[arg-type]  # checked by the configuration
            overwrite=config.overwrite,
        )
    told = [f"{done.records} records in {done.lines} lines: {', '.join(map(str, done.files))}."]
    if done.left_out:
        told.append(f"{done.left_out} records of other states were left out; states=[...] chooses.")
    return Answer(done, told)


def forget(request: Request) -> Answer:
    """Forget records for good, after asking."""
    with opened(request) as store:
        records = [record_of(store, request.bank, word) for word in dict.fromkeys(request.words)]
        if not request.yes:
            for record in records:
                print(f"{printable(record.id)}: {one_line(record.content, 200)}", file=sys.stderr)
            if not _confirmed(len(records)):
                return Answer({"forgotten": []}, ["Nothing was forgotten."], status=1)
        with store.writing(request.bank, actor="gvla2 memory", now=time.time()) as tx:
            gone = [record.id for record in records if tx.forget(record.id, why="asked for")]
    return Answer({"forgotten": gone}, [f"Forgotten for good: {', '.join(gone) or 'nothing'}."])


def _confirmed(count: int) -> bool:
    if not sys.stdin.isatty():
        raise WrongWordError("Forgetting cannot be undone and nobody can be asked here: say --yes.")
    what = "it" if count == 1 else f"these {count}"
    print(f"Forget {what} for good? It cannot be undone. [y/N] ", end="", file=sys.stderr, flush=True)
    return sys.stdin.readline().strip().casefold() in ("y", "yes")


def compact(request: Request) -> Answer:
    """Give space back; with archived_days=N forget what has been archived for longer, too."""
    days, now = request.config.archived_days, time.time()
    with opened(request) as store:
        before = store.stats(request.bank)["bytes"]
        if days is None:
            gone = store.compact()
        else:
            gone = store.compact(
                request.bank, archived_before=now - days * 86400.0, now=now, actor="gvla2 memory"
            )
        after = store.stats(request.bank)["bytes"]
    told = f"{before / 1e6:.2f} MB before, {after / 1e6:.2f} MB now"
    if days is not None:
        told += f"; {gone} archived records were forgotten"
    return Answer({"bytes_before": before, "bytes": after, "forgotten": gone}, [f"{told}."])


def govern(request: Request) -> Answer:
    """One pass over the whole bank: stale failures, conflicts, summaries, the budget."""
    with opened_bank(request) as bank:
        return _changes(bank.govern(), "The bank needs no changes.")


def replay(request: Request) -> Answer:
    """Verify stored episodes again: what is provisional, contested or of low confidence."""
    verifier = request.registry.build(request.config, "verifier")
    with opened_bank(request) as bank:
        return _changes(bank.replay(verifier), "No stored episode changed a record.")


def _changes(made: Any, nothing: str) -> Answer:
    """What a pass has done: a line for each field of its result that says something."""
    data = plain(made)
    listing = table("what", "which")
    for name, value in (data if isinstance(data, dict) else {"changes": data}).items():
        for item in value if isinstance(value, list) else [value]:
            words = ", ".join(f"{k} {v}" for k, v in item.items()) if isinstance(item, dict) else str(item)
            if item not in (0, None, "", {}, []):
                row(listing, name, one_line(words, 300))
    return Answer(data, [listing] if listing.row_count else [nothing])
