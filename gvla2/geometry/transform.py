"""Rigid motions as 4x4 matrices."""

from __future__ import annotations

from itertools import product

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gvla2.errors import GeometryError

FloatArray = NDArray[np.float64]

_UNIT_CORNERS = np.array(list(product((-0.5, 0.5), repeat=3)))


def rigid(rotation: ArrayLike | None = None, translation: ArrayLike = (0.0, 0.0, 0.0)) -> FloatArray:
    """(4, 4) motion of a rotation (3, 3), identity by default, and a translation (3,) in metres."""
    matrix = np.eye(4)
    if rotation is not None:
        matrix[:3, :3] = np.asarray(rotation, dtype=np.float64)
    matrix[:3, 3] = np.asarray(translation, dtype=np.float64)
    return matrix


def invert_rigid(matrix: FloatArray) -> FloatArray:
    """Inverse of a rigid (4, 4) motion."""
    rotation = matrix[:3, :3]
    return rigid(rotation.T, -rotation.T @ matrix[:3, 3])


def transform_points(matrix: FloatArray, points: ArrayLike) -> FloatArray:
    """Apply an affine (4, 4) matrix to points (..., 3)."""
    return np.asarray(points, dtype=np.float64) @ matrix[:3, :3].T + matrix[:3, 3]


def box_corners(size: ArrayLike) -> FloatArray:
    """(8, 3) corners of a box of full side lengths ``size`` (3,) about the origin."""
    return np.asarray(_UNIT_CORNERS * np.asarray(size))


def check_rigid(matrix: ArrayLike, what: str = "pose", tolerance: float = 1e-4) -> FloatArray:
    """The matrix as float64 (4, 4) after checking it; a (3, 4) matrix is completed.

    Raises :class:`GeometryError` for a wrong shape, non-finite entries, a mirror (determinant -1), or a
    rotation that is not orthonormal within ``tolerance``.
    """
    array = np.asarray(matrix, dtype=np.float64)
    if array.shape == (3, 4):
        array = np.vstack([array, [0.0, 0.0, 0.0, 1.0]])
    if array.shape != (4, 4):
        raise GeometryError(f"{what} must be a 4x4 (or 3x4) matrix, got shape {array.shape}.")
    if not np.isfinite(array).all():
        raise GeometryError(f"{what} has entries that are not finite.")
    rotation = array[:3, :3]
    if np.abs(rotation @ rotation.T - np.eye(3)).max() > tolerance:
        raise GeometryError(f"{what}: the rotation is not orthonormal; a scale or shear is in it.")
    x, y, z = rotation.tolist()
    if (
        x[0] * (y[1] * z[2] - y[2] * z[1])
        + x[1] * (y[2] * z[0] - y[0] * z[2])
        + x[2] * (y[0] * z[1] - y[1] * z[0])
        < 0
    ):
        raise GeometryError(
            f"{what} is mirrored (determinant -1): one axis is flipped. An OpenGL camera becomes an OpenCV "
            "one by diag(1, -1, -1), which has determinant +1."
        )
    return array


def look_along(position: ArrayLike, forward: ArrayLike, up: ArrayLike = (0.0, 0.0, 1.0)) -> FloatArray:
    """world_from_camera (4, 4) of an OpenCV camera at ``position`` that looks along ``forward`` (3,).

    ``up`` (3,) ends up pointing to the top of the image; when it is parallel to ``forward``, world x serves.
    """
    z = np.asarray(forward, dtype=np.float64)
    z = z / np.linalg.norm(z)
    x = np.cross(z, np.asarray(up, dtype=np.float64))
    if np.linalg.norm(x) < 1e-6:
        x = np.cross(z, [1.0, 0.0, 0.0])
    x = x / np.linalg.norm(x)
    return rigid(np.stack([x, np.cross(z, x), z], axis=1), position)
