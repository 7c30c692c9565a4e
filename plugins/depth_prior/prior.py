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


class DepthPrior:
    """The views' own depth: metric and calibrated, so the estimate has no poses.

    Raises :class:`ConfigurationError` for a negative ``erode`` or ``slope`` or a ``confidence`` that is not above 0.
    """

    def __init__(self, config: DepthPriorConfig) -> None:
        if config.erode < 0:
            raise ConfigurationError(f"prior.erode counts pixels and must be >= 0, got {config.erode}.")
        if not 0 < config.confidence < float("inf"):
            raise ConfigurationError(f"prior.confidence must be a number above 0, got {config.confidence}.")
        if not 0 <= config.slope < float("inf"):
            raise ConfigurationError(f"prior.slope must be a number >= 0, got {config.slope}.")
        if config.noise not in NOISES:
            raise ConfigurationError(f"prior.noise is '{config.noise}'; available: {', '.join(NOISES)}.")
        parts = dict(vars(config.learned)) | {
            k: v for k, v in vars(config).items() if k.startswith("sensor_")
        }
        wrong = [k for k, v in parts.items() if not 0 <= v < float("inf")]
        if wrong:
            raise ConfigurationError(f"prior: {', '.join(wrong)} must be a number >= 0.")
        self._config = config
        self._slope = config.slope
        self._erode, self._confidence = config.erode, config.confidence

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
        poses = None
        sure = np.where(np.isfinite(depth), self._confidence, 0.0)
        if self._config.noise == "sensor":
            c = self._config
            noisy = sensor(
                depth.astype(np.float64),
                c.sensor_sigma,
                c.sensor_relative,
                c.sensor_dropout,
                self._rng(views),
            )
            depth, sure = noisy.astype(np.float32), np.where(np.isfinite(noisy), sure, 0.0)
        elif self._config.noise == "learned":
            given = np.stack([view.camera.world_from_camera for view in views])
            noisy, certainty, poses = learned(
                depth.astype(np.float64), given, self._config.learned, self._rng(views)
            )
            depth, sure = noisy.astype(np.float32), sure * certainty
        return GeometryEstimate(depth, sure.astype(np.float32), poses)

    def _rng(self, views: Views) -> np.random.Generator:
        """One reproducible draw per set of cameras and seed."""
        cameras = np.stack([view.camera.world_from_camera for view in views])
        return np.random.default_rng([self._config.seed, zlib.crc32(np.round(cameras, 6).tobytes())])

    def _trusted(self, depth: NDArray[np.float32], view: View) -> NDArray[np.float32]:
        keep = _measured(depth)
        if view.mask is not None:
            keep &= view.mask > 0.5
        if self._erode:
            # The picture's own border is not the object's.
            core = binary_erosion(keep, np.ones((3, 3), dtype=bool), iterations=self._erode, border_value=1)
            keep &= core | self._continues(depth, core, view.camera.K[0, 0])
        return np.where(keep, depth, np.nan).astype(np.float32)

    def _continues(
        self, depth: NDArray[np.float32], core: NDArray[np.bool_], focal: float
    ) -> NDArray[np.bool_]:
        """Where the depth continues from the nearest core pixel without a jump (H, W)."""
        if not core.any():
            return np.zeros_like(core)
        apart, nearest = distance_transform_edt(~core, return_indices=True)
        with np.errstate(invalid="ignore"):
            step = np.abs(depth - depth[tuple(nearest)])
            return np.asarray(step < self._slope * apart * depth / focal)


def _measured(depth: NDArray[np.float32]) -> NDArray[np.bool_]:
    return np.asarray(np.isfinite(depth) & (depth > 0))
