"""The robot backend: a Piper, armed, dry-run or without any arm, with any chosen camera."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from gvla2.errors import ConfigurationError, RobotError
from gvla2.geometry.camera import Camera as Pinhole
from gvla2.geometry.transform import FloatArray, invert_rigid
from gvla2.geometry.views import Observation, View, Views
from gvla2.planning.scene import Scene
from gvla2.planning.trajectory import Trajectory, Waypoint
from gvla2.robot.arm_from_urdf import ArmModel
from gvla2.robot.backend import DepthCamera, ExecutionListener, Moment, SuccessCheck
from gvla2.robot.driver import DriverState
from gvla2.robot.executor import ExecutorOptions, execute
from gvla2.robot.report import ExecutionReport, WaypointReport
from gvla2.robot.task import Task, TaskInstance
from gvla2_plugins.piper import PiperConfig
from gvla2_plugins.piper.arm import HOME, MAX_WIDTH, PERIOD, Bounds, make_arm
from gvla2_plugins.piper.driver import DryDriver, PathGuard, PiperDriver, measured
from gvla2_plugins.piper.session import Session, ask_person

EXPLAINED = 0.025
"""A depth this near (m) to the modelled arm's, or behind it, is the arm: the solids are a little too large."""

_SILENT = ExecutionListener()
SIMULATED = ("virtual", "udp_multicast")
"""Buses without a real arm, for tests."""


class Piper:
    """Implements :class:`gvla2.robot.backend.RobotBackend`.

    :meth:`reset` connects and, when ``armed``, asks for the word, switches the motors on and holds the arm; it never
    moves it: nothing has been seen yet. A dry run only listens. ``ask`` gets the arming question.
    """

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
        self._options = ExecutorOptions(
            dt=PERIOD,
            velocity_scale=0.8 * config.speed,
            acceleration=config.acceleration,
            max_motion_seconds=120.0,
        )
        self.session: Session | None = None

    @property
    def arm(self) -> ArmModel:
        """Kinematics and collision model of the Piper."""
        return self._arm

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

    def observe(self) -> Observation:
        """The cameras' views and the measured hand."""
        state, world_from_base = self._state(), self._made.world_from_base
        world_from_tcp = self._arm.forward(state.joints)
        frames = self._camera.observe(invert_rigid(world_from_base) @ world_from_tcp)
        views = [_moved(view, world_from_base) for view in frames.views] or [_DARKNESS]
        masked = self._made.mask(views, state.joints, state.gripper_width, EXPLAINED)
        opening = float(np.clip(state.gripper_width / MAX_WIDTH, 0.0, 1.0))
        return Observation(Views(masked), world_from_tcp, state.joints, opening, state.gripper_width)

    def execute(
        self, trajectory: Trajectory, scene: Scene, listener: ExecutionListener = _SILENT
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

        driver = PiperDriver(session.link, session.loop, self._guard, note)
        return execute(slow, scene, self._arm, driver, listener, self._options)

    def success_check(self) -> SuccessCheck | None:
        """None: a real robot has none."""
        return None

    def close(self) -> None:
        """Hold the arm, leave it powered, and release bus and camera; safe to call twice."""
        if self.session is not None:
            self.session.close()
            self.session = None
        self._camera.close()

    def _state(self) -> DriverState:
        if self.session is None:
            if self._config.bus != "none":
                raise RobotError("Nothing can be observed before reset: call reset(task, seed) first.")
            return DriverState(np.array(HOME), MAX_WIDTH)
        return measured(self.session.link)

    def _not_started(self, index: int, waypoint: Waypoint, message: str) -> WaypointReport:
        """The report of a waypoint to which nothing moved."""
        state = self._state()
        x, y, z = self._arm.forward(state.joints)[:3, 3].tolist()
        error, width = math.dist((x, y, z), waypoint.xyz), state.gripper_width
        report = WaypointReport(index, waypoint.stage, waypoint.xyz, (x, y, z), error, width, None)
        return replace(report, abort="not_started", message=message)

    def _dry(self, trajectory: Trajectory, scene: Scene, listener: ExecutionListener) -> ExecutionReport:
        """The whole execution as a dry run: one report that nothing was started."""
        driver = DryDriver(self._state(), self._guard)
        planned = execute(trajectory, scene, self._arm, driver, ExecutionListener(), self._options)
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
