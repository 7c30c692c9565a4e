"""Measured depth without the flying pixels at borders."""

from __future__ import annotations

import zlib
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_erosion, distance_transform_edt

from gvla2.errors import ConfigurationError
from gvla2.geometry.views import View, Views
from gvla2.reconstruction.contracts import GeometryEstimate
from gvla2_plugins.depth_prior.noise import learned, sensor

if TYPE_CHECKING:
    from gvla2_plugins.depth_prior import DepthPriorConfig


NOISES = ("exact", "sensor", "learned")
_NO_SIZES = ("name", "noise", "seed", "learned")
_SLOPE = 4.0
"""Border pixels are kept when their depth differs from the nearest inner pixel's by less than this slope, in pixel
sizes per pixel: a surface seen at 76 degrees."""


class DepthPrior:
    """The views' own depth: metric and calibrated, so the estimate has no poses.

    Raises :class:`ConfigurationError` for an unknown noise and for options below 0.
    """

    def __init__(self, config: DepthPriorConfig) -> None:
        if config.noise not in NOISES:
            raise ConfigurationError(f"prior.noise is '{config.noise}'; available: {', '.join(NOISES)}.")
        numbers = {k: v for k, v in {**vars(config), **vars(config.learned)}.items() if k not in _NO_SIZES}
        if wrong := [k for k, v in numbers.items() if not 0 <= v < float("inf")]:
            raise ConfigurationError(f"prior: {', '.join(wrong)} must be a number >= 0.")
        self._config = config

    def predict(self, views: Views) -> GeometryEstimate | None:
        """Depth (S, H, W) of the views, NaN where nothing was measured; None when no view measured any.

        Views of different sizes are put into the largest one's upper left corner, and guidance rejects them by name.
        """
        if not any(view.depth is not None and _measured(view.depth).any() for view in views):
            return None
        height = max(view.camera.height for view in views)
        width = max(view.camera.width for view in views)
        depth = np.full((len(views), height, width), np.nan, dtype=np.float32)
        for slot, view in zip(depth, views, strict=True):
            if view.depth is not None:
                slot[: view.camera.height, : view.camera.width] = self._trusted(view.depth, view)
        exact, poses, c = depth.astype(np.float64), None, self._config
        sure = np.where(np.isfinite(exact), 1.0, 0.0)
        if c.noise == "sensor":
            exact = sensor(exact, c.sensor_sigma, c.sensor_relative, c.sensor_dropout, self._rng(views))
            sure = np.where(np.isfinite(exact), sure, 0.0)
        elif c.noise == "learned":
            given = np.stack([view.camera.world_from_camera for view in views])
            exact, certainty, poses = learned(exact, given, c.learned, self._rng(views))
            sure = sure * certainty
        return GeometryEstimate(exact.astype(np.float32), sure.astype(np.float32), poses)

    def _rng(self, views: Views) -> np.random.Generator:
        """One reproducible draw per set of cameras and seed."""
        cameras = np.stack([view.camera.world_from_camera for view in views])
        return np.random.default_rng([self._config.seed, zlib.crc32(np.round(cameras, 6).tobytes())])

    def _trusted(self, depth: NDArray[np.float32], view: View) -> NDArray[np.float32]:
        keep = _measured(depth)
        if view.mask is not None:
            keep &= view.mask > 0.5
        if self._config.erode:
            # The picture's own border is not the object's.
            core = binary_erosion(
                keep, np.ones((3, 3), dtype=bool), iterations=self._config.erode, border_value=1
            )
            keep &= core | _continues(depth, core, view.camera.K[0, 0])
        return np.where(keep, depth, np.nan).astype(np.float32)


def _continues(depth: NDArray[np.float32], core: NDArray[np.bool_], focal: float) -> NDArray[np.bool_]:
    """Pixels (H, W) whose depth continues from the nearest core pixel without a jump."""
    if not core.any():
        return np.zeros_like(core)
    apart, nearest = distance_transform_edt(~core, return_indices=True)
    with np.errstate(invalid="ignore"):
        step = np.abs(depth - depth[tuple(nearest)])
        return np.asarray(step < _SLOPE * apart * depth / focal)


def _measured(depth: NDArray[np.float32]) -> NDArray[np.bool_]:
    return np.asarray(np.isfinite(depth) & (depth > 0))
