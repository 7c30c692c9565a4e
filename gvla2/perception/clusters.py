"""Connected components in 3D above the table, over all views together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import convolve
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from gvla2.geometry.transform import FloatArray
from gvla2.perception.frames import BoolArray, ViewFrame

IntArray = NDArray[np.int64]

CELL = 0.004
"""Side of the cells that points are gathered in, metres."""
REACH = 0.011
"""Largest distance between cells of one cluster, metres."""
LEAST = 14
"""Pixels of all views together that make a cluster; fewer are flying pixels."""


@dataclass(frozen=True)
class Clusters:
    """``maps``: one image (H, W) per view of indices 0 to ``count`` - 1, -1 where none is seen."""

    maps: tuple[IntArray, ...]
    count: int

    def points(self, frames: Sequence[ViewFrame], index: int) -> FloatArray:
        """(N, 3) all seen points of one cluster, world, metres."""
        return np.concatenate([f.points[m == index] for f, m in zip(frames, self.maps, strict=True)])


def clusters(frames: Sequence[ViewFrame], masks: Sequence[BoolArray], least: int = LEAST) -> Clusters:
    """The connected components of the masked (H, W) pixels' points, largest first."""
    masks = [without_specks(mask) for mask in masks]
    points = np.concatenate([f.points[m] for f, m in zip(frames, masks, strict=True)])
    if not len(points):
        return Clusters(tuple(np.full(m.shape, -1) for m in masks), 0)
    parts = components(points)
    sizes = np.bincount(parts)
    order = np.argsort(-sizes, kind="stable")
    kept = order[sizes[order] >= least]
    renamed = np.full(len(sizes), -1)
    renamed[kept] = np.arange(len(kept))
    labels, maps, start = renamed[parts], [], 0
    for mask in masks:
        image, count = np.full(mask.shape, -1), int(mask.sum())
        image[mask] = labels[start : start + count]
        maps.append(image)
        start += count
    return Clusters(tuple(maps), len(kept))


def components(points: FloatArray, reach: float = REACH) -> IntArray:
    """(N,) component of each point (N, 3): joined where cells that hold points lie within ``reach`` metres."""
    cells, inverse, counts = np.unique(
        np.floor(points / CELL).astype(np.int64), axis=0, return_inverse=True, return_counts=True
    )
    centres = (
        np.stack([np.bincount(inverse.reshape(-1), points[:, k]) for k in range(3)], axis=1) / counts[:, None]
    )
    pairs = cKDTree(centres).query_pairs(reach, output_type="ndarray")
    graph = coo_matrix((np.ones(len(pairs), dtype=np.int8), pairs.T), shape=(len(cells), len(cells)))
    return np.asarray(connected_components(graph, directed=False)[1], dtype=np.int64)[inverse.reshape(-1)]


def without_specks(mask: BoolArray, least: int = 3) -> BoolArray:
    """The mask (H, W) without pixels that have fewer than ``least`` of eight neighbours in it."""
    kernel = np.ones((3, 3), dtype=np.int8)
    kernel[1, 1] = 0
    return np.asarray(mask & (convolve(mask.astype(np.int8), kernel, mode="constant") >= least))
