"""Atomic writing of files."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

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


def _mode_of_new_files() -> int:
    """What ``open`` would give a new file; mkstemp's files are private, whatever the user's umask says."""
    mask = os.umask(0)
    os.umask(mask)
    return 0o666 & ~mask
