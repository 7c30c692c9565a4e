"""Depth along the colour camera's axis: librealsense's alignment moves pixels, but leaves the values unchanged."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gvla2.geometry.transform import FloatArray
from gvla2.robot.calibration import Intrinsics


@dataclass(frozen=True)
class ColourAxis:
    """Turns depths along the depth sensor's axis into depths along the colour camera's.

    With colour_from_depth = (R, t), a point z_c r on the ray r of a colour pixel has z_d = R_3 . (z_c r - t), where
    R_3 is the third column of R. ``shift`` is R_3 . t in metres, ``share`` (H, W) is R_3 . r.
    """

    shift: float
    share: FloatArray

    def depth(self, aligned: NDArray[np.float32]) -> NDArray[np.float32]:
        """Metres along the colour camera's z, (H, W); NaN stays NaN."""
        return ((aligned + self.shift) / self.share).astype(np.float32)


def colour_axis(extrinsics: Any, intrinsics: Intrinsics) -> ColourAxis:
    """For straight colour pictures of ``intrinsics``; ``extrinsics`` are librealsense's, from depth to colour."""
    column = np.array(extrinsics.rotation[6:9], dtype=np.float64)  # librealsense stores column after column
    u, v = np.meshgrid(np.arange(intrinsics.width) + 0.5, np.arange(intrinsics.height) + 0.5)
    rays = np.stack([(u - intrinsics.cx) / intrinsics.fx, (v - intrinsics.cy) / intrinsics.fy], -1)
    share = rays @ column[:2] + column[2]  # (H, W)
    return ColourAxis(float(column @ np.array(extrinsics.translation)), share)
