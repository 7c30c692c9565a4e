"""Folders of calibrated views, in and out.

Three kinds are read, recognised by their files:

* ``cameras.json`` or ``cameras.npz``: our plain folder, see :mod:`gvla2.geometry.plain_views`;
* ``views.npz``: what a robot run stores, and :func:`write_views` writes;
* ``render_mvs_25/model/000.{png,npy}``: an object of a GSO-30 tree, see :mod:`gvla2.geometry.gso_views`.
"""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from gvla2.errors import GeometryError
from gvla2.geometry.camera import Camera
from gvla2.geometry.gso_views import PROTOCOL_SIZE, PROTOCOL_VIEWS, find_model_folder, read_gso
from gvla2.geometry.plain_views import find_cameras, read_plain
from gvla2.geometry.view_archive import ARCHIVE, read_archive, write_views
from gvla2.geometry.view_spec import parse_view_spec
from gvla2.geometry.views import View, Views

__all__ = ["read_views", "resized", "write_views"]


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
            f"Cannot read views from {place}: it has neither cameras.json (or cameras.npz), nor {ARCHIVE}, nor "
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
