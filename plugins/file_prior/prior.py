"""Reading a saved prior."""

from __future__ import annotations

import zipfile
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from gvla2.errors import ConfigurationError, GeometryError
from gvla2.geometry.transform import FloatArray, check_rigid
from gvla2.geometry.view_folders import nearest
from gvla2.geometry.views import Views
from gvla2.reconstruction.contracts import GeometryEstimate

if TYPE_CHECKING:
    from gvla2_plugins.file_prior import FilePriorConfig

_KEYS = ("depth", "point_map", "confidence", "world_from_camera")
_SHAPE_TOLERANCE = 0.02


class FilePrior:
    """Depth from an .npz file; raises :class:`ConfigurationError` when no file is given or it does not exist."""

    def __init__(self, config: FilePriorConfig) -> None:
        if not config.path:
            raise ConfigurationError("prior=file needs the file to read: add prior.path=FILE.npz.")
        self._path = Path(config.path).expanduser()
        if not self._path.is_file():
            raise ConfigurationError(f"prior.path: there is no file '{self._path}'.")

    def predict(self, views: Views) -> GeometryEstimate:
        """The file's depth, resized to the views; raises :class:`GeometryError` that says what is wrong with it."""
        stored = self._read()
        depth, poses = self._depth(stored)
        confidence = stored.get("confidence", np.ones_like(depth))
        if confidence.shape != depth.shape or len(depth) != len(views):
            raise self._error(
                f"its depth {depth.shape} and confidence {confidence.shape} must be alike and of {len(views)} views"
            )
        sizes = {(view.camera.height, view.camera.width) for view in views}
        if len(sizes) > 1:
            raise self._error(f"it holds pictures of one size, but the views have several: {sorted(sizes)}")
        height, width = sizes.pop()
        depth, confidence = (self._resized(array, height, width) for array in (depth, confidence))
        known = np.isfinite(depth) & (depth > 0)
        if not known.any():
            raise self._error("no depth in it is a number above 0")
        sure = np.where(np.isfinite(confidence) & known, np.maximum(confidence, 0), 0)
        depth = np.where(known, depth, np.nan)
        return GeometryEstimate(depth.astype(np.float32), sure.astype(np.float32), poses)

    def _error(self, what: str) -> GeometryError:
        return GeometryError(f"Prior file '{self._path}': {what}.")

    def _read(self) -> dict[str, NDArray[Any]]:
        try:
            # numpy leaves a damaged archive's file open when it is given a path.
            with self._path.open("rb") as file, np.load(file, allow_pickle=False) as archive:
                stored = {key: archive[key] for key in archive.files if key in _KEYS}
        except (
            OSError,
            ValueError,
            TypeError,
            AttributeError,
            EOFError,
            KeyError,
            zipfile.BadZipFile,
        ) as error:
            raise self._error(f"it cannot be read as an .npz archive of plain arrays ({error})") from error
        for key, array in stored.items():
            if array.dtype.kind not in "fiu":
                raise self._error(f"{key} holds {array.dtype}, not numbers")
        return stored

    def _depth(self, stored: dict[str, NDArray[Any]]) -> tuple[FloatArray, FloatArray | None]:
        """Depth (S, h, w), a point map's in the prior's own cameras, and poses (S, 4, 4) where there are any."""
        poses = stored.get("world_from_camera")
        if poses is not None:
            if poses.ndim != 3:
                raise self._error(f"world_from_camera must be (S, 4, 4), got shape {poses.shape}")
            poses = np.stack([check_rigid(pose, f"Prior file '{self._path}': a camera") for pose in poses])
        maps = stored.get("depth", stored.get("point_map"))
        if maps is None or maps.ndim != (3 if "depth" in stored else 4):
            raise self._error("it needs depth (S, h, w), or point_map (S, h, w, 3) and world_from_camera")
        if poses is not None and len(poses) != len(maps):
            raise self._error(f"world_from_camera has {len(poses)} poses for {len(maps)} pictures")
        if "depth" in stored:
            return maps.astype(np.float64), poses
        if poses is None:
            raise self._error("a point_map needs world_from_camera, one pose a picture: they give its depth")
        forward, centre = poses[:, :3, 2], poses[:, :3, 3]
        return np.asarray(np.einsum("shwk,sk->shw", maps - centre[:, None, None], forward)), poses

    def _resized(self, pictures: NDArray[Any], height: int, width: int) -> NDArray[Any]:
        own_height, own_width = pictures.shape[1:]
        if abs(own_width * height / (own_height * width) - 1) > _SHAPE_TOLERANCE:
            raise self._error(
                f"its pictures are {own_width}x{own_height}, the views {width}x{height}: not the same shape"
            )
        return nearest(pictures, height, width)
