"""Stragglers: points that a mean over views left between two surfaces, and where they belong instead."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import distance_transform_edt

from gvla2.geometry.transform import FloatArray
from gvla2.geometry.views import Views
from gvla2.reconstruction.compiled import compiled, run_chunks
from gvla2.reconstruction.support import NEAR, mask_of, projection

_TRAVEL = 0.3
"""What a metre of way costs, against a metre before a seen surface or outside a mask."""


def settle(
    moved: FloatArray, start: FloatArray, views: Views, depth: FloatArray, tolerance: float
) -> FloatArray:
    """Points (N, 3), those in empty space by more than ``tolerance`` metres taken to the likeliest surface.

    Empty is what a view sees through: before the prior's ``depth`` (S, H, W; 0 where unknown) or outside its mask.
    Tried are the point's place before (``start``), and both places slid along each view's ray to its depth; the one
    that lies least in empty space, for the least way, is taken.
    """
    outside = np.stack([distance_transform_edt(mask_of(view) <= 0.5) for view in views])
    P = np.stack([projection(view.camera) for view in views])
    positions = np.stack([view.camera.position for view in views])
    pixel = np.array([1.0 / view.camera.K[0, 0] for view in views])
    result = np.ascontiguousarray(moved).copy()

    def body(first: int, last: int) -> None:
        _settle(result, start, P, positions, pixel, depth, outside, tolerance, first, last)

    run_chunks(body, len(moved))
    return result


@compiled
def _emptiness(
    x: float, y: float, z: float, P: FloatArray, pixel: FloatArray, depth: FloatArray, outside: FloatArray
) -> float:
    """Metres by which a point lies in empty space, summed over the views."""
    views, height, width = depth.shape
    total = 0.0
    for s in range(views):
        here = P[s, 2, 0] * x + P[s, 2, 1] * y + P[s, 2, 2] * z + P[s, 2, 3]
        if not here > NEAR:
            continue
        u = (P[s, 0, 0] * x + P[s, 0, 1] * y + P[s, 0, 2] * z + P[s, 0, 3]) / here
        v = (P[s, 1, 0] * x + P[s, 1, 1] * y + P[s, 1, 2] * z + P[s, 1, 3]) / here
        if not (u >= 0 and v >= 0 and u < width and v < height):
            continue
        row, column = int(v), int(u)
        if outside[s, row, column] > 0:
            total += outside[s, row, column] * here * pixel[s]
        elif depth[s, row, column] > 0:
            total += max(0.0, depth[s, row, column] - here)
    return total


@compiled
def _settle(
    points: FloatArray,
    start: FloatArray,
    P: FloatArray,
    positions: FloatArray,
    pixel: FloatArray,
    depth: FloatArray,
    outside: FloatArray,
    tolerance: float,
    first: int,
    last: int,
) -> None:
    views, height, width = depth.shape
    for n in range(first, last):
        px, py, pz = points[n, 0], points[n, 1], points[n, 2]
        best = _emptiness(px, py, pz, P, pixel, depth, outside)
        if best <= tolerance:
            continue
        bx, by, bz = px, py, pz
        for origin in range(2):
            ox, oy, oz = px, py, pz
            if origin == 1:
                ox, oy, oz = start[n, 0], start[n, 1], start[n, 2]
            for s in range(-1, views):
                x, y, z = ox, oy, oz
                if s >= 0:
                    here = P[s, 2, 0] * x + P[s, 2, 1] * y + P[s, 2, 2] * z + P[s, 2, 3]
                    if not here > NEAR:
                        continue
                    u = (P[s, 0, 0] * x + P[s, 0, 1] * y + P[s, 0, 2] * z + P[s, 0, 3]) / here
                    v = (P[s, 1, 0] * x + P[s, 1, 1] * y + P[s, 1, 2] * z + P[s, 1, 3]) / here
                    if not (u >= 0 and v >= 0 and u < width and v < height):
                        continue
                    there = depth[s, int(v), int(u)]
                    # Only out of empty space: what lies behind the depth may be another surface.
                    if not there > here:
                        continue
                    x = positions[s, 0] + (x - positions[s, 0]) * there / here
                    y = positions[s, 1] + (y - positions[s, 1]) * there / here
                    z = positions[s, 2] + (z - positions[s, 2]) * there / here
                way = np.sqrt((x - px) ** 2 + (y - py) ** 2 + (z - pz) ** 2)
                cost = _emptiness(x, y, z, P, pixel, depth, outside) + _TRAVEL * way
                if cost < best:
                    best, bx, by, bz = cost, x, y, z
        points[n, 0], points[n, 1], points[n, 2] = bx, by, bz
