"""Files that are written whole or not at all, and values as strict JSON."""

from __future__ import annotations

import json
import math
import os
import tempfile
from collections.abc import Mapping, Sequence
from collections.abc import Set as AbstractSet
from dataclasses import fields, is_dataclass
from enum import Enum
from pathlib import Path
from typing import Any

from gvla2.errors import OutputError


def write_whole(path: str | os.PathLike[str], content: bytes | bytearray, *, flushed: bool = True) -> None:
    """Write aside in the same folder, then replace: a reader, or a crash, never meets half a file.

    Unless ``flushed`` to the disk, which takes milliseconds, a crash of the whole machine may leave it empty.
    Raises :class:`OutputError` when the folder is missing or not writable, or the disk is full; what was at
    ``path`` before is then still there.
    """
    target = Path(path)
    try:
        handle, aside = tempfile.mkstemp(prefix=f".{target.name}.", dir=target.parent)
        try:
            with os.fdopen(handle, "wb") as stream:
                stream.write(content)
                stream.flush()
                if flushed:
                    os.fsync(stream.fileno())
            Path(aside).chmod(_mode_of_new_files())
            Path(aside).replace(target)
        except BaseException:
            Path(aside).unlink(missing_ok=True)
            raise
    except OSError as error:
        raise OutputError(
            f"Cannot write '{target.name}' in the folder '{target.parent}': {error.strerror or error}. "
            "Check its free space and permissions, or choose another folder."
        ) from error


def own_file(path: str, flags: int) -> int:
    """An opener for :func:`open` that follows no link, and waits for no pipe, that another user put at the path."""
    return os.open(path, flags | os.O_NOFOLLOW | os.O_NONBLOCK, 0o666)


def visible_files(root: Path, name: str = "*") -> list[Path]:
    """The files below a folder whose names match, sorted; without hidden files and folders and macOS' ``__MACOSX``."""
    found = (path for path in root.rglob(name) if path.is_file())
    return sorted(path for path in found if not any(map(hidden, path.relative_to(root).parts)))


def hidden(name: str) -> bool:
    """Whether a file or folder of that name is for the system that wrote it, not for us."""
    return name.startswith(".") or name == "__MACOSX"


def _mode_of_new_files() -> int:
    """The mode that ``open`` would give a new file; mkstemp's files are private, whatever the user's umask says."""
    mask = os.umask(0)
    os.umask(mask)
    return 0o666 & ~mask


def make_folder(folder: Path) -> Path:
    """The folder, created with its parents if missing.

    Raises :class:`OutputError` when it cannot be made.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(
            f"Cannot make the folder '{folder}': {error.strerror or error}. "
            "Choose another with hydra.run.dir=FOLDER."
        ) from error
    return folder


def write_bytes(path: Path, data: bytes, *, flushed: bool = True) -> Path:
    """Put ``data`` at ``path``; a reader sees the old file or the new one, never a part.

    A missing folder is created. Raises :class:`OutputError` when the folder cannot be written to; the old file is then
    untouched. Returns ``path``. ``flushed``: see :func:`write_whole`.
    """
    make_folder(path.parent)
    write_whole(path, data, flushed=flushed)
    return path


def write_text(path: Path, text: str, *, flushed: bool = True) -> Path:
    """Put ``text`` at ``path`` in UTF-8, as :func:`write_bytes` does.

    Lone surrogates (bytes of a command line that were not UTF-8) become escapes instead of an error.
    """
    return write_bytes(path, text.encode("utf-8", errors="backslashreplace"), flushed=flushed)


def write_json(path: Path, value: object, *, flushed: bool = True) -> Path:
    """Put ``value`` at ``path`` as strict JSON, as :func:`write_bytes` does; see :func:`plain`."""
    text = json.dumps(plain(value), indent=2, ensure_ascii=False, allow_nan=False)
    return write_text(path, f"{text}\n", flushed=flushed)


def plain(value: object) -> Any:
    """``value`` in JSON's types.

    Arrays become lists, numpy scalars numbers, dataclasses and mappings objects with string keys, sets sorted
    lists, NaN and infinities null, enumerations their values, bytes hexadecimal, anything else its text.
    """
    if value is None or (isinstance(value, bool | int | str) and not isinstance(value, Enum)):
        return value
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Enum):
        return plain(value.value)
    if hasattr(value, "tolist"):  # numpy's arrays and scalars, without importing numpy
        return plain(value.tolist())
    if isinstance(value, bytes):
        return value.hex()
    if is_dataclass(value) and not isinstance(value, type):
        return {f.name: plain(getattr(value, f.name)) for f in fields(value)}
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, AbstractSet):
        return sorted((plain(item) for item in value), key=str)
    if isinstance(value, Sequence) and not isinstance(value, str):
        return [plain(item) for item in value]
    return str(value)
