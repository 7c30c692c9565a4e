"""The field whose zero is the visual hull: how deep a point lies inside all silhouettes"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gvla2.geometry.transform import FloatArray
from gvla2.reconstruction.compiled import compiled, run_chunks
from gvla2.reconstruction.silhouette import Silhouette
from gvla2.reconstruction.support import projection

_DEEP = 3.0  # the field is exact within this many voxels of the surface and clipped beyond


@dataclass(frozen=True)
class Field:
    """``values`` (X, Y, Z) float32, metres inside the hull (negative outside), at origin + step * index."""

    values: NDArray[np.float32]
    origin: FloatArray
    step: float

    def points(self, index: NDArray[np.intp]) -> FloatArray:
        """(N, 3) world points of voxels (N, 3)."""
        return np.asarray(self.origin + self.step * index, dtype=np.float64)


class PackedSilhouettes(NamedTuple):
    """Silhouettes of any sizes in flat arrays, as the kernel wants them."""

    projections: FloatArray  # (S, 3, 4)
    sizes: NDArray[np.int64]  # (S, 3) width, height, first pixel
    metres: FloatArray  # (S,) size of a pixel at depth 1
    cut: NDArray[np.bool_]  # (S, 4)
    depths: FloatArray  # (S, 2)
    distances: NDArray[np.float32]  # all pixels


def pack(silhouettes: Sequence[Silhouette], depths: FloatArray) -> PackedSilhouettes:
    """Silhouettes and the depths (S, 2) in metres between which the object lies, for :func:`fill`."""
    starts = np.cumsum([0] + [s.distance.size for s in silhouettes])
    return PackedSilhouettes(
        np.array([projection(s.camera) for s in silhouettes]),
        np.array(
            [[*s.distance.shape[::-1], start] for s, start in zip(silhouettes, starts[:-1], strict=True)]
        ),
        np.array([2.0 / (s.camera.K[0, 0] + s.camera.K[1, 1]) for s in silhouettes]),
        np.array([s.cut for s in silhouettes]),
        np.asarray(depths, dtype=np.float64),
        np.concatenate([s.distance.ravel() for s in silhouettes]),
    )


def fill(packed: PackedSilhouettes, bounds: FloatArray, step: float) -> Field:
    """The field on a grid of spacing ``step`` (metres) that covers ``bounds`` (2, 3) with two voxels around.

    A view in which a point falls outside the image says nothing about it if the mask is cut on that side, and that
    the point is outside the object if not.
    """
    shape = np.ceil((bounds[1] - bounds[0]) / step).astype(np.int64) + 5
    origin = 0.5 * (bounds[0] + bounds[1]) - 0.5 * step * (shape - 1)
    values = np.empty(tuple(shape), dtype=np.float32)
    run_chunks(partial(_fill, values, origin, step, packed, _DEEP * step), len(values), least=16)
    # Whatever reaches the grid's end is closed there: a surface has no rim.
    for axis in range(3):
        for end in (0, -1):
            layer = np.moveaxis(values, axis, 0)[end]
            np.minimum(layer, np.float32(-0.5 * step), out=layer)
    return Field(values, origin, step)


@compiled
def _fill(
    values: NDArray[np.float32],
    origin: FloatArray,
    step: float,
    packed: PackedSilhouettes,
    deep: float,
    start: int,
    stop: int,
) -> None:
    projections, sizes, metres, cut, depths, distances = packed
    _, ny, nz = values.shape
    for i in range(start, stop):
        x = origin[0] + step * i
        for j in range(ny):
            y = origin[1] + step * j
            for k in range(nz):
                z = origin[2] + step * k
                least = deep
                seen = False
                for s in range(len(projections)):
                    P = projections[s]
                    depth = P[2, 0] * x + P[2, 1] * y + P[2, 2] * z + P[2, 3]
                    if depth <= 1e-6:
                        least = -deep
                        break
                    near, far = depths[s, 0], depths[s, 1]
                    least = min(least, depth - near, far - depth)
                    u = (P[0, 0] * x + P[0, 1] * y + P[0, 2] * z + P[0, 3]) / depth - 0.5
                    v = (P[1, 0] * x + P[1, 1] * y + P[1, 2] * z + P[1, 3]) / depth - 0.5
                    width, height, first = sizes[s, 0], sizes[s, 1], sizes[s, 2]
                    unknown = (
                        (u < -0.5 and cut[s, 0])
                        or (v < -0.5 and cut[s, 1])
                        or (u > width - 0.5 and cut[s, 2])
                        or (v > height - 0.5 and cut[s, 3])
                    )
                    if unknown:
                        continue
                    inside_u = min(max(u, 0.0), width - 1.0)
                    inside_v = min(max(v, 0.0), height - 1.0)
                    column, row = min(int(inside_u), width - 2), min(int(inside_v), height - 2)
                    column, row = max(column, 0), max(row, 0)
                    right, below = min(column + 1, width - 1), min(row + 1, height - 1)
                    a, b = inside_u - column, inside_v - row
                    top, bottom = first + row * width, first + below * width
                    d00, d01 = distances[top + column], distances[top + right]
                    d10, d11 = distances[bottom + column], distances[bottom + right]
                    if d00 == np.inf or d01 == np.inf or d10 == np.inf or d11 == np.inf:
                        continue
                    seen = True
                    distance = (1 - b) * ((1 - a) * d00 + a * d01) + b * ((1 - a) * d10 + a * d11)
                    distance -= abs(u - inside_u) + abs(v - inside_v)
                    least = min(least, distance * metres[s] * depth)
                    if least <= -deep:
                        least = -deep
                        break
                values[i, j, k] = least if seen else -deep
