"""Export of a bank as a folder of JSON lines, atomically. Nothing is ever replaced."""

from __future__ import annotations

import shutil
import tempfile
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from gvla2.errors import OutputError
from gvla2.io.files import write_whole
from gvla2.memory.interop.states import STATES, to_bytes, write_record
from gvla2.memory.storage.store import Store


@dataclass(frozen=True)
class Exported:
    """The files written, their lines (one per record), and how many records of other states were left out."""

    files: tuple[Path, ...]
    records: int
    left_out: int


def export_path(store: Store, bank: str, path: Path, *, states: Sequence[str] | None = None) -> Exported:
    """Write the records of a bank, those in ``states`` (all by default), to a new folder.

    Raises :class:`OutputError` when the path is taken or cannot be written; nothing is left there then.
    """
    with store.reading(bank) as view:
        everything, links = view.records(), view.links()
    shown = [record for record in everything if states is None or record.state in states]
    targets: dict[str, dict[str, list[str]]] = defaultdict(lambda: defaultdict(list))
    for link in links:
        targets[link.source][link.kind].append(link.target)
    try:
        if path.exists() or path.is_symlink():
            raise OutputError(
                f"{path} already exists, and an export never replaces anything. Choose another path."
            )
        aside = Path(tempfile.mkdtemp(prefix=f".{path.name}.", dir=path.parent))
        try:
            fresh = aside / "new"
            fresh.mkdir()
            for state in STATES:
                rows = [
                    write_record(r, targets[r.id])
                    for r in sorted(shown, key=lambda r: (r.created, r.id))
                    if r.state == state
                ]
                write_whole(fresh / f"{state}.jsonl", to_bytes(rows))
            fresh.rename(path)
        finally:
            shutil.rmtree(aside, ignore_errors=True)
    except (OSError, RuntimeError) as error:  # RuntimeError: a circular link
        raise OutputError(f"Cannot write {path}: {getattr(error, 'strerror', '') or error}.") from error
    files = tuple(path / f"{state}.jsonl" for state in STATES)
    return Exported(files, len(shown), len(everything) - len(shown))
