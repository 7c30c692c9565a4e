"""Actions as arrays, one at a time on a robot: a waypoint through its executor, or a change of its joints."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

from gvla2.errors import ConfigurationError, RobotError
from gvla2.geometry.transform import FloatArray, check_rigid, rigid
from gvla2.geometry.views import Observation
from gvla2.planning.scene import Scene
from gvla2.planning.trajectory import Orientation, Trajectory, Waypoint, grasp_rotation
from gvla2.robot.backend import RobotBackend, SuccessCheck
from gvla2.robot.driver import DriverState, Servo
from gvla2.robot.report import WaypointReport
from gvla2.robot.task import TaskInstance

RATE = 20.0
"""Joint changes a second."""
TURN = 2.0 * np.pi
"""Bound of a joint's target, radians; the arm's own limits are narrower."""
SAME_GRIP = 0.02
"""A command that differs less from the last one leaves the fingers as they are: a grasp keeps its grip."""
NOT_MOVED = ("unreachable", "no_path", "collision")
"""Why a motion was not started."""
LEFT_OUT = ("index", "planning_seconds", "motion_seconds", "force")
"""What ``info`` leaves out of a waypoint's report: times differ from run to run."""
_DOWN = grasp_rotation(np.array([0.0, 0.0, -1.0]), np.array([0.0, -1.0, 0.0]))
_OUTSIDE = 1e-3  # metres that a pose may lie beyond the workspace, and is moved in


class WaypointActions:
    """Seven numbers: x, y, z, roll, pitch, yaw in [-1, 1] and the gripper's opening in [0, 1], 1 is open.

    x, y, z span the robot's workspace (metres, world frame). The angles are in units of pi radians, about the world's
    x, then y, then z axis, away from the hand that points straight down with its own x axis forward (its fingers close
    along world y, much as at home): for a grasp from above roll and pitch are 0, and yaw turns the fingers.

    ``speed`` is the tool's, m/s. ``seen`` is the last observation, ``info`` the result of the last waypoint.
    """

    period = 1.0
    """Seconds that an action counts as in recordings."""
    command: FloatArray | None = None
    """Where the last action drives the joints and the fingers' width; None, since a waypoint says neither."""

    def __init__(self, robot: RobotBackend, speed: float) -> None:
        self._robot, self._speed, self._box = robot, speed, robot.arm.workspace
        self.space = spaces.Box(np.array([-1.0] * 6 + [0.0], np.float32), np.ones(7, np.float32))
        self.seen: Observation
        self.info: dict[str, Any] = {}
        self._commanded = 1.0

    def begin(self, instance: TaskInstance, seen: Observation) -> None:
        """Start an episode; the executor starts from measurements, so the last finger command is kept here."""
        self.seen, self._commanded, self.info = seen, seen.gripper, {"waypoint": {}}

    @property
    def state(self) -> DriverState:
        """The robot's last measured state."""
        return DriverState(self.seen.joints, self.seen.gripper_width)

    def pose(self, action: ArrayLike) -> tuple[FloatArray, float]:
        """world_from_tcp (4, 4) and the opening in [0, 1] of an action (7,); values out of range are clipped.

        Raises :class:`RobotError` for another shape, and for numbers that are not finite.
        """
        numbers = _clipped(action, self.space, "x, y, z, roll, pitch, yaw, gripper")
        xyz = self._box.low + 0.5 * (numbers[:3] + 1.0) * (self._box.high - self._box.low)
        turn = Rotation.from_euler("xyz", np.pi * numbers[3:6]).as_matrix()
        return rigid(turn @ _DOWN, xyz), float(numbers[6])

    def action(self, world_from_tcp: FloatArray, gripper: float) -> NDArray[np.float32]:
        """The action (7,) for a tool pose (4, 4) and an opening in [0, 1].

        Raises :class:`RobotError` for a pose outside the workspace, which no action can express.
        """
        pose = check_rigid(world_from_tcp, "world_from_tcp")
        low, high, xyz = self._box.low, self._box.high, pose[:3, 3]
        if ((xyz < low - _OUTSIDE) | (xyz > high + _OUTSIDE)).any():
            raise RobotError(
                f"The tool's position {xyz.round(3).tolist()} is outside the workspace from "
                f"{low.round(3).tolist()} to {high.round(3).tolist()} m."
            )
        place = 2.0 * (xyz - low) / (high - low) - 1.0
        with warnings.catch_warnings(action="ignore"):  # at a pitch of 90 degrees the yaw is taken to be 0
            angles = Rotation.from_matrix(pose[:3, :3] @ _DOWN.T).as_euler("xyz") / np.pi
        numbers = np.clip([*place, *angles, gripper], self.space.low, self.space.high)
        return np.asarray(numbers, dtype=np.float32)

    def step(self, action: ArrayLike) -> SuccessCheck:
        """Bring the tool to a pose, then the fingers to an opening, and look; returns the success.

        Raises :class:`RobotError` when the simulation has blown up, :class:`ConfigurationError` for a robot without a
        success check.
        """
        world_from_tcp, gripper = self.pose(action)
        same = abs(gripper - self._commanded) <= SAME_GRIP
        opening = self.seen.gripper if same else gripper
        self.info = {"waypoint": {}}
        report = self._execute(world_from_tcp, opening, straight=True)
        if report.abort in NOT_MOVED:
            report = self._execute(world_from_tcp, opening, straight=False)
        self.info["waypoint"] = {name: one for name, one in vars(report).items() if name not in LEFT_OUT}
        if not same and not report.abort:
            self._commanded = gripper
        success_check = self._robot.success_check()
        if success_check is None:
            raise ConfigurationError("The robot has no success check: an environment takes a simulated one.")
        self.seen = self._robot.observe()
        return success_check

    def _execute(self, pose: FloatArray, opening: float, *, straight: bool) -> WaypointReport:
        xyz, approach, closing = (tuple(map(float, pose[:3, k])) for k in (3, 2, 1))
        waypoint = Waypoint(
            (xyz[0], xyz[1], xyz[2]),
            opening,
            "waypoint",
            Orientation(
                "grasp", (approach[0], approach[1], approach[2]), (closing[0], closing[1], closing[2])
            ),
            motion="linear" if straight else "free",
            speed=self._speed,
            # The fingers reach for thin objects; only on a straight line is it sure where they touch the table.
            allowed_contacts=frozenset({"table"} if straight else ()),
        )
        empty = Scene((), float(self._box.low[2]), self._box)
        return self._robot.execute(Trajectory((waypoint,)), empty).waypoints[0]


class JointActions:
    """A number per joint in [-1, 1], its change in units of ``joint_step`` radians, and the opening in [0, 1].

    The arm is driven for a twentieth of a second per action, within its joints' limits. Nothing is planned or checked;
    pictures are taken only when ``seen`` is read. ``state`` is the last measurement.
    """

    period = 1.0 / RATE
    """Seconds of an action."""

    def __init__(self, robot: RobotBackend, joint_step: float) -> None:
        if not isinstance(robot, Servo):
            raise ConfigurationError(
                f"The robot {type(robot).__name__} takes no joint targets from a policy: choose control='waypoint', or "
                "a simulated arm (sapien_panda, sapien_piper, sapien_arm)."
            )
        dof = len(robot.arm.home)
        self._robot, self._servo, self._step = robot, robot, joint_step
        self.space = spaces.Box(np.array([-1.0] * dof + [0.0], np.float32), np.ones(dof + 1, np.float32))
        self.info: dict[str, Any] = {}
        self.command: FloatArray
        self.state: DriverState
        self._seen: Observation | None

    def begin(self, instance: TaskInstance, seen: Observation) -> None:
        """Start an episode where the robot stands."""
        self._seen, self._target = seen, seen.joints
        self.command = np.append(seen.joints, seen.gripper_width)
        self.state = self._servo.servo(seen.joints, seen.gripper, 0.0)

    @property
    def seen(self) -> Observation:
        """What the cameras show now."""
        if self._seen is None:
            self._seen = self._robot.observe()
        return self._seen

    def step(self, action: ArrayLike) -> SuccessCheck:
        """Drive on, and check whether the goal is reached.

        Changes add to the last target, which keeps the arm from sagging, but never lead it more than four steps away
        from where it is measured: a blocked arm does not wind up. Passing through a goal does not count: where it looks
        reached, the arm holds still until that is checked. Raises :class:`RobotError` for an action of another shape or
        with numbers that are not finite, and when the simulation has blown up.
        """
        joints, opening = self._goal(action)
        self.command = np.append(joints, opening * self._robot.arm.hand.max_width)
        self.state = self._servo.servo(joints, opening, self.period)
        self._target, self._seen = joints, None
        if not self._servo.reached():
            return SuccessCheck(False, False)
        success_check = self._robot.success_check()
        self.state = self._servo.servo(self.state.joints, opening, 0.0)
        self._target = self.state.joints
        return success_check or SuccessCheck(False, False)

    def _goal(self, action: ArrayLike) -> tuple[FloatArray, float]:
        """Joints (dof,) and opening in [0, 1] that an action means."""
        numbers = _clipped(action, self.space, "a change for each joint, gripper")
        measured, most = self.state.joints, 4 * self._step
        joints = measured + np.clip(self._target + self._step * numbers[:-1] - measured, -most, most)
        return joints, float(numbers[-1])


class JointPositions(JointActions):
    """The joints themselves, radians, and the width between the fingers, metres, as exported data sets have them.

    Where the hand holds something, a smaller width squeezes it. All else is as for changes of the joints.
    """

    def __init__(self, robot: RobotBackend) -> None:
        super().__init__(robot, 0.0)
        self._most = robot.arm.hand.max_width
        low, high = (
            np.full(len(robot.arm.home) + 1, -TURN, np.float32),
            np.full(len(robot.arm.home) + 1, TURN, np.float32),
        )
        low[-1], high[-1] = 0.0, self._most
        self.space = spaces.Box(low, high)

    def _goal(self, action: ArrayLike) -> tuple[FloatArray, float]:
        numbers = _clipped(action, self.space, "the joints, the width between the fingers")
        return numbers[:-1], float(numbers[-1] / self._most)


def _clipped(action: ArrayLike, space: spaces.Box, names: str) -> FloatArray:
    """The action (N,) within its bounds; raises :class:`RobotError` unless it is N finite numbers."""
    numbers = np.asarray(action, dtype=np.float64)
    if numbers.shape != space.shape or not np.isfinite(numbers).all():
        raise RobotError(
            f"An action is {space.shape[0]} finite numbers ({names}), "
            f"got {np.array2string(numbers, precision=3, threshold=12)} of shape {numbers.shape}."
        )
    return np.clip(numbers, space.low, space.high)
