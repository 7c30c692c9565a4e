"""Corrections that are known for some points of an object, carried to all of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import cKDTree

from gvla2.geometry.transform import FloatArray
from gvla2.reconstruction.compiled import compiled, cores
from gvla2.reconstruction.support import as_points

_MOST_ANCHORS = 25_000
_NEIGHBOURS, _PARENTS = 8, 2


class Neighbourhood:
    """Who is near whom among points (N, 3): smoothing takes place on at most 25 thousand anchors.

    ``spacing`` is the typical distance of all points from their nearest neighbour on a surface, metres.
    """

    def __init__(self, points: FloatArray, seed: int = 0) -> None:
        count = len(points)
        chosen = np.arange(count)
        if count > _MOST_ANCHORS:
            chosen = np.sort(np.random.default_rng(seed).choice(count, _MOST_ANCHORS, replace=False))
        self._anchors = chosen
        tree = cKDTree(points[chosen])
        many = min(_NEIGHBOURS, len(chosen) - 1) + 1
        distance, self._graph = _nearest(tree, points[chosen], many)
        reach = float(np.median(distance[:, -1]))
        self.spacing = reach / np.sqrt(max(many - 1, 1) / np.pi) * np.sqrt(len(chosen) / count)
        reach = max(reach, 1e-12)
        self._closeness = np.exp(-0.5 * (distance / reach) ** 2)
        self._closeness[:, 0] = 0.0  # the point itself
        self._parents: NDArray[np.int64] | None = None
        if len(chosen) < count:
            apart, self._parents = _nearest(tree, points, _PARENTS)
            self._shares = np.exp(-0.5 * (apart / reach) ** 2) + 1e-9
            self._shares /= self._shares.sum(axis=1, keepdims=True)

    def spread(self, field: FloatArray, sureness: FloatArray, passes: int) -> tuple[FloatArray, FloatArray]:
        """Neighbours' mean of a field (N, 3) known with sureness (N,) in [0, 1], and how sure that mean is.

        Each pass carries what is known one ring of neighbours farther, and less sure, so that points that
        nobody sees follow those that somebody sees.
        """
        values = np.ascontiguousarray(field[self._anchors])
        weights = np.ascontiguousarray(sureness[self._anchors])
        mean, sure = _diffuse(values, weights, self._graph, self._closeness, passes)
        if self._parents is None:
            return mean, sure
        sure_here = self._shares * sure[self._parents]
        total = sure_here.sum(axis=1)
        spread = np.einsum("nk,nkd->nd", sure_here, mean[self._parents])
        return spread / np.maximum(total, 1e-12)[:, None], total


@dataclass(frozen=True)
class Displacement:
    """A displacement field known at ``points`` (N, 3), as ``offsets`` (N, 3), metres."""

    points: FloatArray
    offsets: FloatArray

    def at(self, others: ArrayLike) -> FloatArray:
        """Offsets (M, 3) at other points (M, 3) of the same object, from the four nearest known ones.

        Weights fall with the square of the distance, so that a known point gets its own offset. Points that are
        not finite stay.
        """
        array = as_points(others)
        result = np.zeros_like(array)
        finite = np.isfinite(array).all(axis=1)
        if len(self.points) == 0 or not finite.any() or not self.offsets.any():
            return result
        many = min(4, len(self.points))
        distance, index = _nearest(cKDTree(self.points), array[finite], many)
        # Far beyond rounding, far below any spacing.
        floor = 1e-9 * float(np.abs(self.points).max() + 1e-9)
        weight = 1.0 / (distance**2 + floor**2)
        weight /= weight.sum(axis=1, keepdims=True)
        result[finite] = np.einsum("mk,mkd->md", weight, self.offsets[index])
        return result

    def move(self, others: ArrayLike) -> FloatArray:
        """The other points (M, 3), moved."""
        return as_points(others) + self.at(others)


def _nearest(tree: cKDTree, points: FloatArray, many: int) -> tuple[FloatArray, NDArray[np.int64]]:
    """Distances and indices (N, many) of the nearest neighbours."""
    distance, index = tree.query(points, k=np.arange(1, many + 1), workers=cores())
    return np.asarray(distance, dtype=np.float64), np.ascontiguousarray(index, dtype=np.int64)


@compiled
def _diffuse(
    values: FloatArray,
    weights: FloatArray,
    graph: NDArray[np.int64],
    closeness: FloatArray,
    passes: int,
) -> tuple[FloatArray, FloatArray]:
    """Normalised convolution on the graph: known values stay in, unknown ones fill from their neighbours."""
    count, many = graph.shape
    mean, sure = values.copy(), weights.copy()
    for _ in range(passes):
        next_mean, next_sure = np.zeros_like(mean), np.zeros_like(sure)
        for n in range(count):
            x = y = z = total = all_weight = 0.0
            for k in range(many):
                other = graph[n, k]
                w = closeness[n, k] * sure[other]
                x += w * mean[other, 0]
                y += w * mean[other, 1]
                z += w * mean[other, 2]
                total += w
                all_weight += closeness[n, k]
            around = total / max(all_weight, 1e-12)
            own = 5.0 * weights[n]  # what a point knows itself weighs more than what it hears
            together = own + around
            if together > 1e-12:
                share = around / together / max(total, 1e-12)
                next_mean[n, 0] = own / together * values[n, 0] + share * x
                next_mean[n, 1] = own / together * values[n, 1] + share * y
                next_mean[n, 2] = own / together * values[n, 2] + share * z
            next_sure[n] = min(together, 1.0)
        mean, sure = next_mean, next_sure
    return mean, sure
