"""Which points a camera sees, by a z-buffer of splatted points."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gvla2.errors import GeometryError
from gvla2.geometry.camera import Camera
from gvla2.geometry.transform import FloatArray
from gvla2.reconstruction.compiled import compiled
from gvla2.reconstruction.support import NEAR, as_points, projection

_LARGEST_SPLAT = 12
"""Pixels around its own that a point may cover: beyond, the points are too few to hide one another."""


def depth_of_points(points: ArrayLike, camera: Camera, spacing: float) -> NDArray[np.float64]:
    """Z-buffer (H, W), metres along the camera's z, infinite where nothing is, of world points (N, 3).

    Each point covers a square as wide as ``spacing``, the points' typical distance in metres, so that a surface
    of points is closed. Points that are not finite or lie behind the camera are left out.
    """
    array = as_points(points)
    if not spacing >= 0:
        raise GeometryError(f"The spacing of points must be >= 0 metres, got {spacing}.")
    buffer = np.full((camera.height, camera.width), np.inf)
    _splat(array, projection(camera), 0.5 * spacing * camera.K[0, 0], _LARGEST_SPLAT, buffer)
    return buffer


def visible_points(points: ArrayLike, camera: Camera, spacing: float, tolerance: float) -> NDArray[np.bool_]:
    """(N,) which world points (N, 3) lie inside the image and at most ``tolerance`` metres behind the z-buffer."""
    array = as_points(points)
    buffer = depth_of_points(array, camera, spacing)
    seen = np.zeros(len(array), dtype=np.bool_)
    _compare(array, projection(camera), buffer, tolerance, seen)
    return seen


@compiled
def _splat(
    points: FloatArray, P: FloatArray, half_width: float, largest: int, buffer: NDArray[np.float64]
) -> None:
    height, width = buffer.shape
    for n in range(len(points)):
        x, y, z = points[n, 0], points[n, 1], points[n, 2]
        depth = P[2, 0] * x + P[2, 1] * y + P[2, 2] * z + P[2, 3]
        if not (depth > NEAR and depth < np.inf):
            continue
        u = (P[0, 0] * x + P[0, 1] * y + P[0, 2] * z + P[0, 3]) / depth
        v = (P[1, 0] * x + P[1, 1] * y + P[1, 2] * z + P[1, 3]) / depth
        if not (u > -largest and v > -largest and u < width + largest and v < height + largest):
            continue
        radius = min(half_width / depth, float(largest))
        left, right = max(math.floor(u - radius), 0), min(math.floor(u + radius), width - 1)
        top, bottom = max(math.floor(v - radius), 0), min(math.floor(v + radius), height - 1)
        for row in range(top, bottom + 1):
            for column in range(left, right + 1):
                if depth < buffer[row, column]:
                    buffer[row, column] = depth


@compiled
def _compare(
    points: FloatArray,
    P: FloatArray,
    buffer: NDArray[np.float64],
    tolerance: float,
    seen: NDArray[np.bool_],
) -> None:
    height, width = buffer.shape
    for n in range(len(points)):
        x, y, z = points[n, 0], points[n, 1], points[n, 2]
        depth = P[2, 0] * x + P[2, 1] * y + P[2, 2] * z + P[2, 3]
        if not (depth > NEAR and depth < np.inf):
            continue
        u = (P[0, 0] * x + P[0, 1] * y + P[0, 2] * z + P[0, 3]) / depth
        v = (P[1, 0] * x + P[1, 1] * y + P[1, 2] * z + P[1, 3]) / depth
        if u >= 0 and v >= 0 and u < width and v < height:
            seen[n] = depth <= buffer[int(v), int(u)] + tolerance
