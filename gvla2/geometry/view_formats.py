"""Folders of calibrated views in formats of others and of our own: ``cameras.json`` and GSO-30 trees."""

from __future__ import annotations

import io
import json
import os
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from PIL import Image, UnidentifiedImageError

from gvla2.errors import ConfigurationError, GeometryError, OutputError
from gvla2.geometry.camera import Camera
from gvla2.geometry.transform import FloatArray, check_rigid, invert_rigid
from gvla2.geometry.views import View, Views
from gvla2.io.files import write_whole


def read_picture(path: Path) -> tuple[NDArray[np.uint8], NDArray[np.float32] | None]:
    """Colour (H, W, 3) uint8 laid on white, and alpha (H, W) in [0, 1], None for an opaque file."""
    with _open(path) as picture:
        if "A" not in picture.getbands() and "transparency" not in picture.info:
            return np.asarray(picture.convert("RGB")), None
        rgba = np.asarray(picture.convert("RGBA"), dtype=np.float32) / np.float32(255)
    alpha = rgba[..., 3:]
    on_white = rgba[..., :3] * alpha + (1 - alpha)
    return np.asarray(255 * np.clip(on_white, 0, 1), dtype=np.uint8), np.ascontiguousarray(alpha[..., 0])


def read_mask(path: Path) -> NDArray[np.float32]:
    """(H, W) in [0, 1]: the alpha of a transparent file, else its grey value."""
    with _open(path) as picture:
        transparent = "A" in picture.getbands() or "transparency" in picture.info
        layer = picture.convert("RGBA").getchannel("A") if transparent else picture.convert("L")
        return np.asarray(layer, dtype=np.float32) / np.float32(255)


def _open(path: Path) -> Image.Image:
    try:
        picture = Image.open(path)
        picture.load()
    except FileNotFoundError:
        raise GeometryError(f"The image {path} is missing.") from None
    except (OSError, UnidentifiedImageError, SyntaxError, ValueError) as error:
        raise GeometryError(f"Cannot read the image {path}: {error}") from error
    return picture


def parse_view_spec(spec: str) -> tuple[int, ...]:
    """View numbers of a spec such as ``0-4,7``: numbers and closed ranges, in the order written.

    Raises :class:`ConfigurationError` for anything else: an empty spec, a range that runs backwards, a view twice.
    """
    numbers: list[int] = []
    for part in (p.strip() for p in spec.split(",")):
        match = re.fullmatch(r"(\d+)(?:\s*-\s*(\d+))?", part)
        if match is None:
            raise ConfigurationError(
                f"Cannot read '{part}' in the views '{spec}': write numbers and ranges, such as 0-4,7."
            )
        first, last = int(match[1]), int(match[2] or match[1])
        if last < first:
            raise ConfigurationError(f"The range '{part}' in the views '{spec}' runs backwards.")
        if last - first > 100_000:
            raise ConfigurationError(f"The range '{part}' in the views '{spec}' is longer than any data set.")
        numbers += range(first, last + 1)
    twice = sorted({n for n in numbers if numbers.count(n) > 1}) if len(set(numbers)) < len(numbers) else []
    if twice:
        raise ConfigurationError(f"The views '{spec}' name {', '.join(map(str, twice))} twice.")
    return tuple(numbers)


_CONVENTIONS = {"opencv": np.eye(4), "opengl": np.diag([1.0, -1.0, -1.0, 1.0])}
_SUFFIXES = (".png", ".jpg", ".jpeg")


def find_cameras(place: Path) -> Path | None:
    """The folder's file of cameras."""
    path = place / "cameras.json"
    return path if path.is_file() else None


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
        document = json.loads(cameras.read_text("utf-8"))
        if not isinstance(document, dict) or not isinstance(document.get("views"), list):
            raise ValueError("it has no list 'views'")
        shared = {k: document[k] for k in ("K", "convention") if k in document}
        return [{**shared, **entry} for entry in document["views"]]
    except (OSError, ValueError, TypeError) as error:
        raise GeometryError(f"Cannot read the cameras {cameras}: {error}.") from error


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


FOCAL = 35.0 / 32.0
"""Focal length over the image's width."""
PROTOCOL_VIEWS = "0-4"
PROTOCOL_SIZE = 256
_MODEL = Path("render_mvs_25") / "model"
_OPENCV_FROM_OPENGL = np.diag([1.0, -1.0, -1.0, 1.0])


def find_model_folder(place: Path) -> Path | None:
    """Where an object's numbered views lie: below ``place``, or ``place`` itself."""
    for folder in (place / _MODEL, place):
        if folder.is_dir() and any(p.stem.isdigit() and p.suffix == ".npy" for p in folder.iterdir()):
            return folder
    return None


def gso_camera(camera_from_world: ArrayLike, width: int, height: int, name: str = "camera") -> Camera:
    """The camera of an OpenGL extrinsic matrix (3, 4) or (4, 4); a mirrored one (determinant -1) is an error."""
    opengl = check_rigid(camera_from_world, what=f"Camera '{name}': the extrinsic matrix")
    f = FOCAL * width
    K = np.array([[f, 0.0, width / 2], [0.0, f, height / 2], [0.0, 0.0, 1.0]])
    return Camera(K, invert_rigid(_OPENCV_FROM_OPENGL @ opengl), width, height, name)


def read_gso(model: Path, numbers: Sequence[int]) -> Views:
    """The numbered views of a model folder as stored; a :class:`GeometryError` names what is missing or broken."""
    return Views(tuple(_read_one(model, number) for number in numbers))


def write_gso(model: str | os.PathLike[str], views: Views) -> None:
    """Write views as a model folder of the GSO-30 layout, numbered from 0.

    The layout cannot store K: readers assume the lens above. Raises :class:`OutputError`.
    """
    folder = Path(model)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"Cannot write {folder}: {error.strerror or error}.") from error
    for number, view in enumerate(views):
        mask = np.ones(view.image.shape[:2]) if view.mask is None else view.mask
        alpha = np.rint(255 * np.clip(mask, 0, 1)).astype(np.uint8)
        picture, matrix = io.BytesIO(), io.BytesIO()
        Image.fromarray(np.dstack([view.image, alpha])).save(picture, "PNG")
        np.save(matrix, opengl_extrinsic(view.camera)[:3])
        write_whole(folder / f"{number:03d}.png", picture.getvalue())
        write_whole(folder / f"{number:03d}.npy", matrix.getvalue())


def opengl_extrinsic(camera: Camera) -> FloatArray:
    """(4, 4) world -> camera in the convention of OpenGL."""
    return np.asarray(_OPENCV_FROM_OPENGL @ camera.camera_from_world, dtype=np.float64)


def _read_one(model: Path, number: int) -> View:
    picture, matrix = (model / f"{number:03d}{suffix}" for suffix in (".png", ".npy"))
    for path in (picture, matrix):
        if not path.is_file():
            known = sorted(int(p.stem) for p in model.glob("*.npy") if p.stem.isdigit())
            span = f"{known[0]} to {known[-1]}" if known else "none"
            raise GeometryError(
                f"View {number} is not in {model}: {path.name} is missing (views there: {span})."
            )
    image, alpha = read_picture(picture)
    try:
        camera_from_world = np.load(io.BytesIO(matrix.read_bytes()), allow_pickle=False)
    except (OSError, ValueError, EOFError) as error:
        raise GeometryError(f"Cannot read the camera {matrix}: {error}") from error
    try:
        height, width = image.shape[:2]
        camera = gso_camera(camera_from_world, width, height, f"{number:03d}")
    except (GeometryError, TypeError, ValueError) as error:
        raise GeometryError(f"{matrix}: {error}") from error
    return View(camera, image, mask=alpha)
