"""The folder of a run: atomic files (written aside, then moved into place), and its recorder."""

from __future__ import annotations

import json
import logging
import math
from collections.abc import Callable, Collection, Mapping, Sequence
from collections.abc import Set as AbstractSet
from dataclasses import fields, is_dataclass
from enum import Enum
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from gvla2.errors import OutputError
from gvla2.writing import write_whole

log = logging.getLogger(__name__)

T = TypeVar("T")


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
    untouched. Returns ``path``. ``flushed``: see :func:`~gvla2.writing.write_whole`.
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
    if isinstance(value, np.ndarray | np.generic):
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


class FolderRecorder:
    """The folder of a run: ``config.yaml`` immediately, and ``notes`` on what could not be made.

    ``config`` is the composed configuration as text. Of an earlier run in the folder the files named in ``WRITTEN`` are
    removed: what this run does not get to must not look like its own. Raises :class:`~gvla2.errors.OutputError` if the
    folder cannot be written to.
    """

    WRITTEN: Collection[str] = ()

    def __init__(self, folder: Path, config: str) -> None:
        self.folder, self.config = make_folder(folder), config
        self.notes: list[str] = []
        try:
            for name in self.WRITTEN:
                (folder / name).unlink(missing_ok=True)
        except OSError as error:
            raise OutputError(f"Cannot remove {folder / name} of an earlier run: {error}.") from error
        write_text(folder / "config.yaml", config)

    def attempt(self, what: str, make: Callable[[], T]) -> T | None:
        """What ``make`` gives; a failure becomes a note and a warning, never an error, and gives None."""
        try:
            return make()
        except Exception as error:
            self.complain(what, error)
            return None

    def complain(self, what: str, error: Exception) -> None:
        """Note once what could not be made and why."""
        note = f"{what} could not be made: {type(error).__name__}: {error}"
        if note not in self.notes:
            self.notes.append(note)
            log.warning(note, exc_info=error)

    def there(self) -> list[str]:
        """The names of the files in the folder."""
        return [path.name for path in self.folder.iterdir() if path.is_file()]
