"""Actions and observations as arrays: waypoints or changes of the joints; what cameras, joints and true poses show."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

from gvla2.errors import ConfigurationError, RobotError
from gvla2.geometry.transform import FloatArray, check_rigid, rigid
from gvla2.geometry.views import Views
from gvla2.planning.arm import Arm
from gvla2.planning.scene import Box
from gvla2.planning.trajectory import grasp_rotation
from gvla2.robot.driver import DriverState
from gvla2.robot.task import WorldState

LOW = np.array([-1, -1, -1, -1, -1, -1, 0], dtype=np.float32)
HIGH = np.ones(7, dtype=np.float32)

_DOWN = grasp_rotation(np.array([0.0, 0.0, -1.0]), np.array([0.0, -1.0, 0.0]))
_OUTSIDE = 1e-3  # metres that a pose may lie beyond the workspace, and is moved in


@dataclass(frozen=True)
class WaypointActions:
    """Seven numbers: x, y, z, roll, pitch, yaw in [-1, 1] and the gripper's opening in [0, 1], 1 is open.

    x, y, z span the ``workspace`` (metres, world frame). The angles are in units of pi radians, about the world's x,
    then y, then z axis, away from the hand that points straight down with its own x axis forward (its fingers close
    along world y, much as at home): for a grasp from above roll and pitch are 0, and yaw turns the fingers.
    """

    workspace: Box

    def pose(self, action: ArrayLike) -> tuple[FloatArray, float]:
        """world_from_tcp (4, 4) and the opening in [0, 1] of an action (7,); values out of range are clipped.

        Raises :class:`RobotError` for another shape, and for what is not a finite number.
        """
        numbers = _clipped(action, LOW, HIGH, "x, y, z, roll, pitch, yaw, gripper")
        low, high = self.workspace.low, self.workspace.high
        xyz = low + 0.5 * (numbers[:3] + 1.0) * (high - low)
        turn = Rotation.from_euler("xyz", np.pi * numbers[3:6]).as_matrix()
        return rigid(turn @ _DOWN, xyz), float(numbers[6])

    def action(self, world_from_tcp: FloatArray, gripper: float) -> NDArray[np.float32]:
        """The action (7,) that asks for a tool pose (4, 4) and an opening in [0, 1].

        Raises :class:`RobotError` for a pose outside the workspace, which no action can ask for.
        """
        pose = check_rigid(world_from_tcp, "world_from_tcp")
        low, high = self.workspace.low, self.workspace.high
        xyz = pose[:3, 3]
        if (xyz < low - _OUTSIDE).any() or (xyz > high + _OUTSIDE).any():
            raise RobotError(
                f"The tool's position {xyz.round(3).tolist()} is outside the workspace from "
                f"{low.round(3).tolist()} to {high.round(3).tolist()} m."
            )
        place = 2.0 * (xyz - low) / (high - low) - 1.0
        with warnings.catch_warnings(action="ignore"):  # at a pitch of 90 degrees the yaw is taken to be 0
            angles = Rotation.from_matrix(pose[:3, :3] @ _DOWN.T).as_euler("xyz") / np.pi
        return np.asarray(np.clip([*place, *angles, gripper], LOW, HIGH), dtype=np.float32)


@dataclass(frozen=True)
class JointDeltas:
    """A number per joint in [-1, 1], its change in units of ``step`` radians, and the gripper's opening in [0, 1].

    The robot keeps within its joints' limits, whatever is asked for.
    """

    dof: int
    step: float

    @property
    def bounds(self) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """The least and the largest action, (dof + 1,) each."""
        high = np.ones(self.dof + 1, dtype=np.float32)
        return np.append(-high[:-1], np.float32(0)), high

    def target(self, action: ArrayLike, before: FloatArray, measured: FloatArray) -> tuple[FloatArray, float]:
        """The joints (dof,) in radians that an action asks for, and the opening in [0, 1].

        Changes add to what was asked for ``before`` (dof,), which keeps the arm from sagging, but never lead it more
        than four steps away from where it is ``measured`` (dof,): a blocked arm does not wind up. Raises
        :class:`RobotError` for another shape, and for what is not a finite number.
        """
        numbers = _clipped(action, *self.bounds, "a change for each joint, gripper")
        lead = np.clip(before + self.step * numbers[:-1] - measured, -4 * self.step, 4 * self.step)
        return measured + lead, float(numbers[-1])


def _clipped(
    action: ArrayLike, low: NDArray[np.float32], high: NDArray[np.float32], names: str
) -> FloatArray:
    """The action (N,) within its bounds; raises :class:`RobotError` unless it is N finite numbers."""
    numbers = np.asarray(action, dtype=np.float64)
    if numbers.shape != low.shape or not np.isfinite(numbers).all():
        raise RobotError(
            f"An action is {len(low)} finite numbers ({names}), "
            f"got {np.array2string(numbers, precision=3, threshold=12)} of shape {numbers.shape}."
        )
    return np.asarray(np.clip(numbers, low, high))


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
