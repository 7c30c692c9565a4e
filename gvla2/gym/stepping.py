"""One action at a time on a robot: a waypoint through its executor, or a change of its joints."""

from __future__ import annotations

from typing import Any

from numpy.typing import ArrayLike

from gvla2.errors import ConfigurationError
from gvla2.geometry.transform import FloatArray
from gvla2.geometry.views import Observation
from gvla2.gym.spaces import JointDeltas, WaypointActions
from gvla2.planning.scene import Scene
from gvla2.planning.trajectory import Orientation, Trajectory, Waypoint
from gvla2.robot.backend import RobotBackend, SuccessCheck, Truthful, judge
from gvla2.robot.driver import DriverState, Servo
from gvla2.robot.report import WaypointReport
from gvla2.robot.task import TaskInstance

SAME_GRIP = 0.02
"""A command that differs less from the last one leaves the fingers as they are: a grasp keeps its grip."""

NOT_MOVED = ("unreachable", "no_path", "collision")
"""Why a motion was not started."""

REPORTED = (
    "stage",
    "target",
    "reached",
    "error",
    "gripper_width",
    "held",
    "contacts",
    "status",
    "abort",
    "message",
)


class WaypointStepper:
    """Sends waypoints one by one; ``seen`` and ``report`` are the last observation and the result of the last one.

    The executor starts each time from measurements: the last finger command is remembered here.
    """

    def __init__(
        self, robot: RobotBackend, actions: WaypointActions, seen: Observation, speed: float
    ) -> None:
        self._robot, self._actions, self._speed = robot, actions, speed
        self._scene = Scene((), float(robot.arm.workspace.low[2]), robot.arm.workspace)
        self._commanded = seen.gripper
        self.seen = seen
        self.report: WaypointReport | None = None

    @property
    def state(self) -> DriverState:
        """The robot's last measured state."""
        return DriverState(self.seen.joints, self.seen.gripper_width)

    @property
    def info(self) -> dict[str, Any]:
        """The result of the last waypoint, without its times, which differ from run to run."""
        report = self.report
        return {"waypoint": {} if report is None else {name: getattr(report, name) for name in REPORTED}}

    def step(self, action: ArrayLike) -> SuccessCheck:
        """Bring the tool to a pose, then the fingers to an opening; returns its success.

        Raises :class:`gvla2.errors.RobotError` when the simulation has blown up, and :class:`ConfigurationError` when
        the robot has no success check.
        """
        world_from_tcp, gripper = self._actions.pose(action)
        same = abs(gripper - self._commanded) <= SAME_GRIP
        opening = self.seen.gripper if same else gripper
        self.report = None
        report = self._execute(world_from_tcp, opening, straight=True)
        if report.abort in NOT_MOVED:
            report = self._execute(world_from_tcp, opening, straight=False)
        self.report = report
        if not same and not report.abort:
            self._commanded = gripper
        success_check = self._robot.success_check()
        if success_check is None:
            raise ConfigurationError("The robot has no success check: an environment takes a simulated one.")
        self.seen = self._robot.observe()
        return success_check

    def _execute(self, pose: FloatArray, opening: float, *, straight: bool) -> WaypointReport:
        x, y, z = (float(v) for v in pose[:3, 3])
        turned = Orientation("grasp", _triple(pose[:3, 2]), _triple(pose[:3, 1]))
        waypoint = Waypoint(
            (x, y, z),
            opening,
            "waypoint",
            turned,
            motion="linear" if straight else "free",
            speed=self._speed,
            # The fingers reach for thin objects; only on a straight line is it sure where they touch the table.
            allowed_contacts=frozenset({"table"} if straight else ()),
        )
        return self._robot.execute(Trajectory((waypoint,)), self._scene).waypoints[0]


def _triple(vector: FloatArray) -> tuple[float, float, float]:
    return float(vector[0]), float(vector[1]), float(vector[2])


RATE = 20.0
"""Actions a second."""


class JointStepper:
    """Drives the arm for a twentieth of a second per action; ``state`` is the last measurement.

    Nothing is planned or checked, and pictures are taken only when ``seen`` is asked for.
    """

    def __init__(
        self, robot: RobotBackend, actions: JointDeltas, instance: TaskInstance, seen: Observation
    ) -> None:
        if not isinstance(robot, Servo):
            raise ConfigurationError(
                f"The robot {type(robot).__name__} takes no joint targets from a policy: choose control='waypoint', or "
                "a simulated arm (sapien_panda, sapien_piper, sapien_arm)."
            )
        self._robot, self._servo, self._actions, self._instance = robot, robot, actions, instance
        self._target = seen.joints
        self._seen: Observation | None = seen
        self.state = robot.servo(seen.joints, seen.gripper, 0.0)
        self.info: dict[str, Any] = {}

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
        if isinstance(self._robot, Truthful):
            now = judge(self._instance, self._robot.true_state())
            if now is not None and not (now.relaxed or now.strict):
                return SuccessCheck(False, False)
        success_check = self._robot.success_check()
        self.state = self._servo.servo(self.state.joints, opening, 0.0)
        self._target = self.state.joints
        return success_check or SuccessCheck(False, False)
