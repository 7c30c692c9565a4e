"""Views in one file, ``views.npz``: exact, readable with numpy alone.

``names`` (S,) are the cameras' names. Arrays of view i: ``K_i`` (3, 3), ``world_from_camera_i`` (4, 4), ``image_i`` (H,
W, 3) uint8, and where the view has them ``depth_i`` (H, W) float32, ``mask_i`` (H, W) float32, ``robot_mask_i`` (H, W)
bool. ``subject``, where there is one, names what the masks show.
"""

from __future__ import annotations

import io
import os
import zipfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from gvla2.errors import GeometryError
from gvla2.geometry.camera import Camera
from gvla2.geometry.views import View, Views
from gvla2.io.files import write_whole

ARCHIVE = "views.npz"
_OPTIONAL = ("depth", "mask", "robot_mask")


def write_views(folder: str | os.PathLike[str], views: Views, subject: str = "") -> Path:
    """Write ``views.npz`` into a folder that exists, whole or not at all; raises :class:`gvla2.errors.OutputError`."""
    arrays: dict[str, Any] = {"names": np.array([view.name for view in views])}
    if subject:
        arrays["subject"] = np.array(subject)
    for i, view in enumerate(views):
        arrays[f"K_{i}"] = view.camera.K
        arrays[f"world_from_camera_{i}"] = view.camera.world_from_camera
        arrays[f"image_{i}"] = view.image
        for name in _OPTIONAL:
            if (array := getattr(view, name)) is not None:
                arrays[f"{name}_{i}"] = array
    stream = io.BytesIO()
    np.savez_compressed(stream, **arrays)
    path = Path(folder) / ARCHIVE
    write_whole(path, stream.getvalue())
    return path


def subject_of(path: Path) -> str:
    """What an archive's masks show; "" if it does not say, or cannot be read."""
    try:
        with np.load(io.BytesIO(path.read_bytes()), allow_pickle=False) as arrays:
            return str(arrays["subject"]) if "subject" in arrays.files else ""
    except (OSError, ValueError, EOFError, zipfile.BadZipFile):
        return ""


def read_archive(path: Path, numbers: Sequence[int] | None = None) -> Views:
    """The views of an archive, or those at the given indices; raises :class:`GeometryError`, naming the file."""
    try:
        with np.load(io.BytesIO(path.read_bytes()), allow_pickle=False) as arrays:
            names = [str(name) for name in arrays["names"]]
            for number in numbers or ():
                if number >= len(names):
                    raise GeometryError(f"it holds {len(names)} views (from 0); there is no view {number}.")
            return Views(tuple(_view(arrays, i, names[i]) for i in (numbers or range(len(names)))))
    except (OSError, ValueError, KeyError, TypeError, IndexError, EOFError, zipfile.BadZipFile) as error:
        raise GeometryError(f"Cannot read the views {path}: {error}") from error


def _view(arrays: Any, i: int, name: str) -> View:
    image = arrays[f"image_{i}"]
    height, width = image.shape[:2]
    camera = Camera(arrays[f"K_{i}"], arrays[f"world_from_camera_{i}"], width, height, name)
    depth, mask, robot = (arrays[f"{n}_{i}"] if f"{n}_{i}" in arrays.files else None for n in _OPTIONAL)
    return View(camera, image, depth, mask, robot)
