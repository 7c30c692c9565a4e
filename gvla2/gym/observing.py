"""Observations: what the robot's cameras and joints measure, or true poses, as the arrays of a Gymnasium space."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from gvla2.errors import ConfigurationError
from gvla2.geometry.transform import FloatArray
from gvla2.geometry.views import Views
from gvla2.planning.arm import Arm
from gvla2.robot.driver import DriverState
from gvla2.robot.task import WorldState

MAX_DEPTH = 10.0
"""Metres; anything further away counts as not measured."""

BEYOND = 1.0
"""How far outside the workspace the tool may be seen, metres."""

MOST_BODIES = 16
"""Rows for true poses; layouts have four to a dozen bodies, and spaces don't change from one episode to the next."""

Arrays = dict[str, NDArray[Any]]


def joint_space(arm: Arm) -> dict[str, spaces.Box]:
    """The spaces of :func:`joint_arrays`."""
    box, dof = arm.workspace, len(arm.home)
    low, high = np.full(7, -1.0), np.ones(7)
    low[:3], high[:3] = box.low - BEYOND, box.high + BEYOND
    return {
        "tcp": spaces.Box(low.astype(np.float32), high.astype(np.float32), dtype=np.float32),
        "gripper": spaces.Box(0.0, 2.0 * arm.hand.max_width, (1,), np.float32),
        "joints": spaces.Box(-2.0 * np.pi, 2.0 * np.pi, (dof,), np.float32),
    }


def joint_arrays(state: DriverState, arm: Arm) -> Arrays:
    """New arrays, by name: ``tcp`` (7,) x, y, z in metres and the quaternion x, y, z, w (x >= 0), world;
    ``gripper`` (1,) width between the fingers, metres; ``joints`` (dof,) radians.
    """
    return {
        "tcp": _pose(arm.forward(state.joints)),
        "gripper": np.array([max(0.0, state.gripper_width)], dtype=np.float32),
        "joints": np.asarray(state.joints).astype(np.float32),
    }


def picture_space(views: Views) -> dict[str, spaces.Box]:
    """The spaces of :func:`picture_arrays`.

    Raises :class:`ConfigurationError` when the cameras' images differ in size: they come as one array.
    """
    sizes = {view.image.shape[:2] for view in views}
    if len(sizes) > 1:
        named = ", ".join(f"{v.name} {v.image.shape[1]}x{v.image.shape[0]}" for v in views)
        raise ConfigurationError(
            f"The cameras see in different sizes ({named}): choose those of one size with cameras=[...]."
        )
    shape = (len(views), *sizes.pop())
    return {
        "rgb": spaces.Box(0, 255, (*shape, 3), np.uint8),
        "depth": spaces.Box(0.0, MAX_DEPTH, shape, np.float32),
    }


def picture_arrays(views: Views) -> Arrays:
    """New arrays, by name: ``rgb`` (C, H, W, 3) uint8; ``depth`` (C, H, W) float32, metres along each camera's z, 0
    where nothing was measured.
    """
    return {
        "rgb": np.stack([view.image for view in views]),
        "depth": np.stack([_depth(view.depth, view.image.shape[:2]) for view in views]),
    }


def body_space() -> dict[str, spaces.Box]:
    """The space of :func:`body_arrays`."""
    return {"bodies": spaces.Box(-np.inf, np.inf, (MOST_BODIES, 7), np.float32)}


def body_arrays(state: WorldState, names: Sequence[str]) -> Arrays:
    """``bodies`` (MOST_BODIES, 7): true poses like ``tcp``, in the layout's order, then zeros."""
    rows = np.zeros((MOST_BODIES, 7), dtype=np.float32)
    for row, name in zip(rows, names, strict=False):
        row[:] = _pose(state.pose(name))
    return {"bodies": rows}


def cameras(views: Views) -> dict[str, Arrays]:
    """By camera, in the order of the images: ``intrinsics`` (3, 3) in pixels and ``world_from_camera`` (4, 4)."""
    return {
        view.name: {
            "intrinsics": view.camera.K.copy(),
            "world_from_camera": view.camera.world_from_camera.copy(),
        }
        for view in views
    }


def _pose(world_from_frame: FloatArray) -> NDArray[np.float32]:
    turn = Rotation.from_matrix(world_from_frame[:3, :3]).as_quat()
    if (
        turn[0] < 0
    ):  # not w: it is near 0 for every hand that points down, so its sign would flip back and forth
        turn = -turn
    return np.concatenate([world_from_frame[:3, 3], np.clip(turn, -1.0, 1.0)]).astype(np.float32)


def _depth(depth: NDArray[np.float32] | None, shape: tuple[int, ...]) -> NDArray[np.float32]:
    if depth is None:
        return np.zeros(shape, dtype=np.float32)
    with np.errstate(invalid="ignore"):
        measured = (depth > 0) & (depth <= MAX_DEPTH)
    return np.where(measured, depth, 0).astype(np.float32)
