"""The core's rasteriser behind the renderer's protocol."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gvla2.geometry.camera import Camera
from gvla2.geometry.gaussians import Gaussians
from gvla2.reconstruction.rasteriser import RasterOptions, render
from gvla2_plugins.numba_renderer import NumbaRendererConfig


class NumbaRenderer:
    """Front-to-back compositing in tiles, see :mod:`gvla2.reconstruction.rasteriser`."""

    def __init__(self, config: NumbaRendererConfig) -> None:
        self._options = RasterOptions(
            config.low_pass, config.near, config.min_alpha, config.max_alpha, config.stop, config.threads
        )

    def render(
        self, gaussians: Gaussians, camera: Camera, background: tuple[float, float, float] = (1.0, 1.0, 1.0)
    ) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Image (H, W, 3) and alpha (H, W), both float32 in [0, 1]; the image has the background added."""
        return render(gaussians, camera, background, self._options)
