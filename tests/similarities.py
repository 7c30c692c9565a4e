"""Similarities (4, 4) for tests: a rotation times a scale, and a shift."""

import numpy as np

from gvla2.geometry.transform import FloatArray, rigid, transform_points


def similarity(scale: float, rotation: FloatArray, shift: FloatArray) -> FloatArray:
    """x -> scale * rotation @ x + shift."""
    return rigid(scale * rotation, shift)


def scale_of(by: FloatArray) -> float:
    """Target units a source unit."""
    return float(np.cbrt(np.linalg.det(by[:3, :3])))


def moved_poses(by: FloatArray, world_from_camera: np.ndarray) -> np.ndarray:
    """Camera poses (..., 4, 4) in the target's frame: centres are scaled, rotations stay rigid."""
    poses = np.array(world_from_camera, dtype=np.float64)
    poses[..., :3, 3] = transform_points(by, poses[..., :3, 3])
    poses[..., :3, :3] = by[:3, :3] / scale_of(by) @ poses[..., :3, :3]
    return poses
