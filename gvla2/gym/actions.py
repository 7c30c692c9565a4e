"""Actions: waypoints, or small changes of the joints, as numbers in the ranges usual for reinforcement learning."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

from gvla2.errors import RobotError
from gvla2.geometry.transform import FloatArray, check_rigid, rigid
from gvla2.planning.scene import Box
from gvla2.planning.trajectory import grasp_rotation

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
        numbers = np.asarray(action, dtype=np.float64)
        if numbers.shape != LOW.shape or not np.isfinite(numbers).all():
            raise RobotError(
                f"An action is {len(LOW)} finite numbers (x, y, z, roll, pitch, yaw, gripper), "
                f"got {np.array2string(numbers, precision=3, threshold=12)} of shape {numbers.shape}."
            )
        numbers = np.clip(numbers, LOW, HIGH)
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
        angles = _angles(pose[:3, :3] @ _DOWN.T) / np.pi
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
        numbers = np.asarray(action, dtype=np.float64)
        low, high = self.bounds
        if numbers.shape != low.shape or not np.isfinite(numbers).all():
            raise RobotError(
                f"An action is {len(low)} finite numbers (a change for each joint, gripper), "
                f"got {np.array2string(numbers, precision=3, threshold=12)} of shape {numbers.shape}."
            )
        numbers = np.clip(numbers, low, high)
        lead = np.clip(before + self.step * numbers[:-1] - measured, -4 * self.step, 4 * self.step)
        return measured + lead, float(numbers[-1])


def _angles(turn: FloatArray) -> FloatArray:
    """Roll, pitch, yaw (3,) in radians of a rotation (3, 3); at a pitch of 90 degrees the roll is taken to be 0."""
    cosine = float(np.hypot(turn[0, 0], turn[1, 0]))
    pitch = np.arctan2(-turn[2, 0], cosine)
    if cosine < 1e-6:
        return np.array([0.0, pitch, np.arctan2(-turn[0, 1], turn[1, 1])])
    roll = np.arctan2(turn[2, 1], turn[2, 2])
    return np.array([roll, pitch, np.arctan2(turn[1, 0], turn[0, 0])])
