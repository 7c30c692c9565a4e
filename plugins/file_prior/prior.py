"""Reading a saved prior."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from gvla2.errors import ConfigurationError, GeometryError
from gvla2.geometry.transform import FloatArray, check_rigid
from gvla2.geometry.view_folders import nearest
from gvla2.geometry.views import Views
from gvla2.io.foreign import read_arrays
from gvla2.reconstruction.contracts import GeometryEstimate

if TYPE_CHECKING:
    from gvla2_plugins.file_prior import FilePriorConfig

_KEYS = ("depth", "confidence", "world_from_camera")
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
        stored = read_arrays(self._path, "the prior", _KEYS)
        for key, array in stored.items():
            if array.dtype.kind not in "fiu":
                raise self._error(f"{key} holds {array.dtype}, not numbers")
        return stored

    def _depth(self, stored: dict[str, NDArray[Any]]) -> tuple[FloatArray, FloatArray | None]:
        """Depth (S, h, w), and poses (S, 4, 4) where there are any."""
        depth, poses = stored.get("depth"), stored.get("world_from_camera")
        if depth is None or depth.ndim != 3:
            raise self._error("it needs depth (S, h, w)")
        if poses is None:
            return depth.astype(np.float64), None
        if poses.ndim != 3 or len(poses) != len(depth):
            raise self._error(f"world_from_camera must be ({len(depth)}, 4, 4), got shape {poses.shape}")
        what = f"Prior file '{self._path}': a camera"
        return depth.astype(np.float64), np.stack([check_rigid(pose, what) for pose in poses])

    def _resized(self, pictures: NDArray[Any], height: int, width: int) -> NDArray[Any]:
        own_height, own_width = pictures.shape[1:]
        if abs(own_width * height / (own_height * width) - 1) > _SHAPE_TOLERANCE:
            raise self._error(
                f"its pictures are {own_width}x{own_height}, the views {width}x{height}: not the same shape"
            )
        return nearest(pictures, height, width)
