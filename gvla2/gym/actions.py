"""Actions as arrays, one at a time on a robot: changes of its joints, or the joints themselves."""

from __future__ import annotations

import numpy as np
from gymnasium import spaces
from numpy.typing import ArrayLike

from gvla2.errors import ConfigurationError, RobotError
from gvla2.geometry.transform import FloatArray
from gvla2.geometry.views import Observation
from gvla2.robot.backend import RobotBackend, SuccessCheck
from gvla2.robot.driver import DriverState, Servo

RATE = 20.0
"""Joint changes a second."""
TURN = 2.0 * np.pi
"""Bound of a joint's target, radians; the arm's own limits are narrower."""


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
                f"The robot {type(robot).__name__} takes no joint targets from a policy: choose a simulated arm "
                "(sapien_panda, sapien_piper, sapien_arm)."
            )
        dof = len(robot.arm.home)
        self._robot, self._servo, self._step = robot, robot, joint_step
        self.space = spaces.Box(np.array([-1.0] * dof + [0.0], np.float32), np.ones(dof + 1, np.float32))
        self.command: FloatArray
        self.state: DriverState
        self._seen: Observation | None

    def begin(self, seen: Observation) -> None:
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
