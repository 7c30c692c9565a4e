"""Arrays and pictures in files: those that others wrote are plain data that fits into memory once unpacked."""

from __future__ import annotations

import io
import os
import warnings
from collections.abc import Collection
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from gvla2.errors import GeometryError, Gvla2Error, reading

MOST_BYTES = 1 << 30
"""What the arrays of a file may take together: a compressed file unpacks to up to a thousand times its size."""


def read_arrays(
    path: str | os.PathLike[str], what: str, names: Collection[str], kind: type[Gvla2Error] = GeometryError
) -> dict[str, NDArray[Any]]:
    """The arrays of an .npz file that are called ``names``, without those that it lacks.

    Raises ``kind``, naming the file, for what is no archive of plain arrays, and for more than :data:`MOST_BYTES`.
    """
    # Opened here: numpy leaves a damaged archive open when it is given a path.
    with (
        reading(what, path, kind, "It must be an .npz archive of plain arrays."),
        Path(path).open("rb") as file,
        np.load(file, allow_pickle=False) as archive,
    ):
        asked = [name for name in archive.files if name in names]
        _check_size(sum(archive.zip.getinfo(f"{name}.npy").file_size for name in asked))
        return {name: archive[name] for name in asked}


def read_array(path: str | os.PathLike[str], what: str) -> NDArray[Any]:
    """The array of an .npy file; raises :class:`GeometryError` as :func:`read_arrays`."""
    with reading(what, path):
        _check_size(Path(path).stat().st_size)
        return np.asarray(np.load(io.BytesIO(Path(path).read_bytes()), allow_pickle=False))


def read_picture(path: str | os.PathLike[str]) -> Image.Image:
    """A picture with its pixels; raises :class:`GeometryError`, naming the file, for what is none or has more pixels
    than Pillow takes to be safe, 89 million.
    """
    with reading("the picture", path), warnings.catch_warnings():
        warnings.simplefilter("error", Image.DecompressionBombWarning)
        with Image.open(path) as picture:
            picture.load()
            return picture


def png_bytes(picture: Image.Image | NDArray[np.uint8]) -> bytes:
    """A picture, or an image (H, W), (H, W, 3) or (H, W, 4), as a PNG file's bytes."""
    stream = io.BytesIO()
    shown = picture if isinstance(picture, Image.Image) else Image.fromarray(np.ascontiguousarray(picture))
    shown.save(stream, "PNG")
    return stream.getvalue()


def _check_size(taken: int) -> None:
    if taken > MOST_BYTES:
        raise ValueError(
            f"its arrays take {taken / 2**30:.1f} GiB, and {MOST_BYTES / 2**30:.0f} GiB is the maximum."
        )
