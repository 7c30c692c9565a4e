"""Openings of meshes at their top."""

from __future__ import annotations

import numpy as np

from gvla2.geometry.transform import FloatArray, transform_points
from gvla2.robot.scan import Scan

CELL = 0.008
"""Side of the vertical columns that are sampled, metres."""

DEEP, INNER = 0.45, 0.35
"""A vessel's bottom is lower than this share of its height; it is looked for within this share of its half width."""


def mouth(scan: Scan, pose: FloatArray) -> float:
    """Width of the opening at the top of the thing, posed at ``pose`` (4, 4), metres; 0 if it is closed or shallow.

    Seen from straight above: the lowest thing in sight about its middle is its bottom, and all about it the wall rises.
    A plate counts: what lies on it lies in it.
    """
    points, _ = scan.textured.mesh.sample(20_000, np.random.default_rng(0))
    points = transform_points(pose, points)
    low, high = points.min(axis=0), points.max(axis=0)
    half, middle = 0.5 * (high - low)[:2], 0.5 * (high + low)[:2]
    columns = np.floor((points[:, :2] - low[:2]) / CELL).astype(int)
    key = columns[:, 0] * 10_000 + columns[:, 1]
    order = np.lexsort((points[:, 2], key))
    tops = order[np.flatnonzero(np.diff(key[order], append=-1))]  # the highest of each column
    seen, height = points[tops], float(high[2] - low[2])
    level = (seen[:, 2] - low[2]) / max(height, 1e-9)
    out = np.abs(seen[:, :2] - middle) / half
    inner = (out < INNER).all(axis=1)
    if not inner.any() or np.median(level[inner]) > DEEP:
        return 0.0
    away = seen[:, :2] - middle
    turn = np.floor((np.arctan2(away[:, 1], away[:, 0]) + np.pi) / (np.pi / 6)).astype(int) % 12
    reach = np.linalg.norm(away, axis=1)
    walls = [reach[(turn == k) & (level > 0.75)] for k in range(12)]
    if any(len(wall) == 0 for wall in walls):
        return 0.0
    nearest = np.array([wall.min() for wall in walls])
    return float(2.0 * nearest.min())
