"""One change of the joints at a time, straight to the simulated arm's drives."""

from __future__ import annotations

from typing import Any

from numpy.typing import ArrayLike

from gvla2.errors import ConfigurationError
from gvla2.geometry.views import Observation
from gvla2.gym.actions import JointDeltas
from gvla2.robot.backend import RobotBackend, SuccessCheck, Truthful
from gvla2.robot.driver import Servo
from gvla2.robot.task import TaskInstance

RATE = 20.0
"""Actions a second."""


class JointStepper:
    """Drives the arm for a twentieth of a second per action; ``state`` is the last measurement.

    Nothing is planned or checked, and pictures are taken only when ``seen`` is asked for.
    """

    def __init__(
        self, robot: RobotBackend, actions: JointDeltas, instance: TaskInstance, seen: Observation
    ) -> None:
        if not isinstance(robot, Servo) or not isinstance(robot, Truthful):
            raise ConfigurationError(
                f"The robot {type(robot).__name__} takes no joint targets from a policy: choose control='waypoint', or "
                "a simulated arm (sapien_panda, sapien_piper, sapien_arm)."
            )
        self._robot, self._servo, self._actions, self._instance = robot, robot, actions, instance
        self._truth = robot.true_state
        self._target = seen.joints
        self._seen: Observation | None = seen
        self.state = robot.servo(seen.joints, seen.gripper, 0.0)
        self.told: dict[str, Any] = {}

    @property
    def seen(self) -> Observation:
        """What the cameras show now."""
        if self._seen is None:
            self._seen = self._robot.observe()
        return self._seen

    def step(self, action: ArrayLike) -> SuccessCheck:
        """Drive on, and look whether the goal is reached.

        Passing through a goal does not count: where it looks reached, the arm holds still until that is checked.
        Raises :class:`gvla2.errors.RobotError` when the simulation has blown up.
        """
        joints, opening = self._actions.target(action, self._target, self.state.joints)
        self.state = self._servo.servo(joints, opening, 1.0 / RATE)
        self._target, self._seen = joints, None
        truth = self._truth()
        if not any(reached(truth) for reached in self._instance.succeeded.values()):
            return SuccessCheck(False, False)
        success_check = self._robot.success_check()
        self.state = self._servo.servo(self.state.joints, opening, 0.0)
        self._target = self.state.joints
        return success_check or SuccessCheck(False, False)
