"""Reading a saved prior, with an error for each way in which the file can be wrong."""

from __future__ import annotations

import zipfile
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from gvla2.errors import ConfigurationError, GeometryError
from gvla2.geometry.transform import check_rigid
from gvla2.geometry.views import Views
from gvla2.reconstruction.contracts import GeometryEstimate

if TYPE_CHECKING:
    from gvla2_plugins.file_prior import FilePriorConfig

_KEYS = ("depth", "point_map", "confidence", "world_from_camera", "names")
_SHAPE_TOLERANCE = 0.02


def _archive(file: BinaryIO) -> np.lib.npyio.NpzFile[Any]:
    """The open archive; ValueError for a single array."""
    loaded: np.lib.npyio.NpzFile[Any] | NDArray[Any] = np.load(file, allow_pickle=False)
    if isinstance(loaded, np.ndarray):
        raise ValueError("it is a single array")
    return loaded


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
        poses = stored.get("world_from_camera")
        if poses is not None:
            poses = self._poses(poses)
        depth = self._depth(stored, poses)
        confidence = stored.get("confidence", np.ones_like(depth))
        if confidence.shape != depth.shape:
            raise self._error(f"confidence has shape {confidence.shape}, depth {depth.shape}")
        if poses is not None and len(poses) != len(depth):
            raise self._error(f"world_from_camera has {len(poses)} poses for {len(depth)} depth maps")
        rows = self._rows(stored, len(depth), views)
        depth, confidence = depth[rows], confidence[rows]
        sizes = {(view.camera.height, view.camera.width) for view in views}
        if len(sizes) > 1:
            raise self._error(f"it holds pictures of one size, but the views have several: {sorted(sizes)}")
        height, width = sizes.pop()
        depth, confidence = (self._resized(array, height, width) for array in (depth, confidence))
        known = np.isfinite(depth) & (depth > 0)
        if not known.any():
            raise self._error("no depth in it is a number above 0")
        sure = np.where(np.isfinite(confidence) & known, np.maximum(confidence, 0), 0)
        return GeometryEstimate(
            np.where(known, depth, np.nan).astype(np.float32),
            sure.astype(np.float32),
            None if poses is None else poses[rows],
        )

    def _error(self, what: str) -> GeometryError:
        return GeometryError(f"Prior file '{self._path}': {what}.")

    def _read(self) -> dict[str, NDArray[Any]]:
        try:
            # numpy leaves a damaged archive's file open when it is given a path.
            with self._path.open("rb") as file, _archive(file) as archive:
                stored = {key: archive[key] for key in archive.files if key in _KEYS}
                found = ", ".join(archive.files) or "nothing"
        except (OSError, ValueError, EOFError, KeyError, zipfile.BadZipFile) as error:
            raise self._error(f"it cannot be read as an .npz archive of plain arrays ({error})") from error
        if not {"depth", "point_map"} & stored.keys():
            raise self._error(f"it has neither 'depth' nor 'point_map', only {found}")
        for key, array in stored.items():
            if key != "names" and array.dtype.kind not in "fiu":
                raise self._error(f"{key} holds {array.dtype}, not numbers")
        return stored

    def _poses(self, poses: NDArray[Any]) -> NDArray[np.float64]:
        if poses.ndim != 3 or poses.shape[1:] not in ((4, 4), (3, 4)):
            raise self._error(f"world_from_camera must be (S, 4, 4), got shape {poses.shape}")
        return np.stack(
            [
                check_rigid(pose, f"Prior file '{self._path}': world_from_camera[{i}]")
                for i, pose in enumerate(poses)
            ]
        )

    def _depth(self, stored: dict[str, NDArray[Any]], poses: NDArray[Any] | None) -> NDArray[np.float64]:
        """(S, h, w); for a point map, the depth of its points in the prior's own cameras."""
        if "depth" in stored:
            depth = stored["depth"].astype(np.float64)
            if depth.ndim != 3:
                raise self._error(f"depth must be (S, h, w), got shape {depth.shape}")
            return depth
        points = stored["point_map"].astype(np.float64)
        if points.ndim != 4 or points.shape[-1] != 3:
            raise self._error(f"point_map must be (S, h, w, 3), got shape {points.shape}")
        if poses is None or len(poses) != len(points):
            raise self._error("a point_map needs world_from_camera, one pose a picture: they give its depth")
        forward, centre = poses[:, :3, 2], poses[:, :3, 3]
        return np.asarray(np.einsum("shwk,sk->shw", points - centre[:, None, None], forward))

    def _rows(self, stored: dict[str, NDArray[Any]], count: int, views: Views) -> list[int]:
        """Which row belongs to each view: by name if the file has names, else by order."""
        if "names" not in stored:
            if count != len(views):
                raise self._error(f"it holds {count} pictures, but there are {len(views)} views")
            return list(range(count))
        names = [str(name) for name in np.atleast_1d(stored["names"])]
        if len(names) != count:
            raise self._error(f"it holds {count} pictures, but {len(names)} names")
        missing = [view.name for view in views if view.name not in names]
        if missing:
            raise self._error(f"it has no picture named {', '.join(missing)}; it has {', '.join(names)}")
        return [names.index(view.name) for view in views]

    def _resized(self, pictures: NDArray[Any], height: int, width: int) -> NDArray[Any]:
        own_height, own_width = pictures.shape[1:]
        if abs(own_width * height / (own_height * width) - 1) > _SHAPE_TOLERANCE:
            raise self._error(
                f"its pictures are {own_width}x{own_height}, the views {width}x{height}: not the same shape"
            )
        rows = ((np.arange(height) + 0.5) * own_height / height).astype(int)
        columns = ((np.arange(width) + 0.5) * own_width / width).astype(int)
        return pictures[:, rows[:, None], columns]
