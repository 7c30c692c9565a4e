"""Split by height: a thing of one colour that no single solid explains becomes parts, such as base, post and shade."""

from __future__ import annotations

import numpy as np

from gvla2.geometry.transform import FloatArray
from gvla2_plugins.classical.frames import IntArray
from gvla2_plugins.classical.solids import narrow_yaw

SLICE = 0.010  # metres
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


def _overlap(a: FloatArray, b: FloatArray) -> float:
    """Intersection over union of two rectangles, (2, 2): lowest corner, highest corner."""
    sides = np.minimum(a[1], b[1]) - np.maximum(a[0], b[0])
    shared = float(np.maximum(sides, 0.0).prod())
    return shared / max(1e-12, float((a[1] - a[0]).prod() + (b[1] - b[0]).prod()) - shared)
