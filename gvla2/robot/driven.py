"""A robot backend around an arm's model and its driver: what simulated and real arms have in common."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence

import numpy as np

from gvla2.errors import RobotError
from gvla2.geometry.transform import FloatArray
from gvla2.geometry.views import Observation, View, Viewpoint, Views
from gvla2.planning.scene import Scene
from gvla2.planning.trajectory import Trajectory
from gvla2.robot.arm_from_urdf import ArmModel, RobotModel
from gvla2.robot.backend import ExecutionListener, SuccessCheck
from gvla2.robot.driver import Driver, DriverState
from gvla2.robot.executor import ExecutorOptions, execute
from gvla2.robot.looks import OWN_DEPTH
from gvla2.robot.report import ExecutionReport

SILENT = ExecutionListener()
"""Nobody listens: nothing is drawn."""


class DrivenRobot(ABC):
    """Implements :class:`gvla2.robot.backend.RobotBackend` but for ``reset``.

    A derived robot has a ``model``, a ``driver`` and cameras, which ``look``. ``options`` are the executor's; depth up
    to ``own_depth`` metres before the model, or behind it, is the robot's own; ``viewpoint`` is the speaker's.
    """

    options = ExecutorOptions()
    own_depth = OWN_DEPTH
    viewpoint: Viewpoint = "robot"

    @property
    @abstractmethod
    def model(self) -> RobotModel:
        """The arm with its hand, before and after ``reset``."""

    @abstractmethod
    def driver(self, done: str) -> Driver:
        """What moves and measures the arm in this episode.

        Raises :class:`gvla2.errors.RobotError` where nothing can be ``done`` ("observed", "moved"), as before
        ``reset``.
        """

    @abstractmethod
    def look(self, state: DriverState) -> Sequence[View]:
        """RGB-D views of all cameras, in the world; the robot's pixels are marked in those that leave it open."""

    def finer(self, state: DriverState) -> Callable[[str], View] | None:
        """What takes the same moment's picture by the camera of a name with more pixels; None without."""
        return None

    @property
    def arm(self) -> ArmModel:
        """Kinematics and collision model."""
        return self.model.arm

    def observe(self) -> Observation:
        """RGB-D views of all cameras and the measured hand."""
        state = self.driver("observed").state()
        joints, width = state.joints, state.gripper_width
        views = self.look(state)
        if any(view.robot_mask is None for view in views):
            views = self.model.mask(views, joints, width, self.own_depth)
        opening, finer = float(np.clip(width / self.arm.hand.max_width, 0.0, 1.0)), self.finer(state)
        pose = self.arm.forward(joints)
        return Observation(Views(tuple(views)), pose, joints, opening, width, finer, self.viewpoint)

    def execute(
        self, trajectory: Trajectory, scene: Scene, listener: ExecutionListener = SILENT
    ) -> ExecutionReport:
        """Move through the waypoints, planning around the perceived scene; stops at the first that fails."""
        return execute(trajectory, scene, self.arm, self.driver("moved"), listener, self.options)

    def joint_target(self, joints: FloatArray, opening: float, seconds: float) -> FloatArray:
        """Joints (dof,), radians, brought within the arm's limits: the target of a :class:`gvla2.robot.driver.Servo`.

        Raises :class:`gvla2.errors.RobotError` for another shape, numbers that are not finite, or negative seconds.
        """
        target = np.asarray(joints, dtype=np.float64)
        if (
            target.shape != (self.arm.dof,)
            or not np.isfinite([*target, opening, seconds]).all()
            or seconds < 0
        ):
            raise RobotError(
                f"{self.model.robot} is driven to finite joints ({self.arm.dof},) for 0 seconds or more, got shape "
                f"{target.shape}, an opening of {opening} and {seconds} s."
            )
        return np.clip(target, *self.arm.limits)

    def success_check(self) -> SuccessCheck | None:
        """None: unknown."""
        return None

    def close(self) -> None:  # noqa: B027 - not every robot has something
        """Nothing to release."""
