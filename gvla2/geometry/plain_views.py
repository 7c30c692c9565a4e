"""Our plain folder of views: pictures, masks and one file of cameras.

    cameras.json          or cameras.npz
    images/<name>.png     or .jpg
    masks/<name>.png      optional: grey, or the alpha of a transparent file
    depth/<name>.npy      optional: (H, W) metres along the camera's z, NaN or 0 where nothing was measured

``cameras.json``::

    {"convention": "opencv",
     "K": [[300, 0, 160], [0, 300, 120], [0, 0, 1]],
     "views": [{"name": "0", "T": [[...], [...], [...], [0, 0, 0, 1]]}, ...]}

``T`` is world -> camera, (3, 4) or (4, 4), metres; ``world_from_camera`` may stand in its place. ``K`` is in pixels
of the stored image, once for all views or in each view. ``convention`` is ``opencv`` (x right, y down, z forward; the
default) or ``opengl`` (x right, y up, z backward). A view may name its files: ``image``, ``mask``, ``depth``,
relative to the folder. ``cameras.npz`` holds the same as arrays: ``names`` (S,), ``K`` (S, 3, 3) or (3, 3), ``T`` or
``world_from_camera`` (S, 3 or 4, 4), and ``convention``.
"""

from __future__ import annotations

import io
import json
import os
import zipfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from gvla2.errors import GeometryError, OutputError
from gvla2.geometry.camera import Camera
from gvla2.geometry.picture_files import read_mask, read_picture
from gvla2.geometry.transform import check_rigid, invert_rigid
from gvla2.geometry.views import View, Views
from gvla2.io.files import write_whole

_CONVENTIONS = {"opencv": np.eye(4), "opengl": np.diag([1.0, -1.0, -1.0, 1.0])}
_SUFFIXES = (".png", ".jpg", ".jpeg")


def find_cameras(place: Path) -> Path | None:
    """The folder's file of cameras."""
    return next((p for name in ("cameras.json", "cameras.npz") if (p := place / name).is_file()), None)


def read_plain(cameras: Path, numbers: Sequence[int] | None = None) -> Views:
    """The views that a file of cameras lists, or those at the given indices; errors name the file."""
    entries = _entries(cameras)
    if numbers is not None:
        absent = [n for n in numbers if n >= len(entries)]
        if absent:
            raise GeometryError(
                f"{cameras} lists {len(entries)} views (from 0); there is no view {absent[0]}."
            )
        entries = [entries[n] for n in numbers]
    if not entries:
        raise GeometryError(f"{cameras} lists no views.")
    return Views(tuple(_view(cameras, entry) for entry in entries))


def write_plain(folder: str | os.PathLike[str], views: Views) -> None:
    """Write views as a plain folder, each file whole or not at all; raises :class:`OutputError`."""
    place = Path(folder)
    try:
        for name in ("images", "masks", "depth"):
            (place / name).mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"Cannot write {place}: {error.strerror or error}.") from error
    entries = []
    for number, view in enumerate(views):
        write_whole(place / "images" / f"{number}.png", _png(view.image))
        if view.mask is not None:
            mask = np.rint(255 * np.clip(view.mask, 0, 1)).astype(np.uint8)
            write_whole(place / "masks" / f"{number}.png", _png(mask))
        if view.depth is not None:
            stream = io.BytesIO()
            np.save(stream, view.depth)
            write_whole(place / "depth" / f"{number}.npy", stream.getvalue())
        T = view.camera.camera_from_world.tolist()
        entries.append({"name": str(number), "label": view.name, "K": view.camera.K.tolist(), "T": T})
    text = json.dumps({"convention": "opencv", "views": entries}, indent=1)
    write_whole(place / "cameras.json", text.encode())


def _entries(cameras: Path) -> list[Mapping[str, Any]]:
    """One mapping a view, with name, K, T or world_from_camera, and convention."""
    try:
        if cameras.suffix == ".json":
            document = json.loads(cameras.read_text("utf-8"))
        else:
            with np.load(io.BytesIO(cameras.read_bytes()), allow_pickle=False) as arrays:
                document = _as_document({name: arrays[name] for name in arrays.files})
        if not isinstance(document, dict) or not isinstance(document.get("views"), list):
            raise ValueError("it has no list 'views'")
        shared = {k: document[k] for k in ("K", "convention") if k in document}
        return [{**shared, **entry} for entry in document["views"]]
    except (OSError, ValueError, TypeError, KeyError, EOFError, zipfile.BadZipFile) as error:
        raise GeometryError(f"Cannot read the cameras {cameras}: {error}.") from error


def _as_document(arrays: Mapping[str, NDArray[Any]]) -> dict[str, Any]:
    pose = next((name for name in ("T", "world_from_camera") if name in arrays), None)
    if pose is None or "K" not in arrays:
        raise ValueError(
            f"it needs K and T (or world_from_camera), and holds {', '.join(arrays) or 'nothing'}"
        )
    count = len(arrays[pose])
    names = arrays.get("names", np.arange(count))
    K = np.broadcast_to(arrays["K"], (count, 3, 3))
    if arrays[pose].ndim != 3 or len(names) != count:
        raise ValueError(
            f"{pose} has shape {arrays[pose].shape} for {len(names)} names; one matrix a view is needed"
        )
    convention = str(arrays.get("convention", "opencv"))
    views = [{"name": str(names[i]), "K": K[i], pose: arrays[pose][i]} for i in range(count)]
    return {"convention": convention, "views": views}


def _view(cameras: Path, entry: Mapping[str, Any]) -> View:
    name = str(entry.get("name", ""))
    if not name:
        raise GeometryError(f"{cameras}: a view has no name.")
    folder = cameras.parent
    picture = _file(folder, entry, "image", "images", name, _SUFFIXES)
    if picture is None:
        raise GeometryError(f"View '{name}': there is no {folder / 'images' / name}.png.")
    image, alpha = read_picture(picture)
    mask_file = _file(folder, entry, "mask", "masks", name, _SUFFIXES)
    depth_file = _file(folder, entry, "depth", "depth", name, (".npy",))
    mask = read_mask(mask_file) if mask_file is not None else alpha
    try:
        height, width = image.shape[:2]
        camera = _camera(entry, width, height, str(entry.get("label", name)))
        return View(camera, image, None if depth_file is None else _depth(depth_file), mask)
    except (GeometryError, TypeError, ValueError) as error:
        raise GeometryError(f"{cameras}, view '{name}': {error}") from error


def _camera(entry: Mapping[str, Any], width: int, height: int, name: str) -> Camera:
    if "K" not in entry or not ("T" in entry or "world_from_camera" in entry):
        raise GeometryError("it needs K, and T or world_from_camera.")
    convention = str(entry.get("convention", "opencv")).lower()
    if convention not in _CONVENTIONS:
        raise GeometryError(
            f"the convention '{convention}' is unknown; it is one of {', '.join(_CONVENTIONS)}."
        )
    flip = _CONVENTIONS[convention]
    if "T" in entry:
        pose = invert_rigid(flip @ check_rigid(entry["T"], "T"))
    else:
        pose = check_rigid(entry["world_from_camera"], "world_from_camera") @ flip
    return Camera(np.asarray(entry["K"], dtype=np.float64), pose, width, height, name)


def _file(
    folder: Path,
    entry: Mapping[str, Any],
    key: str,
    subfolder: str,
    name: str,
    suffixes: tuple[str, ...],
) -> Path | None:
    """The file that the view names, or the one that lies where it should."""
    if entry.get(key):
        path = folder / str(entry[key])
        if not path.is_file():
            raise GeometryError(f"View '{name}': the {key} {path} is missing.")
        return path
    for suffix in suffixes:
        if (path := folder / subfolder / f"{name}{suffix}").is_file():
            return path
    return None


def _depth(path: Path) -> NDArray[np.float32]:
    try:
        depth = np.asarray(np.load(io.BytesIO(path.read_bytes()), allow_pickle=False), dtype=np.float32)
    except (OSError, ValueError, EOFError) as error:
        raise GeometryError(f"cannot read the depth {path}: {error}") from error
    return np.where(depth > 0, depth, np.float32(np.nan))


def _png(array: NDArray[np.uint8]) -> bytes:
    stream = io.BytesIO()
    Image.fromarray(array).save(stream, "PNG")
    return stream.getvalue()
