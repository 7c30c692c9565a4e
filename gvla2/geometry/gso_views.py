"""Objects of a GSO-30 tree: ``<object>/render_mvs_25/model/%03d.{png,npy}``.

The npy files hold world -> camera (3, 4) or (4, 4) in the convention of OpenGL and Blender (x right, y up, looking
down -z). The lens is 35 mm on a sensor of 32 mm: f = 1.09375 W, with the principal point in the middle.
"""

from __future__ import annotations

import io
import os
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike
from PIL import Image

from gvla2.errors import GeometryError, OutputError
from gvla2.geometry.camera import Camera
from gvla2.geometry.picture_files import read_picture
from gvla2.geometry.transform import FloatArray, check_rigid, invert_rigid
from gvla2.geometry.views import View, Views
from gvla2.io.files import write_whole

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
