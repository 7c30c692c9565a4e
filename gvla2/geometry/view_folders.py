"""Folders of calibrated views, in and out.

Two kinds are read, recognised by their files:

* ``cameras.json``, with ``images/NAME.png`` and, where there are any, ``masks/NAME.png``, ``depth/NAME.npy`` and
  ``robot/NAME.png``, the robot's own pixels; in the folder itself, or in ``views`` in it, as in a robot's run;
* ``render_mvs_25/model/000.{png,npy}``: an object of a GSO-30 tree.
"""

from __future__ import annotations

import io
import json
import os
import re
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from gvla2.errors import ConfigurationError, GeometryError, reading
from gvla2.geometry.camera import Camera
from gvla2.geometry.transform import check_rigid, invert_rigid
from gvla2.geometry.views import View, Views
from gvla2.io.files import write_bytes
from gvla2.io.foreign import png_bytes, read_array, read_picture

VIEWS, CAMERAS = "views", "cameras.json"
"""A run's folder of views, and the file with the cameras of a folder."""
FOCAL = 35.0 / 32.0
"""Focal length over the image's width in a GSO-30 tree."""
SCALED = 1.2
"""A principal point that is off the middle by more than this factor, in x and y alike, shows a K of another size."""
PROTOCOL_VIEWS, PROTOCOL_SIZE = (0, 1, 2, 3, 4), 256

Readers = Mapping[int, Callable[[], View]]
"""How to read the views of a folder, by number."""


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
    usual = None
    if (source := cameras_of(place)).is_file():
        readers = _plain_readers(source)
    elif (model := gso_folder(place)) is not None:
        source, usual, size = model, PROTOCOL_VIEWS, size or PROTOCOL_SIZE
        cameras = sorted(path for path in model.glob("*.npy") if path.stem.isdigit())
        readers = {int(path.stem): partial(_gso_view, path) for path in cameras}
    else:
        present = ", ".join(sorted(p.name for p in place.iterdir())[:8]) or "nothing"
        raise GeometryError(
            f"Cannot read views from {place}: it has neither {CAMERAS} nor render_mvs_25/model/000.png. "
            f"It holds: {present}."
        )
    numbers = parse_view_spec(spec) if spec is not None else usual or tuple(readers)
    if not readers:
        raise GeometryError(f"{source} lists 0 views.")
    if absent := [number for number in numbers if number not in readers]:
        there = f"it has the views {min(readers)} to {max(readers)}"
        raise GeometryError(f"There is no view {absent[0]} in {source}: {there}.")
    views = Views(tuple(readers[number]() for number in numbers))
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
    image = Image.fromarray(_as_bytes(mask)).resize((width, height), Image.Resampling.BILINEAR)
    return np.asarray(image, dtype=np.float32) / np.float32(255)


def nearest(maps: NDArray[Any], height: int, width: int) -> NDArray[Any]:
    """Maps (..., h, w) at another size, by the nearest pixel, which invents no depth between two surfaces."""
    rows = ((np.arange(height) + 0.5) * maps.shape[-2] / height).astype(np.intp)
    columns = ((np.arange(width) + 0.5) * maps.shape[-1] / width).astype(np.intp)
    return np.ascontiguousarray(maps[..., rows[:, None], columns])


_CONVENTIONS = {"opencv": np.eye(4), "opengl": np.diag([1.0, -1.0, -1.0, 1.0])}
_PICTURES = (".png", ".jpg", ".jpeg")
_LENS = re.compile(r"(?i)k[1-6]|p[12]|d|dist(ortion)?(_?(coeffs?|coefficients|params))?")
"""What others call the coefficients of a lens."""


def cameras_of(folder: Path) -> Path:
    """The file ``cameras.json`` of a folder of views, or of a run's folder with views in it; it may be absent."""
    own = folder / CAMERAS
    return own if own.is_file() else folder / VIEWS / CAMERAS


def subject_of(folder: Path) -> str:
    """The object that the masks of a folder's views show; "" if ``cameras.json`` does not say, or is absent."""
    cameras = cameras_of(folder)
    return str(_document(cameras).get("object", "")) if cameras.is_file() else ""


def write_plain(folder: str | os.PathLike[str], views: Views, subject: str = "") -> None:
    """Write ``cameras.json`` with its images, masks and depth, each file whole or not at all; raises OutputError.

    ``subject`` names the object that the masks show.
    """
    place, entries = Path(folder), []
    for number, view in enumerate(views):
        files = {f"images/{number}.png": png_bytes(view.image)}
        if view.mask is not None:
            files[f"masks/{number}.png"] = png_bytes(_as_bytes(view.mask))
        if view.robot_mask is not None:
            files[f"robot/{number}.png"] = png_bytes(_as_bytes(view.robot_mask))
        if view.depth is not None:
            stream = io.BytesIO()
            np.save(stream, view.depth)
            files[f"depth/{number}.npy"] = stream.getvalue()
        for name, content in files.items():
            write_bytes(place / name, content, flushed=False)
        T = view.camera.camera_from_world.tolist()
        entries.append({"name": str(number), "label": view.name, "K": view.camera.K.tolist(), "T": T})
    document = {"convention": "opencv", **({"object": subject} if subject else {}), "views": entries}
    write_bytes(place / CAMERAS, json.dumps(document, indent=1).encode(), flushed=False)


def _document(cameras: Path) -> Mapping[str, Any]:
    with reading("the cameras", cameras, remedy="It needs a list 'views' of objects."):
        document = json.loads(cameras.read_text("utf-8-sig"))
        views = [dict(entry) for entry in document["views"]]
    return {**document, "views": views}


def _plain_readers(cameras: Path) -> Readers:
    document = _document(cameras)
    names = [entry.get("name") for entry in document["views"]]
    if twice := [name for name in names if names.count(name) > 1]:
        raise GeometryError(f"Cannot read the cameras from {cameras}: two views are called '{twice[0]}'.")
    shared = {k: document[k] for k in document if k in ("K", "convention") or _LENS.fullmatch(k)}
    return {
        n: partial(_plain_view, cameras, {**shared, **entry}) for n, entry in enumerate(document["views"])
    }


def _plain_view(cameras: Path, entry: Mapping[str, Any]) -> View:
    folder, name = cameras.parent, re.sub(r"(?i)(?<=.)\.(png|jpe?g)$", "", str(entry.get("name", "")))

    def first(of: str, suffixes: tuple[str, ...]) -> Path | None:
        named = (folder / of / f"{name}{end}" for suffix in suffixes for end in (suffix, suffix.upper()))
        return next((path for path in named if path.is_file()), None)

    with reading(f"view '{name}'", cameras):
        if Path(name).is_absolute() or ".." in Path(name).parts:
            raise GeometryError("its name leads out of the folder.")
        if not name or (picture := first("images", _PICTURES)) is None:
            raise GeometryError(f"there is no {folder / 'images' / name}.png.")
        image, mask = _read_picture(picture)
        if (mask_file := first("masks", (*_PICTURES, f"{picture.suffix}.png"))) is not None:  # COLMAP's masks
            mask = _read_mask(mask_file)
        depth = None
        if (depth_file := first("depth", (".npy",))) is not None:
            depth = read_array(depth_file, "the depth")
            if depth.dtype.kind in "iu":
                raise GeometryError(
                    f"{depth_file} has integers, perhaps millimetres; depth is in metres: write it as floats, times "
                    "the camera's unit."
                )
            depth = depth.astype(np.float32)
            depth = depth[..., 0] if depth.ndim == 3 and depth.shape[2] == 1 else depth
            depth = np.where((depth > 0) & (depth < np.inf), depth, np.float32(np.nan))
        own = first("robot", _PICTURES)
        robot = None if own is None else _read_mask(own) > 0.5
        camera = _camera(entry, image, str(entry.get("label", name)))
        _check_size(camera)
        return View(camera, image, depth, mask, robot)


def _camera(entry: Mapping[str, Any], image: NDArray[np.uint8], name: str) -> Camera:
    if bent := [key for key in entry if _LENS.fullmatch(key) and np.any(entry[key])]:
        raise GeometryError(
            f"its lens is distorted ({', '.join(bent)}); K says all of a pinhole camera: undistort the pictures first, "
            "and give the K of the result."
        )
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
    return Camera(np.asarray(entry["K"], dtype=np.float64), pose, image.shape[1], image.shape[0], name)


def _check_size(camera: Camera) -> None:
    """Raise :class:`GeometryError` for a K that belongs to a picture of another size, as its principal point shows."""
    x, y = camera.K[:2, 2]
    ratio = 2.0 * x / camera.width, 2.0 * y / camera.height
    if min(x, y) > 0 and max(x, y) <= 1:
        raise GeometryError(
            f"the principal point ({x:g}, {y:g}) of K is in shares of the picture; K is in pixels."
        )
    turned = 2.0 * x / camera.height, 2.0 * y / camera.width
    if min(turned) > 0 and max(np.abs(np.log(turned))) < 0.05 and max(np.abs(np.log(ratio))) > np.log(SCALED):
        raise GeometryError(
            f"the principal point ({x:g}, {y:g}) of K is the middle of the picture when it is turned by 90 degrees. "
            "The file stores it unturned, perhaps with an EXIF orientation: turn its pixels, or K."
        )
    if min(ratio) > 0 and abs(np.log(ratio[0])) > np.log(SCALED) and abs(ratio[0] / ratio[1] - 1) < 0.05:
        raise GeometryError(
            f"the principal point ({x:g}, {y:g}) of K is the middle of {2 * x:.0f}x{2 * y:.0f} pixels, and "
            f"the picture has {camera.width}x{camera.height}. Scale K with the pictures."
        )


def gso_folder(place: Path) -> Path | None:
    """Where the numbered views of a GSO-30 object lie: below ``place``, or ``place`` itself; None if nowhere."""
    for folder in (place / "render_mvs_25" / "model", place):
        if folder.is_dir() and any(p.stem.isdigit() and p.suffix == ".npy" for p in folder.iterdir()):
            return folder
    return None


def _gso_view(matrix: Path) -> View:
    image, alpha = _read_picture(matrix.with_suffix(".png"))
    height, width = image.shape[:2]
    K = [[FOCAL * width, 0.0, width / 2], [0.0, FOCAL * width, height / 2], [0.0, 0.0, 1.0]]
    with reading("a camera", matrix):
        entry = {"K": K, "T": read_array(matrix, "the camera"), "convention": "opengl"}
        return View(_camera(entry, image, matrix.stem), image, mask=alpha)


def _read_picture(path: Path) -> tuple[NDArray[np.uint8], NDArray[np.float32] | None]:
    """Colour (H, W, 3) uint8 laid on white, and alpha (H, W) in [0, 1], None for an opaque file."""
    picture = read_picture(path)
    alpha = _alpha(picture)
    if picture.mode.startswith("I"):  # 16 bits, which Pillow would clip
        grey = np.clip(np.asarray(picture, dtype=np.float64) / 257, 0, 255).astype(np.uint8)
        return np.repeat(grey[..., None], 3, axis=2), None
    if alpha is None:
        return np.asarray(picture.convert("RGB")), None
    rgb = np.asarray(picture.convert("RGBA").convert("RGB"), dtype=np.float32) / np.float32(255)
    on_white = rgb * alpha[..., None] + (1 - alpha[..., None])
    return np.asarray(255 * np.clip(on_white, 0, 1), dtype=np.uint8), alpha


def _read_mask(path: Path) -> NDArray[np.float32]:
    """(H, W) in [0, 1]: the alpha of a transparent file, else its brightest channel or the labels of its palette.

    Two values are background and object, whatever they are. Raises :class:`GeometryError` for several labels.
    """
    picture = read_picture(path)
    alpha = _alpha(picture)
    if alpha is not None:
        return alpha
    indexed = picture.mode == "P"
    plain = picture if indexed or len(picture.getbands()) == 1 else picture.convert("RGB")
    values = np.asarray(plain, dtype=np.float32)
    values = values.max(axis=2) if values.ndim == 3 else values
    present = np.unique(values)
    if len(present) <= 2:
        return (values > (present[0] if len(present) == 2 else 0)).astype(np.float32)
    full = 255 if values.max() < 256 else 65535
    if indexed or (2 * values.max() < full and path.suffix.lower() == ".png"):
        raise GeometryError(
            f"the mask {path} has the values {', '.join(f'{value:g}' for value in present[:5])}, ... of {full}: labels "
            "of several objects. A mask shows one: 0 and 255."
        )
    return values / np.float32(full)


def _alpha(picture: Image.Image) -> NDArray[np.float32] | None:
    """(H, W) in [0, 1] of a picture that is anywhere transparent."""
    if "A" not in picture.getbands() and "transparency" not in picture.info:
        return None
    alpha = np.asarray(picture.convert("RGBA").getchannel("A"), dtype=np.float32) / np.float32(255)
    return alpha if alpha.min() < 1 else None


def _as_bytes(mask: NDArray[np.float32] | NDArray[np.bool_]) -> NDArray[np.uint8]:
    return np.rint(255 * np.clip(mask, 0, 1)).astype(np.uint8)
