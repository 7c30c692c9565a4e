"""What a mesh allows: how it lies when it has fallen, and whether it is open at its top."""

from __future__ import annotations

import numpy as np
from scipy.spatial import ConvexHull, QhullError
from scipy.spatial.transform import Rotation

from gvla2.geometry.transform import FloatArray, transform_points
from gvla2.robot.scan import Scan


def fallen(hull: FloatArray, centre: FloatArray, rng: np.random.Generator) -> FloatArray:
    """A rotation (3, 3), its z axis up, in which an object dropped at random comes to rest on a plane.

    ``hull`` (N, 3) are the corners of its convex hull and ``centre`` (3,) its centre of mass, one frame, metres. It
    lands on some face and rolls over the edge beyond which its centre lies, until its centre is above the face:
    quasi-static, without momentum (Goldberg et al. 1999, "Part pose statistics"). Any rotation about z is equally
    likely.
    """
    turn = Rotation.random(random_state=rng).as_matrix()
    try:
        solid = ConvexHull(hull)
    except QhullError:  # flat: it lies on one side or the other
        _, _, axes = np.linalg.svd(hull - hull.mean(axis=0), full_matrices=False)
        down = axes[2] * (1.0 if rng.random() < 0.5 else -1.0)
        return _standing(down, turn)
    normals, offsets = solid.equations[:, :3], solid.equations[:, 3]
    slope = normals @ (-turn[2])
    height = -(offsets + normals @ centre)
    with np.errstate(divide="ignore", invalid="ignore"):
        face = int(np.argmin(np.where(slope > 1e-9, height / slope, np.inf)))
    for _ in range(len(normals)):
        corners = solid.points[solid.simplices[face]]
        foot = centre + height[face] * normals[face]
        over = _edge_beyond(corners, foot, normals[face])
        if over is None:
            break
        beyond = int(solid.neighbors[face][over])
        if height[beyond] > height[face] + 1e-12:
            break
        face = beyond
    return _standing(normals[face], turn)


def _edge_beyond(corners: FloatArray, foot: FloatArray, normal: FloatArray) -> int | None:
    """The number of the corner whose opposite edge the point ``foot`` (3,) lies farthest beyond; None when inside."""
    worst, found = 1e-9, None
    for k in range(3):
        apex, a, b = corners[k], corners[(k + 1) % 3], corners[(k + 2) % 3]
        aside = np.cross(b - a, normal)
        aside = aside / max(float(np.linalg.norm(aside)), 1e-12)
        if (apex - a) @ aside > 0:
            aside = -aside
        if (foot - a) @ aside > worst:
            worst, found = float((foot - a) @ aside), k
    return found


def _standing(down: FloatArray, turn: FloatArray) -> FloatArray:
    """The rotation that brings an object's direction ``down`` (3,) to -z, turned about z at random by ``turn``."""
    aligned, _ = Rotation.align_vectors([[0.0, 0.0, -1.0]], [down])
    yaw = float(np.arctan2(turn[1, 0], turn[0, 0]))
    return np.asarray((Rotation.from_euler("z", yaw) * aligned).as_matrix())


CELL = 0.008
"""Side of the vertical columns that are sampled, metres."""

DEEP, INNER = 0.45, 0.35
"""A vessel's bottom is lower than this share of its height; it is looked for within this share of its half width."""


def mouth(scan: Scan, pose: FloatArray) -> float:
    """Width of the opening at the top of the object, posed at ``pose`` (4, 4), metres; 0 if it is closed or shallow.

    Seen from straight above: the lowest surface in sight about its middle is its bottom, and the wall rises all
    about it. A plate counts: what lies on it lies in it.
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
