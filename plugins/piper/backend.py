"""The robot backend: a Piper, armed, dry-run or without any arm, with any chosen camera."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from gvla2.errors import ConfigurationError, RobotError
from gvla2.geometry.camera import Camera as Pinhole
from gvla2.geometry.transform import FloatArray, invert_rigid
from gvla2.geometry.views import View
from gvla2.planning.scene import Scene
from gvla2.planning.trajectory import Trajectory, Waypoint
from gvla2.robot.arm_from_urdf import RobotModel
from gvla2.robot.backend import DepthCamera, ExecutionListener, Moment
from gvla2.robot.driven import SILENT, DrivenRobot
from gvla2.robot.driver import Driver, DriverState
from gvla2.robot.executor import ExecutorOptions, execute
from gvla2.robot.report import ExecutionReport, WaypointReport
from gvla2.robot.task import Task, TaskInstance
from gvla2_plugins.piper import PiperConfig
from gvla2_plugins.piper.arm import HOME, MAX_WIDTH, PERIOD, Bounds, make_arm
from gvla2_plugins.piper.driver import DryDriver, PathGuard, PiperDriver, measured
from gvla2_plugins.piper.session import Session, ask_person

EXPLAINED = 0.025
"""A depth this near (m) to the modelled arm's, or behind it, is the arm: the solids are a little too large."""

SIMULATED = ("virtual", "udp_multicast")
"""Buses without a real arm, for tests."""


class Piper(DrivenRobot):
    """A real Piper.

    :meth:`reset` connects and, when ``armed``, asks for the word, switches the motors on and holds the arm; it never
    moves it: nothing has been seen yet. A dry run only listens. ``ask`` gets the arming question.
    """

    own_depth = EXPLAINED

    def __init__(
        self, config: PiperConfig, camera: DepthCamera, ask: Callable[[str], str] = ask_person
    ) -> None:
        Bounds(config.speed, config.grip_effort)
        lengths = {len(config.workspace_low), len(config.workspace_high), len(config.base_position)}
        if lengths != {3} or not np.less(config.workspace_low, config.workspace_high).all():
            raise ConfigurationError(
                "robot.workspace_low, workspace_high and base_position are three numbers each, low below high."
            )
        if config.bus == "none" and config.armed:
            raise ConfigurationError("robot.armed=true needs an arm: choose a robot.bus other than none.")
        if config.armed and config.bus not in SIMULATED and not camera.live:
            raise ConfigurationError(
                f"robot.armed=true on the bus '{config.bus}' moves a real arm, and the chosen camera shows recorded or "
                f"synthetic pictures. Choose a live camera, or robot.armed=false."
            )
        self._config, self._camera, self._ask = config, camera, ask
        self._made = make_arm(config)
        self._arm = self._made.arm
        self._guard = PathGuard(self._arm, config.table_height + config.table_margin)
        self.options = ExecutorOptions(
            dt=PERIOD,
            velocity_scale=0.8 * config.speed,
            acceleration=config.acceleration,
            max_motion_seconds=120.0,
        )
        self.session: Session | None = None

    @property
    def model(self) -> RobotModel:
        """The Piper at its place."""
        return self._made

    def reset(
        self, task: Task | str | None, seed: int, instruction: str | None = None
    ) -> TaskInstance | None:
        """Connect, at the first call; nothing moves, nothing is laid out. Always None.

        Raises :class:`RobotError` when the arm is not usable, was stopped, or there is nothing to do.
        """
        if instruction is None and task is not None:
            raise ConfigurationError(
                "A real robot lays out no task: put objects on the table and say what to do, "
                "instruction='lift the red cube'."
            )
        if self.session is None and self._config.bus != "none":
            self.session = Session(self._config, self._ask)
        if self.session is not None and self.session.loop is not None and self.session.loop.stopped:
            raise RobotError(
                f"The arm is held since {self.session.loop.stopped}. Inspect it, then start again."
            )
        return None

    def look(self, state: DriverState) -> Sequence[View]:
        """The cameras' views."""
        world_from_base = self._made.world_from_base
        frames = self._camera.observe(invert_rigid(world_from_base) @ self._arm.forward(state.joints))
        return [_moved(view, world_from_base) for view in frames.views] or [_DARKNESS]

    def execute(
        self, trajectory: Trajectory, scene: Scene, listener: ExecutionListener = SILENT
    ) -> ExecutionReport:
        """Move through the waypoints under supervision; in a dry run plan and check them, and send nothing.

        Raises :class:`SafetyStopError` when the watch stops the arm. A waypoint outside the workspace is refused
        before anything moves.
        """
        session = self.session
        if session is not None and session.loop is not None:
            session.loop.check()
        top = self._config.tool_speed
        slow = Trajectory(tuple(replace(w, speed=min(w.speed, top)) for w in trajectory))
        for index, waypoint in enumerate(slow):
            if np.isfinite(waypoint.xyz).all() and not self._arm.workspace.contains(np.array(waypoint.xyz)):
                why = "Its target lies outside robot.workspace_low .. workspace_high. Nothing was sent."
                refusal = self._not_started(index, waypoint, why)
                listener.waypoint(refusal)
                return ExecutionReport((refusal,))
        if session is None or session.loop is None:
            return self._dry(slow, scene, listener)

        def note() -> None:
            state = driver.state()
            listener.moment(Moment(time.monotonic(), state.joints, state.gripper_width))

        driver = self.driver("moved", note)
        return execute(slow, scene, self._arm, driver, listener, self.options)

    def close(self) -> None:
        """Hold the arm, leave it powered, and release bus and camera; safe to call twice."""
        if self.session is not None:
            self.session.close()
            self.session = None
        self._camera.close()

    def driver(self, done: str, watcher: Callable[[], None] = lambda: None) -> Driver:
        """The armed arm's, which calls the ``watcher`` on the way; else a dry run's from where the arm is."""
        session, state = self.session, DriverState(np.array(HOME), MAX_WIDTH)
        if session is not None and session.loop is not None:
            return PiperDriver(session.link, session.loop, self._guard, watcher)
        if session is not None:
            state = measured(session.link)
        elif self._config.bus != "none":
            raise RobotError(f"Nothing can be {done} before reset: call reset(task, seed) first.")
        return DryDriver(state, self._guard)

    def _not_started(self, index: int, waypoint: Waypoint, message: str) -> WaypointReport:
        """The report of a waypoint to which nothing moved."""
        state = self.driver("moved").state()
        x, y, z = self._arm.forward(state.joints)[:3, 3].tolist()
        error, width = math.dist((x, y, z), waypoint.xyz), state.gripper_width
        report = WaypointReport(index, waypoint.stage, waypoint.xyz, (x, y, z), error, width, None)
        return replace(report, abort="not_started", message=message)

    def _dry(self, trajectory: Trajectory, scene: Scene, listener: ExecutionListener) -> ExecutionReport:
        """The whole execution as a dry run: one report that nothing was started."""
        planned = execute(trajectory, scene, self._arm, self.driver("planned"), SILENT, self.options)
        if failed := planned.abort:
            word = f"waypoint {failed.index} ('{failed.stage}') would fail: {failed.message}"
        else:
            seconds = sum(w.motion_seconds for w in planned.waypoints)
            ways = ", ".join(w.status for w in planned.waypoints)
            word = f"all {len(trajectory)} waypoints can be reached ({ways}) in {seconds:.1f} s"
        message = f"Dry run: {word}. Nothing was sent; robot.armed=true moves the arm."
        planning = sum(w.planning_seconds for w in planned.waypoints)
        report = self._not_started(0, trajectory.waypoints[0], message)
        report = replace(report, planning_seconds=planning)
        listener.waypoint(report)
        return ExecutionReport((report,), planning, planned.joint_path)


def _moved(view: View, world_from_base: FloatArray) -> View:
    """The view, its camera's pose in the world instead of the base."""
    pose = world_from_base @ view.camera.world_from_camera
    return replace(view, camera=replace(view.camera, world_from_camera=pose))


_DARKNESS = View(
    Pinhole.from_fov(0.7, np.eye(4), 16, 16, "none"),
    np.zeros((16, 16, 3), np.uint8),
    np.full((16, 16), np.nan, np.float32),
)
"""The view of a robot without cameras: a picture without depth; perception reports that it sees nothing."""
