"""Split by height: a thing of one colour that no single solid explains becomes parts, such as base, post and shade."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from gvla2.geometry.transform import FloatArray
from gvla2_plugins.classical.clusters import components
from gvla2_plugins.classical.pixels import IntArray
from gvla2_plugins.classical.solids import narrow_yaw

SLICE = 0.010  # metres
REACH = 0.014  # points of one part in one slice are no further apart
LIKE = 0.45  # intersection over union of two slices' rectangles that belong to one part
BESIDE = 0.5  # of the larger of two parts' heights that both reach over: they stand side by side
SKIP = 4  # slices without points that a part may reach over, where it was hidden


def split_by_height(points: FloatArray, least: int) -> list[IntArray]:
    """Indices of each part's points (N, 3), lowest part first; one entry when nothing tells parts apart.

    The points are cut into slices; patches of neighbouring slices with much the same footprint are one part.
    """
    yaw, _, _ = narrow_yaw(points[:, :2])
    c, s = np.cos(yaw), np.sin(yaw)
    xy = points[:, :2] @ np.array([[c, -s], [s, c]])
    slices = np.floor(points[:, 2] / SLICE + 0.5).astype(np.int64)
    patches = _patches(xy, slices)  # (level, indices)
    if len(patches) < 2:
        return [np.arange(len(points))]
    boxes = np.array([[*xy[i].min(axis=0), *xy[i].max(axis=0)] for _, i in patches])
    links = []
    for upper, (level, _) in enumerate(patches):
        under = [k for k, (other, _) in enumerate(patches) if 0 < level - other <= SKIP]
        best = max(under, key=lambda k: (_overlap(boxes[upper], boxes[k]), patches[k][0]), default=None)
        if best is not None and _overlap(boxes[upper], boxes[best]) > LIKE:
            links.append((upper, best))
    part_of = components(len(patches), np.array(links, dtype=np.int64).reshape(-1, 2))
    parts = [
        np.concatenate([patches[k][1] for k in np.nonzero(part_of == part)[0]]) for part in np.unique(part_of)
    ]
    large = _beside_made_one(points[:, 2], [p for p in parts if len(p) >= least])
    if len(large) < 2:
        return [np.arange(len(points))]
    # Leftovers go to the part they lie next to.
    owner = np.full(len(points), -1, dtype=np.int64)
    for number, part in enumerate(large):
        owner[part] = number
    rest = np.nonzero(owner < 0)[0]
    if len(rest):
        known = np.nonzero(owner >= 0)[0]
        owner[rest] = owner[known[cKDTree(points[known]).query(points[rest])[1]]]
    return [np.nonzero(owner == number)[0] for number in range(len(large))]


def _beside_made_one(heights: FloatArray, parts: list[IntArray]) -> list[IntArray]:
    """The parts, lowest first, with those made one that reach over much the same heights (N,): sides of one thing."""
    spans = [np.percentile(heights[p], [2.0, 98.0]) for p in parts]
    links = []
    for i, (low, high) in enumerate(spans):
        for j, (other_low, other_high) in enumerate(spans[:i]):
            shared = min(high, other_high) - max(low, other_low)
            if shared > BESIDE * max(high - low, other_high - other_low, SLICE):
                links.append((i, j))
    one = components(len(parts), np.array(links, dtype=np.int64).reshape(-1, 2))
    joined = [np.concatenate([parts[i] for i in np.nonzero(one == k)[0]]) for k in np.unique(one)]
    return sorted(joined, key=lambda p: float(np.median(heights[p])))


def _patches(xy: FloatArray, slices: IntArray) -> list[tuple[int, IntArray]]:
    patches = []
    for level in np.unique(slices):
        inside = np.nonzero(slices == level)[0]
        pairs = cKDTree(xy[inside]).query_pairs(REACH, output_type="ndarray")
        labels = components(len(inside), pairs)
        patches += [(int(level), inside[labels == k]) for k in np.unique(labels) if (labels == k).sum() >= 3]
    return patches


def _overlap(a: FloatArray, b: FloatArray) -> float:
    sides = np.minimum(a[2:], b[2:]) - np.maximum(a[:2], b[:2])
    if (sides <= 0).any():
        return 0.0
    shared = float(sides.prod())
    return shared / max(1e-12, float((a[2:] - a[:2]).prod() + (b[2:] - b[:2]).prod()) - shared)
