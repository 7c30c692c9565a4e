"""A bank as a foreign memory: whole on disk, or not there. An earlier export may be replaced, and nothing else."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from gvla2.errors import OutputError
from gvla2.memory.contracts import LifecycleState
from gvla2.memory.interop.layouts import STATES, Layout, Told, layout_named
from gvla2.memory.interop.lines import LineError, parse, raw_lines, to_bytes
from gvla2.memory.storage.store import Store
from gvla2.writing import write_whole

SERVED: tuple[LifecycleState, ...] = ("active", "summary")
"""What a layout without lifecycle states gets: whoever reads it takes every line for good."""
_LOGS = ("-wal", "-shm", "-journal")


@dataclass(frozen=True)
class Exported:
    """The files written, their lines (one a record), and how many records of other states were left out."""

    layout: str
    files: tuple[Path, ...]
    records: int
    left_out: int


def export_path(
    store: Store,
    bank: str,
    path: Path,
    *,
    layout: str = "states",
    states: Sequence[LifecycleState] | None = None,
    overwrite: bool = False,
) -> Exported:
    """Write the records of a bank that are in ``states``: a folder for ``states``, a file for the other layouts.

    By default that is all of them where the layout has lifecycle states, else :data:`SERVED`. Raises
    :class:`OutputError` when the path is taken (``overwrite`` allows to replace an earlier export, and nothing else) or
    cannot be written; what was there is then still there.
    """
    chosen = layout_named(layout)
    folder = chosen.name == "states"
    served = tuple(states) if states is not None else STATES if folder else SERVED
    target = _place(path, chosen, store.name, overwrite=overwrite)
    everything = store.records(bank)
    shown = [record for record in everything if record.state in served]
    targets: dict[tuple[str, str], list[str]] = {}
    for link in store.links(bank):
        targets.setdefault((link.source, link.kind), []).append(link.target)
    lines = {
        state: [
            chosen.write(
                Told(r, *(tuple(targets.get((r.id, kind), ())) for kind in ("replaces", "conflict")))
            )
            for r in sorted(shown, key=lambda r: (r.created, r.id))
            if r.state == state
        ]
        for state in STATES
    }
    if folder:
        files = _write_folder(target, {f"{state}.jsonl": to_bytes(rows) for state, rows in lines.items()})
    else:
        write_whole(target, to_bytes(row for rows in lines.values() for row in rows))
        files = (target,)
    return Exported(chosen.name, files, len(shown), len(everything) - len(shown))


def _write_folder(target: Path, files: Mapping[str, bytes]) -> tuple[Path, ...]:
    """All files aside in one folder, then the folder in its place."""
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
    return tuple(target / name for name in files)


# What may be replaced -------------------------------------------------------------------------------------------------


def _place(path: Path, layout: Layout, database: str, *, overwrite: bool) -> Path:
    """Where to write what was to be written to ``path``: itself, or where it leads as a link.

    ``database`` is the name of the store that is exported. Raises :class:`OutputError` for a path that is taken: by
    a database or what belongs to one, a device, a pipe, files that are no export of this layout, or an export
    without ``overwrite``.
    """
    folder = layout.name == "states"
    try:
        target = path.resolve()
        _refuse_databases(path, target, database)
        if not target.exists():
            if path.exists():  # /dev/stdout leads to a pipe without a name
                raise OutputError(f"{path} is no file that could be replaced. Choose another path.")
            return target
        if not (target.is_dir() if folder else target.is_file()):
            what = "a folder" if folder else "a file"
            raise OutputError(
                f"The layout '{layout.name}' is {what}, and {path} is {_kind(target)}. Choose another path."
            )
        files = sorted(target.iterdir()) if folder else [target]
        others = [
            file.name for file in files if folder and file.name not in {f"{state}.jsonl" for state in STATES}
        ]
        if others:
            raise OutputError(
                f"The folder {path} has other files ({', '.join(others[:3])}). Choose another path."
            )
        for file in files:
            _refuse_other_content(file, layout)
    except (OSError, RuntimeError) as error:  # RuntimeError: a link that leads to itself
        said = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
        raise OutputError(f"Cannot look at {path}: {said}. Choose another path.") from error
    if files and not overwrite:
        raise OutputError(f"{path} exists. Choose another path, or say overwrite=true to replace it.")
    return target


def _refuse_databases(path: Path, target: Path, database: str) -> None:
    """A log that does not lie there now would be read as a database's own as soon as it does."""
    owners = [target.with_name(target.name.removesuffix(s)) for s in _LOGS if target.name.endswith(s)]
    owner = next((file for file in owners if file.is_file()), None)
    own = Path(database)
    if own.is_file():
        if target == own.resolve() or (target.exists() and target.samefile(own)):
            raise OutputError(f"{path} is the database that is to be exported. Choose another path.")
        beside = (*(f"{own.name}{end}" for end in _LOGS), f".{own.name}.")
        if target.parent == own.resolve().parent and target.name.startswith(beside):
            owner = own
    if owner is not None:
        raise OutputError(f"{path} belongs to the database {owner}. Choose another path.")


def _refuse_other_content(file: Path, layout: Layout) -> None:
    """Every line of an earlier export reads as its layout; a database, a picture or somebody's notes do not."""
    if file.is_symlink() or not file.is_file():
        raise OutputError(f"{file} is {_kind(file)}, not a file that an export wrote. Choose another path.")
    with file.open("rb") as stream:
        for number, raw in raw_lines(stream):
            try:
                fits = layout.fits(parse(raw))
            except LineError:
                fits = False
            if not fits:
                raise OutputError(
                    f"{file} is no export of the layout '{layout.name}' (line {number}), and is left as it is. "
                    "Choose another path."
                )


def _kind(path: Path) -> str:
    if path.is_symlink():
        return "a link"
    if path.is_dir():
        return "a folder"
    return "a file" if path.is_file() else "a device, a pipe or a socket"
