"""Cameras from VGGT's pose encoding."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gvla2.errors import GeometryError


def decode_poses(encoding: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """``world_from_camera`` (S, 4, 4) and fields of view (S, 2), vertical and horizontal, radians.

    A row of the encoding (S, 9) is a camera_from_world translation (3), rotation quaternion xyzw (4, of any length
    but zero), and two fields of view; OpenCV axes, in the frame of the first camera and a scale of the network's own.
    Raises :class:`GeometryError` for another shape or numbers that are not finite.
    """
    rows = np.asarray(encoding, dtype=np.float64)
    if rows.ndim != 2 or rows.shape[1] != 9:
        raise GeometryError(f"VGGT's pose encoding must be (S, 9), got shape {rows.shape}.")
    length = np.linalg.norm(rows[:, 3:7], axis=1, keepdims=True)
    if not np.isfinite(rows).all() or (length < 1e-8).any():
        raise GeometryError(
            "VGGT's pose encoding has entries that are not finite, or a quaternion of length zero."
        )
    x, y, z, w = (rows[:, 3:7] / length).T
    rotation = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    ).transpose(2, 0, 1)  # camera from world
    poses = np.tile(np.eye(4), (len(rows), 1, 1))
    poses[:, :3, :3] = rotation.transpose(0, 2, 1)
    poses[:, :3, 3] = -np.einsum("sji,sj->si", rotation, rows[:, :3])
    return poses, rows[:, 7:]
