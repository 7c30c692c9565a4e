"""Observations: what the robot's cameras and joints measure, as the arrays of a Gymnasium space."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from gvla2.errors import ConfigurationError
from gvla2.geometry.views import Observation
from gvla2.planning.arm import Arm

MAX_DEPTH = 10.0
"""Metres; what is further away counts as not measured."""

BEYOND = 1.0
"""How far outside the workspace the tool may be seen, metres."""

Arrays = dict[str, NDArray[Any]]


def observation_space(seen: Observation, arm: Arm) -> spaces.Dict:
    """The space of what ``seen`` is a sample of.

    Raises :class:`ConfigurationError` when the cameras' images differ in size: they come as one array.
    """
    sizes = {view.image.shape[:2] for view in seen.views}
    if len(sizes) > 1:
        named = ", ".join(f"{v.name} {v.image.shape[1]}x{v.image.shape[0]}" for v in seen.views)
        raise ConfigurationError(
            f"The cameras see in different sizes ({named}): choose those of one size with cameras=[...]."
        )
    shape = (len(seen.views), *sizes.pop())
    box, dof = arm.workspace, len(arm.home)
    low, high = np.full(7, -1.0), np.ones(7)
    low[:3], high[:3] = box.low - BEYOND, box.high + BEYOND
    return spaces.Dict(
        {
            "rgb": spaces.Box(0, 255, (*shape, 3), np.uint8),
            "depth": spaces.Box(0.0, MAX_DEPTH, shape, np.float32),
            "tcp": spaces.Box(low.astype(np.float32), high.astype(np.float32), dtype=np.float32),
            "gripper": spaces.Box(0.0, 2.0 * arm.hand.max_width, (1,), np.float32),
            "joints": spaces.Box(-2.0 * np.pi, 2.0 * np.pi, (dof,), np.float32),
        }
    )


def arrays(seen: Observation) -> Arrays:
    """New arrays, by name: ``rgb`` (C, H, W, 3) uint8; ``depth`` (C, H, W) float32, metres along each camera's z, 0
    where nothing was measured; ``tcp`` (7,) x, y, z in metres and the quaternion x, y, z, w (x >= 0), world;
    ``gripper`` (1,) width between the fingers, metres; ``joints`` (dof,) radians.
    """
    turn = Rotation.from_matrix(seen.world_from_tcp[:3, :3]).as_quat()
    if turn[0] < 0:  # not w: it is near 0 for every hand that points down, so that its sign would flip about
        turn = -turn
    return {
        "rgb": np.stack([view.image for view in seen.views]),
        "depth": np.stack([_depth(view.depth, view.image.shape[:2]) for view in seen.views]),
        "tcp": np.concatenate([seen.world_from_tcp[:3, 3], np.clip(turn, -1.0, 1.0)]).astype(np.float32),
        "gripper": np.array([max(0.0, seen.gripper_width)], dtype=np.float32),
        "joints": np.asarray(seen.joints).astype(np.float32),
    }


def cameras(seen: Observation) -> dict[str, Arrays]:
    """By camera, in the order of the images: ``intrinsics`` (3, 3) in pixels and ``world_from_camera`` (4, 4)."""
    return {
        view.name: {
            "intrinsics": view.camera.K.copy(),
            "world_from_camera": view.camera.world_from_camera.copy(),
        }
        for view in seen.views
    }


def _depth(depth: NDArray[np.float32] | None, shape: tuple[int, ...]) -> NDArray[np.float32]:
    if depth is None:
        return np.zeros(shape, dtype=np.float32)
    with np.errstate(invalid="ignore"):
        measured = (depth > 0) & (depth <= MAX_DEPTH)
    return np.where(measured, depth, 0).astype(np.float32)
