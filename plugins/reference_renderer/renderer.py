"""Elliptical weighted average splatting (Zwicker et al. 2001; Kerbl et al. 2023), written for readability.

It is slow: a Python loop over the Gaussians, no tiles, no early stop. It is the reference for faster renderers.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gvla2.errors import ConfigurationError
from gvla2.geometry.camera import Camera
from gvla2.geometry.gaussians import Gaussians
from gvla2.geometry.transform import FloatArray, transform_points
from gvla2.reconstruction.rasteriser_projection import harmonics
from gvla2_plugins.reference_renderer import ReferenceRendererConfig


def view_colours(gaussians: Gaussians, eye: FloatArray) -> FloatArray:
    """(N, 3) RGB >= 0 of each Gaussian seen from ``eye`` (3,), in the Gaussians' frame, metres."""
    colour = gaussians.rgb.astype(np.float64)
    if gaussians.sh_rest is not None:
        away = gaussians.centres - eye
        directions = away / np.maximum(np.linalg.norm(away, axis=1, keepdims=True), 1e-12)
        count = gaussians.sh_rest.shape[1] // 3
        coefficients = gaussians.sh_rest.reshape(len(gaussians), 3, count)  # files hold channel by channel
        colour = colour + np.einsum(
            "nck,nk->nc", coefficients, np.stack(harmonics(*directions.T), axis=1)[:, :count]
        )
    return np.maximum(colour, 0.0)


_FRUSTUM_MARGIN = 1.3  # as in 3DGS: beyond it the projection's linearisation is taken at the margin


@dataclass(frozen=True)
class _Footprints:
    """Gaussians projected to the image, nearest first; ``row`` (M,) is each one's row in the input.

    ``uv`` (M, 2) pixels; ``covariances`` (M, 2, 2) square pixels.
    """

    row: NDArray[np.intp]
    uv: FloatArray
    covariances: FloatArray


class ReferenceRenderer:
    """Exact front-to-back alpha compositing of projected anisotropic Gaussians.

    Exact up to the method's own approximation: perspective is linearised at each Gaussian's centre, and
    Gaussians are ordered by their centres' depth.
    """

    def __init__(self, config: ReferenceRendererConfig) -> None:
        if not 0 < config.min_alpha < config.max_alpha <= 1 or config.near <= 0 or config.low_pass < 0:
            raise ConfigurationError(
                "renderer=reference needs 0 < min_alpha < max_alpha <= 1, near > 0 and low_pass >= 0, got "
                f"{config.min_alpha}, {config.max_alpha}, {config.near} and {config.low_pass}."
            )
        self._config = config

    def render(
        self, gaussians: Gaussians, camera: Camera, background: tuple[float, float, float] = (1.0, 1.0, 1.0)
    ) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Image (H, W, 3) and alpha (H, W), both float32 in [0, 1]; the image has the background added."""
        pixels = camera.pixel_centres()
        colours = view_colours(gaussians, camera.position)
        opacities = gaussians.opacities.astype(np.float64)
        image = np.zeros((camera.height, camera.width, 3))
        left = np.ones((camera.height, camera.width))  # the light still passing: T of the 3DGS paper, eq. 3
        footprints = self._project(gaussians, camera)
        for row, uv, covariance in zip(footprints.row, footprints.uv, footprints.covariances, strict=True):
            window = self._window(uv, covariance, opacities[row], camera)
            if window is None:
                continue
            offset = pixels[window] - uv
            distance = np.einsum("...i,ij,...j", offset, np.linalg.inv(covariance), offset)
            alpha = np.minimum(opacities[row] * np.exp(-0.5 * distance), self._config.max_alpha)
            alpha[alpha < self._config.min_alpha] = 0.0
            image[window] += (left[window] * alpha)[..., None] * colours[row]
            left[window] *= 1.0 - alpha
        image += left[..., None] * np.asarray(background)
        return np.clip(image, 0.0, 1.0).astype(np.float32), (1.0 - left).astype(np.float32)

    def _project(self, gaussians: Gaussians, camera: Camera) -> _Footprints:
        local = transform_points(camera.camera_from_world, gaussians.centres)
        row = np.flatnonzero(local[:, 2] > self._config.near)
        row = row[np.argsort(local[row, 2], kind="stable")]
        centre = local[row]
        x, y, z = centre.T
        K = camera.K
        # The slope at which the image ends, on either side; the principal point need not be central.
        left, right = -K[0, 2] / K[0, 0], (camera.width - K[0, 2]) / K[0, 0]
        top, bottom = -K[1, 2] / K[1, 1], (camera.height - K[1, 2]) / K[1, 1]
        slope_x = np.clip(x / z, _FRUSTUM_MARGIN * left, _FRUSTUM_MARGIN * right)
        slope_y = np.clip(y / z, _FRUSTUM_MARGIN * top, _FRUSTUM_MARGIN * bottom)
        zero = np.zeros_like(z)
        slopes_from_camera = np.array([[1 / z, zero, -slope_x / z], [zero, 1 / z, -slope_y / z]])  # (2, 3, M)
        jacobian = np.einsum("ij,jkm->mik", K[:2, :2], slopes_from_camera)
        jacobian = jacobian @ camera.camera_from_world[:3, :3]
        covariances = jacobian @ gaussians.covariances()[row] @ jacobian.transpose(0, 2, 1)
        uv, _ = camera.project(gaussians.centres[row].astype(np.float64))
        return _Footprints(row, uv, covariances + self._config.low_pass * np.eye(2))

    def _window(
        self, uv: FloatArray, covariance: FloatArray, opacity: float, camera: Camera
    ) -> tuple[slice, slice] | None:
        """Rows and columns outside which the Gaussian's alpha is certainly below ``min_alpha``."""
        if opacity < self._config.min_alpha:
            return None
        reach = np.sqrt(2 * np.log(opacity / self._config.min_alpha) * np.diagonal(covariance))
        size = (camera.width, camera.height)
        low = np.clip(np.floor(uv - reach - 0.5), 0, size).astype(int)
        high = np.clip(np.ceil(uv + reach + 0.5), 0, size).astype(int)
        if (low >= high).any():
            return None
        return slice(low[1], high[1]), slice(low[0], high[0])
