"""Folders of calibrated views, in and out.

Three kinds are read, recognised by their files:

* ``cameras.json``: our plain folder, see :mod:`gvla2.geometry.view_formats`;
* ``views.npz``: what a robot run stores, and :func:`write_views` writes;
* ``render_mvs_25/model/000.{png,npy}``: an object of a GSO-30 tree.

``views.npz`` is exact and readable with numpy alone: ``names`` (S,) are the cameras' names; arrays of view i are
``K_i`` (3, 3), ``world_from_camera_i`` (4, 4), ``image_i`` (H, W, 3) uint8, and where the view has them ``depth_i`` (H,
W) float32, ``mask_i`` (H, W) float32, ``robot_mask_i`` (H, W) bool. ``subject``, where there is one, names what the
masks show.
"""

from __future__ import annotations

import io
import os
import zipfile
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from gvla2.errors import GeometryError
from gvla2.geometry.camera import Camera
from gvla2.geometry.view_formats import (
    PROTOCOL_SIZE,
    PROTOCOL_VIEWS,
    find_cameras,
    find_model_folder,
    parse_view_spec,
    read_gso,
    read_plain,
)
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


def read_views(folder: str | os.PathLike[str], spec: str | None = None, size: int | None = None) -> Views:
    """The views of a folder; world frame and units are the folder's own.

    ``spec`` picks views by number, such as ``0-4,7``: the number in the file's name in a GSO-30 tree, the place in
    the list elsewhere; by default the protocol's inputs 0-4 of a GSO-30 tree and all views of another folder.
    ``size`` is the longer side to resize to, in pixels: by default the protocol's 256 for a GSO-30 tree, as stored
    elsewhere. Transparent images are laid on white, and their alpha is the mask when there is no other.

    Raises :class:`GeometryError`, naming the file: for a folder of no known kind, missing files, views that are not
    there, sizes that differ, a singular K, a mirrored or sheared camera;
    :class:`gvla2.errors.ConfigurationError` for a spec that cannot be read.
    """
    place = Path(folder)
    if not place.is_dir():
        raise GeometryError(f"Cannot read views from {place}: there is no such folder.")
    if size is not None and size < 8:
        raise GeometryError(f"Views cannot be resized to {size} pixels; the minimum is 8.")
    cameras, model = find_cameras(place), find_model_folder(place)
    if cameras is not None:
        views = read_plain(cameras, None if spec is None else parse_view_spec(spec))
    elif (place / ARCHIVE).is_file():
        views = read_archive(place / ARCHIVE, None if spec is None else parse_view_spec(spec))
    elif model is not None:
        views = read_gso(model, parse_view_spec(spec or PROTOCOL_VIEWS))
        size = size or PROTOCOL_SIZE
    else:
        present = ", ".join(sorted(p.name for p in place.iterdir())[:8]) or "nothing"
        raise GeometryError(
            f"Cannot read views from {place}: it has neither cameras.json, nor {ARCHIVE}, nor "
            f"render_mvs_25/model/000.png. It holds: {present}."
        )
    return views if size is None else Views(tuple(resized(view, size) for view in views))


def resized(view: View, size: int) -> View:
    """The view with its longer side ``size`` pixels: image and mask averaged over pixels, depth taken from the nearest.

    A mask goes through bytes, as an image does.
    """
    camera = view.camera
    share = size / max(camera.width, camera.height)
    width, height = (max(1, round(share * n)) for n in (camera.width, camera.height))
    if (width, height) == (camera.width, camera.height):
        return view
    stretch = np.diag([width / camera.width, height / camera.height, 1.0])
    smaller = Camera(stretch @ camera.K, camera.world_from_camera, width, height, camera.name)
    image = Image.fromarray(view.image).resize((width, height), Image.Resampling.BILINEAR)
    return replace(
        view,
        camera=smaller,
        image=np.asarray(image),
        depth=None if view.depth is None else _nearest(view.depth, width, height),
        mask=None if view.mask is None else _averaged(view.mask, width, height),
        robot_mask=None if view.robot_mask is None else _nearest(view.robot_mask, width, height),
    )


def _averaged(mask: NDArray[np.float32], width: int, height: int) -> NDArray[np.float32]:
    image = Image.fromarray(np.rint(255 * np.clip(mask, 0, 1)).astype(np.uint8))
    return np.asarray(
        image.resize((width, height), Image.Resampling.BILINEAR), dtype=np.float32
    ) / np.float32(255)


def _nearest(array: NDArray, width: int, height: int) -> NDArray:  # type: ignore[type-arg]
    rows = ((np.arange(height) + 0.5) * array.shape[0] / height).astype(np.intp)
    columns = ((np.arange(width) + 0.5) * array.shape[1] / width).astype(np.intp)
    return np.ascontiguousarray(array[rows][:, columns])
