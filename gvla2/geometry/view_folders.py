"""Folders of calibrated views, in and out.

Three kinds are read, recognised by their files:

* ``cameras.json``, with ``images/NAME.png`` and, where there are any, ``masks/NAME.png`` and ``depth/NAME.npy``;
* ``views.npz``: what a robot run stores, and :func:`write_views` writes;
* ``render_mvs_25/model/000.{png,npy}``: an object of a GSO-30 tree.

``views.npz`` is exact and readable with numpy alone: ``names`` (S,) are the cameras' names; arrays of view i are
``K_i`` (3, 3), ``world_from_camera_i`` (4, 4), ``image_i`` (H, W, 3) uint8, and where the view has them ``depth_i`` (H,
W) float32, ``mask_i`` (H, W) float32, ``robot_mask_i`` (H, W) bool. ``subject``, where there is one, names what the
masks show.
"""

from __future__ import annotations

import io
import json
import os
import re
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from PIL import Image

from gvla2.errors import ConfigurationError, GeometryError, OutputError
from gvla2.geometry.camera import Camera
from gvla2.geometry.transform import check_rigid, invert_rigid
from gvla2.geometry.views import View, Views
from gvla2.io.files import write_whole


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
    numbers = None if spec is None else parse_view_spec(spec)
    if (place / CAMERAS).is_file():
        views = _read_plain(place / CAMERAS, numbers)
    elif (place / ARCHIVE).is_file():
        views = read_archive(place / ARCHIVE, numbers)
    elif (model := gso_folder(place)) is not None:
        views = Views(tuple(_read_gso(model, number) for number in numbers or PROTOCOL_VIEWS))
        size = size or PROTOCOL_SIZE
    else:
        present = ", ".join(sorted(p.name for p in place.iterdir())[:8]) or "nothing"
        raise GeometryError(
            f"Cannot read views from {place}: it has neither cameras.json, nor {ARCHIVE}, nor "
            f"render_mvs_25/model/000.png. It holds: {present}."
        )
    return views if size is None else Views(tuple(resized(view, size) for view in views))


def parse_view_spec(spec: str) -> tuple[int, ...]:
    """View numbers of a spec such as ``0-4,7``: numbers and closed ranges, in the order written.

    Raises :class:`ConfigurationError` for anything else: an empty spec, a range that runs backwards, a view twice.
    """
    numbers: list[int] = []
    for part in (p.strip() for p in spec.split(",")):
        match = re.fullmatch(r"(\d{1,6})(?:\s*-\s*(\d{1,6}))?", part)
        if match is None or int(match[2] or match[1]) < int(match[1]):
            raise ConfigurationError(
                f"Cannot read '{part}' in the views '{spec}': write numbers and ranges, such as 0-4,7."
            )
        numbers += range(int(match[1]), int(match[2] or match[1]) + 1)
    if len(set(numbers)) < len(numbers):
        twice = max(set(numbers), key=numbers.count)
        raise ConfigurationError(f"The views '{spec}' name {twice} twice.")
    return tuple(numbers)


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
        depth=None if view.depth is None else nearest(view.depth, height, width),
        mask=None if view.mask is None else _averaged(view.mask, width, height),
        robot_mask=None if view.robot_mask is None else nearest(view.robot_mask, height, width),
    )


def _averaged(mask: NDArray[np.float32], width: int, height: int) -> NDArray[np.float32]:
    image = Image.fromarray(np.rint(255 * np.clip(mask, 0, 1)).astype(np.uint8))
    return np.asarray(
        image.resize((width, height), Image.Resampling.BILINEAR), dtype=np.float32
    ) / np.float32(255)


def nearest(maps: NDArray[Any], height: int, width: int) -> NDArray[Any]:
    """Maps (..., h, w) at another size, by the nearest pixel, which invents no depth between two surfaces."""
    rows = ((np.arange(height) + 0.5) * maps.shape[-2] / height).astype(np.intp)
    columns = ((np.arange(width) + 0.5) * maps.shape[-1] / width).astype(np.intp)
    return np.ascontiguousarray(maps[..., rows[:, None], columns])


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
    """The object that an archive's masks show; "" if it does not say, or cannot be read."""
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


CAMERAS = "cameras.json"
_CONVENTIONS = {"opencv": np.eye(4), "opengl": np.diag([1.0, -1.0, -1.0, 1.0])}
_PICTURES = (".png", ".jpg", ".jpeg")


def write_plain(folder: str | os.PathLike[str], views: Views) -> None:
    """Write ``cameras.json`` with its images, masks and depth, each file whole or not at all; raises OutputError."""
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
    write_whole(place / CAMERAS, text.encode())


def _read_plain(cameras: Path, numbers: Sequence[int] | None) -> Views:
    """The views that a file of cameras lists, or those at the given indices; errors name the file."""
    try:
        document = json.loads(cameras.read_text("utf-8"))
        shared = {k: document[k] for k in ("K", "convention") if k in document}
        entries = [{**shared, **entry} for entry in document["views"]]
    except (OSError, ValueError, TypeError, KeyError) as error:
        raise GeometryError(
            f"Cannot read the cameras {cameras}: {error!r}; it needs a list 'views'."
        ) from error
    highest = max(numbers or (0,))
    if highest >= len(entries):
        raise GeometryError(f"{cameras} lists {len(entries)} views (from 0); there is no view {highest}.")
    chosen = entries if numbers is None else [entries[n] for n in numbers]
    return Views(tuple(_plain_view(cameras, entry) for entry in chosen))


def _plain_view(cameras: Path, entry: Mapping[str, Any]) -> View:
    name, folder = str(entry.get("name", "")), cameras.parent
    try:
        picture = _first(folder / "images", name, _PICTURES)
        if not name or picture is None:
            raise GeometryError(f"there is no {folder / 'images' / name}.png.")
        image, mask = _read_picture(picture)
        if (mask_file := _first(folder / "masks", name, _PICTURES)) is not None:
            mask = _read_mask(mask_file)
        depth = None
        if (depth_file := _first(folder / "depth", name, (".npy",))) is not None:
            depth = np.asarray(_load(depth_file), dtype=np.float32)
            depth = np.where(depth > 0, depth, np.float32(np.nan))
        height, width = image.shape[:2]
        return View(_camera(entry, width, height, str(entry.get("label", name))), image, depth, mask)
    except (GeometryError, TypeError, ValueError) as error:
        raise GeometryError(f"{cameras}, view '{name}': {error}") from error


def _first(folder: Path, name: str, suffixes: Sequence[str]) -> Path | None:
    return next((path for suffix in suffixes if (path := folder / f"{name}{suffix}").is_file()), None)


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


def _read_picture(path: Path) -> tuple[NDArray[np.uint8], NDArray[np.float32] | None]:
    """Colour (H, W, 3) uint8 laid on white, and alpha (H, W) in [0, 1], None for an opaque file."""
    with _open(path) as picture:
        if not _transparent(picture):
            return np.asarray(picture.convert("RGB")), None
        rgba = np.asarray(picture.convert("RGBA"), dtype=np.float32) / np.float32(255)
    alpha = rgba[..., 3:]
    on_white = rgba[..., :3] * alpha + (1 - alpha)
    return np.asarray(255 * np.clip(on_white, 0, 1), dtype=np.uint8), np.ascontiguousarray(alpha[..., 0])


def _read_mask(path: Path) -> NDArray[np.float32]:
    """(H, W) in [0, 1]: the alpha of a transparent file, else its grey value."""
    with _open(path) as picture:
        layer = picture.convert("RGBA").getchannel("A") if _transparent(picture) else picture.convert("L")
        return np.asarray(layer, dtype=np.float32) / np.float32(255)


def _transparent(picture: Image.Image) -> bool:
    return "A" in picture.getbands() or "transparency" in picture.info


def _open(path: Path) -> Image.Image:
    try:
        picture = Image.open(path)
        picture.load()
    except (OSError, SyntaxError, ValueError) as error:
        raise GeometryError(f"Cannot read the image {path}: {error}") from error
    return picture


def _load(path: Path) -> NDArray[Any]:
    """The array of a .npy file."""
    try:
        return np.asarray(np.load(io.BytesIO(path.read_bytes()), allow_pickle=False))
    except (OSError, ValueError, EOFError) as error:
        raise GeometryError(f"Cannot read the array {path}: {error}") from error


def _png(array: NDArray[np.uint8]) -> bytes:
    stream = io.BytesIO()
    Image.fromarray(array).save(stream, "PNG")
    return stream.getvalue()


FOCAL = 35.0 / 32.0
"""Focal length over the image's width in a GSO-30 tree."""
PROTOCOL_VIEWS, PROTOCOL_SIZE = (0, 1, 2, 3, 4), 256


def gso_folder(place: Path) -> Path | None:
    """Where the numbered views of a GSO-30 object lie: below ``place``, or ``place`` itself; None if nowhere."""
    for folder in (place / "render_mvs_25" / "model", place):
        if folder.is_dir() and any(p.stem.isdigit() and p.suffix == ".npy" for p in folder.iterdir()):
            return folder
    return None


def gso_camera(camera_from_world: ArrayLike, width: int, height: int, name: str = "camera") -> Camera:
    """The camera of an OpenGL extrinsic matrix (3, 4) or (4, 4); a mirrored one (determinant -1) is an error."""
    f = FOCAL * width
    K = [[f, 0.0, width / 2], [0.0, f, height / 2], [0.0, 0.0, 1.0]]
    return _camera({"K": K, "T": camera_from_world, "convention": "opengl"}, width, height, name)


def _read_gso(model: Path, number: int) -> View:
    picture, matrix = (model / f"{number:03d}{suffix}" for suffix in (".png", ".npy"))
    for path in (picture, matrix):
        if not path.is_file():
            known = sorted(int(p.stem) for p in model.glob("*.npy") if p.stem.isdigit())
            raise GeometryError(
                f"View {number} is not in {model}: {path.name} is missing (views there: {known[0]} to {known[-1]})."
            )
    image, alpha = _read_picture(picture)
    height, width = image.shape[:2]
    try:
        return View(gso_camera(_load(matrix), width, height, f"{number:03d}"), image, mask=alpha)
    except (GeometryError, TypeError, ValueError) as error:
        raise GeometryError(f"{matrix}: {error}") from error
