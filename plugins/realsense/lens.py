"""Straightening what the camera gives: lens distortion, and depth along the colour camera's axis."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from gvla2.errors import RobotError
from gvla2.geometry.transform import FloatArray
from gvla2.robot.calibration import Intrinsics

NEGLIGIBLE = 0.25
"""Pixels; below this distortion everywhere, pictures are left unchanged."""


def pinhole(given: Any) -> Intrinsics:
    """Our intrinsics of a stream's. librealsense counts from the first pixel's centre, we from its corner."""
    return Intrinsics(
        float(given.fx),
        float(given.fy),
        float(given.ppx) + 0.5,
        float(given.ppy) + 0.5,
        int(given.width),
        int(given.height),
    )


@dataclass(frozen=True)
class Lens:
    """Where in the bent picture each pixel of the straight one lies: ``rows`` and ``columns`` (H, W), pixels."""

    rows: NDArray[np.float32]
    columns: NDArray[np.float32]

    def image(self, bent: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """The straight picture (H, W, 3); black where the bent one does not reach."""
        return np.asarray(cv2.remap(bent, self.columns, self.rows, cv2.INTER_LINEAR), dtype=np.uint8)

    def depth(self, bent: NDArray[np.float32]) -> NDArray[np.float32]:
        """The straight depth (H, W), each from the nearest pixel: averages across an edge would lie on no surface."""
        nearest, outside = cv2.INTER_NEAREST, cv2.BORDER_CONSTANT
        straight = cv2.remap(bent, self.columns, self.rows, nearest, borderMode=outside, borderValue=np.nan)
        return np.asarray(straight, dtype=np.float32)


def lens_of(rs: Any, given: Any) -> Lens | None:
    """The undistortion of a stream's pictures, by librealsense's own model of its lens; None if not needed."""
    if given.model == rs.distortion.none or not any(given.coeffs):
        return None
    columns, rows = np.meshgrid(np.arange(given.width, dtype=float), np.arange(given.height, dtype=float))
    rays = np.stack([(columns - given.ppx) / given.fx, (rows - given.ppy) / given.fy, np.ones_like(rows)], -1)
    project = rs.rs2_project_point_to_pixel
    bent = np.array([project(given, ray) for ray in rays.reshape(-1, 3).tolist()]).reshape(*rows.shape, 2)
    if not np.isfinite(bent).all():
        raise RobotError(f"The camera reports an invalid lens: {given.model}, {list(given.coeffs)}.")
    if np.abs(bent - np.stack([columns, rows], -1)).max() < NEGLIGIBLE:
        return None
    return Lens(bent[..., 1].astype(np.float32), bent[..., 0].astype(np.float32))


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
