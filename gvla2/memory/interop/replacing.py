"""What an export may replace: an earlier export, and nothing else."""

from __future__ import annotations

from pathlib import Path

from gvla2.errors import OutputError
from gvla2.memory.interop import states_layout
from gvla2.memory.interop.entry import STATES
from gvla2.memory.interop.lines import LineError, parse, raw_lines
from gvla2.memory.interop.reading import Layout

_LOGS = ("-wal", "-shm", "-journal")


def place_of(path: Path, layout: Layout, database: str, *, overwrite: bool) -> Path:
    """Where to write what was to be written to ``path``: itself, or where it leads as a link.

    ``database`` is the name of the store that is exported. Raises :class:`OutputError` for a path that is taken: by
    a database or what belongs to one, a device, a pipe, files that are no export of this layout, or an export
    without ``overwrite``.
    """
    try:
        target = path.resolve()
        _refuse_databases(path, target, database)
        if not target.exists() and path.exists():  # /dev/stdout leads to a pipe without a name
            raise OutputError(f"{path} is no file that could be replaced. Choose another path.")
        if not target.exists():
            return target
        folder = layout.name == states_layout.NAME
        if folder and target.is_dir():
            _refuse_other_files(path, target)
            taken = any(target.iterdir())
            for file in sorted(target.iterdir()):
                _refuse_other_content(file, layout)
        elif folder or not target.is_file():
            what = "a folder" if folder else "a file"
            raise OutputError(
                f"The layout '{layout.name}' is {what}, and {path} is {_kind(target)}. Choose another path."
            )
        else:
            taken = True
            _refuse_other_content(target, layout)
    except (OSError, RuntimeError) as error:  # RuntimeError: a link that leads to itself
        said = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
        raise OutputError(f"Cannot look at {path}: {said}. Choose another path.") from error
    if taken and not overwrite:
        raise OutputError(f"{path} exists. Choose another path, or say overwrite=true to replace it.")
    return target


def _refuse_databases(path: Path, target: Path, database: str) -> None:
    """A log that does not lie there now would be read as a database's own as soon as it does."""
    owners = [target.with_name(target.name.removesuffix(s)) for s in _LOGS if target.name.endswith(s)]
    owner = next((file for file in owners if file.is_file()), None)
    if "://" not in database:
        own = Path(database).resolve()
        if target == own or (target.exists() and own.exists() and target.samefile(own)):
            raise OutputError(f"{path} is the database that is to be exported. Choose another path.")
        beside = tuple(f"{own.name}{end}" for end in (*_LOGS, ".index-", ".before-schema-"))
        if target.parent == own.parent and target.name.startswith((*beside, f".{own.name}.")):
            owner = own
    if owner is not None:
        raise OutputError(f"{path} belongs to the database {owner}. Choose another path.")


def _refuse_other_files(path: Path, folder: Path) -> None:
    others = sorted({file.name for file in folder.iterdir()} - {f"{state}.jsonl" for state in STATES})
    if others:
        raise OutputError(
            f"The folder {path} has other files ({', '.join(others[:3])}). Choose another path."
        )


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
