"""The visual hull as a reconstructor, and a geometry prior that was computed elsewhere."""

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
from gvla2.reconstruction.carving import carve
from gvla2.reconstruction.contracts import GeometryEstimate, Reconstruction
from gvla2.reconstruction.inset import inset
from gvla2.reconstruction.rasteriser import Rasteriser

if TYPE_CHECKING:
    from gvla2_plugins.geofuse import FilePriorConfig, HullConfig

_KEYS = ("depth", "confidence", "world_from_camera")
_SHAPE_TOLERANCE = 0.02


class HullReconstructor:
    """Space carving with colours, see :func:`gvla2.reconstruction.carving.carve`.

    Raises :class:`ConfigurationError` for fewer than 8 voxels per side or no Gaussians.
    """

    def __init__(self, config: HullConfig) -> None:
        if config.resolution < 8:
            raise ConfigurationError(f"reconstructor.resolution is {config.resolution}; 8 is the minimum.")
        if config.gaussians < 1:
            raise ConfigurationError(f"reconstructor.gaussians is {config.gaussians}; 1 is the minimum.")
        self._config = config

    def reconstruct(self, views: Views) -> Reconstruction:
        """Mesh and Gaussians of the object in the masks; a :class:`gvla2.errors.GeometryError` when none shows it."""
        carved = carve(views, self._config.resolution).to_reconstruction(self._config.gaussians)
        masked = Views(tuple(view for view in views if view.mask is not None))
        # Their footprints end at the masks' edges, not their centres.
        return inset(carved, masked, Rasteriser())[0]


class FilePrior:
    """Depth from an .npz file; raises :class:`ConfigurationError` when no file is given or it does not exist.

    The pictures may differ in size from the views, with the same aspect ratio within two percent: they are resized by
    the nearest pixel, which never invents depth between two surfaces.
    """

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
