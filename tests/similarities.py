"""What tests ask of a similarity besides what the house needs of it."""

import numpy as np

from gvla2.reconstruction.sim3 import Sim3


def inverse(of: Sim3) -> Sim3:
    """From the target's frame back to the source's."""
    return Sim3(1.0 / of.scale, of.rotation.T, -(of.rotation.T @ of.translation) / of.scale)


def moved_poses(by: Sim3, world_from_camera: np.ndarray) -> np.ndarray:
    """Camera poses (..., 4, 4) in the target's frame: centres are scaled, rotations stay rigid."""
    poses = np.array(world_from_camera, dtype=np.float64)
    poses[..., :3, 3] = by.apply(poses[..., :3, 3])
    poses[..., :3, :3] = by.rotation @ poses[..., :3, :3]
    return poses


def matrix(of: Sim3) -> np.ndarray:
    """(4, 4) for homogeneous points."""
    result = np.eye(4)
    result[:3, :3] = of.scale * of.rotation
    result[:3, 3] = of.translation
    return result
