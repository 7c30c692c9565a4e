"""A disk cache for expensive deterministic arrays, in one folder."""

from __future__ import annotations

import hashlib
import io
import logging
import os
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gvla2.errors import OutputError
from gvla2.io.files import write_whole

if TYPE_CHECKING:
    from numpy.typing import NDArray

log = logging.getLogger(__name__)


def cache_folder() -> Path:
    """The folder of rendered views, weights and decompositions: ``GVLA2_CACHE``, else ``gvla2`` in the XDG cache."""
    own = os.environ.get("GVLA2_CACHE")
    if own:
        return Path(own).expanduser()
    shared = os.environ.get("XDG_CACHE_HOME")
    return (Path(shared) if shared else Path.home() / ".cache") / "gvla2"


def cached_arrays(
    folder: Path, key: str, make: Callable[[], dict[str, NDArray[Any]]], *, compressed: bool = False
) -> dict[str, NDArray[Any]]:
    """The arrays of ``make()``, or those that it returned for the same ``key`` before, kept in ``folder``.

    A folder that cannot be written only costs time; a damaged entry is made again.
    """
    import numpy as np

    entry = folder / f"{hashlib.sha256(key.encode()).hexdigest()[:32]}.npz"
    try:
        # Read whole first: numpy leaves a damaged file open.
        with np.load(io.BytesIO(entry.read_bytes()), allow_pickle=False) as stored:
            return {name: stored[name] for name in stored.files}
    except (FileNotFoundError, NotADirectoryError):
        pass
    except Exception as error:  # a damaged archive can raise anything
        log.warning("The cached %s is damaged (%s) and is made again.", entry, error)
    arrays, stream = make(), io.BytesIO()
    (np.savez_compressed if compressed else np.savez)(stream, allow_pickle=False, **arrays)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        write_whole(entry, stream.getvalue(), flushed=False)
    except (OSError, OutputError) as error:
        log.warning("%s could not be cached: %s", entry, error)
    return arrays
