"""Split by height: a thing of one colour that no single solid explains becomes parts, such as base, post and shade, or
a low and a high thing side by side.
"""

from __future__ import annotations

import numpy as np

from gvla2.geometry.transform import FloatArray
from gvla2_plugins.classical.frames import IntArray
from gvla2_plugins.classical.solids import narrow_yaw

SLICE = 0.010  # metres
CELL, EDGE = 0.005, 0.003  # metres
STEP = 0.015  # metres between the tops of things side by side
LIKE = 0.45  # intersection over union of the outlines of two neighbouring slices of one part


def split_by_height(points: FloatArray, least: int) -> list[IntArray]:
    """Indices of each part's points (N, 3), lowest part first; one entry when nothing tells parts apart.

    The points are cut into slices; where the outline changes much from one to the next, a part ends. A part of fewer
    than ``least`` points goes to the one below.
    """
    yaw, _, _ = narrow_yaw(points[:, :2])
    c, s = np.cos(yaw), np.sin(yaw)
    xy = points[:, :2] @ np.array([[c, -s], [s, c]])
    slices = np.floor(points[:, 2] / SLICE + 0.5).astype(np.int64)
    parts: list[IntArray] = []
    before: FloatArray | None = None
    for level in np.unique(slices):
        inside = np.nonzero(slices == level)[0]
        outline = np.percentile(xy[inside], [1.0, 99.0], axis=0) if len(inside) >= 3 else before
        if before is None or (_overlap(before, outline) < LIKE and len(parts[-1]) >= least):  # type: ignore[arg-type]
            parts.append(inside)
        else:
            parts[-1] = np.concatenate([parts[-1], inside])
        before = outline
    if len(parts) > 1 and len(parts[-1]) < least:
        parts[-2:] = [np.concatenate(parts[-2:])]
    return parts


def split_by_top(points: FloatArray, least: int) -> list[IntArray]:
    """Indices of the points (N, 3) over low ground and of those over high ground; one entry where there is one level.

    Each cell of the ground is as high as the highest point over it; two levels are where they differ least within.
    """
    _, cell = np.unique(np.floor(points[:, :2] / CELL).astype(np.int64), axis=0, return_inverse=True)
    cell = cell.reshape(-1)
    tops = np.full(int(cell.max()) + 1, -np.inf)
    np.maximum.at(tops, cell, points[:, 2])
    ordered = np.sort(tops)
    count = np.arange(1, len(ordered))
    total = np.cumsum(ordered)
    means = total[:-1] / count, (total[-1] - total[:-1]) / (len(ordered) - count)
    apart = count * (len(ordered) - count) * (means[1] - means[0]) ** 2
    best = int(np.argmax(apart)) if len(apart) else -1
    if best < 0 or means[1][best] - means[0][best] < STEP:
        return [np.arange(len(points))]
    # Of a wall lower points are seen where no upper ones are: what is under the upper points is all of them.
    upper = points[points[:, 2] > 0.5 * (means[0][best] + means[1][best]), :2]
    yaw, middle, lengths = narrow_yaw(upper)
    c, s = np.cos(yaw), np.sin(yaw)
    local = (points[:, :2] - middle) @ np.array([[c, -s], [s, c]])
    high = (np.abs(local) < 0.5 * lengths + EDGE).all(axis=1)
    parts = [np.nonzero(~high)[0], np.nonzero(high)[0]]
    return parts if min(map(len, parts)) >= least else [np.arange(len(points))]


def _overlap(a: FloatArray, b: FloatArray) -> float:
    """Intersection over union of two rectangles, (2, 2): lowest corner, highest corner."""
    sides = np.minimum(a[1], b[1]) - np.maximum(a[0], b[0])
    shared = float(np.maximum(sides, 0.0).prod())
    return shared / max(1e-12, float((a[1] - a[0]).prod() + (b[1] - b[0]).prod()) - shared)
