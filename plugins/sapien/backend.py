"""The robot backend: an arm at a table, simulated."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache, partial

import numpy as np
from numpy.typing import NDArray

from gvla2.errors import ConfigurationError, RobotError, SimulationError
from gvla2.geometry.camera import Camera
from gvla2.geometry.transform import FloatArray, rigid
from gvla2.geometry.views import Observation, View, Views
from gvla2.planning.scene import Scene
from gvla2.planning.trajectory import Trajectory, grasp_rotation
from gvla2.robot.arm_model import ArmModel
from gvla2.robot.backend import ExecutionListener, Moment, SuccessCheck, judge
from gvla2.robot.driver import DriverState
from gvla2.robot.executor import execute
from gvla2.robot.looks import body_surface
from gvla2.robot.motion import MotionPlanner
from gvla2.robot.report import ExecutionReport
from gvla2.robot.task import Layout, Task, TaskInstance, TaskSite
from gvla2.robot.workcell import TABLE_RGB, make_cell
from gvla2_plugins.sapien import SapienArmConfig
from gvla2_plugins.sapien.bodies import PREFIX, import_sapien
from gvla2_plugins.sapien.cameras import CameraRig, Filming
from gvla2_plugins.sapien.driver import SapienDriver
from gvla2_plugins.sapien.truth import TrueState, cast_masks, true_scene
from gvla2_plugins.sapien.world import SapienWorld

SHOWN_SIZE = 640
"""Side in pixels of pictures for people; perception gets those of ``image_size``."""

POSITIVE = (
    *("image_size", "video_size", "video_fps", "physics_rate"),
    *("arm_stiffness", "arm_damping", "arm_force", "grip_force", "grip_speed"),
)
"""Options that must lie above zero."""

_SILENT = ExecutionListener()

JUDGE_SECONDS = 0.25
"""The arm holds still this long before success is checked, so that slipping objects have slipped."""


class SapienArm:
    """Implements :class:`gvla2.robot.backend.RobotBackend`.

    The same seed and calls give the same episode, bit by bit. Only :meth:`success_check`, :meth:`true_state` and
    :meth:`true_scene` read the true state of the task's bodies; the cameras see the bodies by ray casting.
    """

    def __init__(self, config: SapienArmConfig) -> None:
        import_sapien()
        self._config, self._cell = config, make_cell(config)
        self._cell.mounts.check(config.cameras)
        bad = [f"{name}={getattr(config, name)}" for name in POSITIVE if not getattr(config, name) > 0]
        if bad:
            raise ConfigurationError(f"robot={self._cell.robot} needs values above 0 for {', '.join(bad)}.")
        self._arm = self._cell.arm
        self._planner = MotionPlanner(self._arm)
        self._robot = self._cell.looks
        self._world: SapienWorld | None = None
        self._rig: CameraRig | None = None
        self._layout = Layout(())
        self._lights: tuple[bool, ...] = ()
        self._instance: TaskInstance | None = None

    @property
    def arm(self) -> ArmModel:
        """Kinematics and collision model of the arm."""
        return self._arm

    def reset(
        self, task: Task | str | None, seed: int, instruction: str | None = None
    ) -> TaskInstance | None:
        """A new world with the arm at home and the task's episode for the seed; without a task an empty table."""
        self.close()
        instance = None
        if isinstance(task, str):
            raise ConfigurationError(f"robot={self._cell.robot} has no task of its own, like '{task}'.")
        if task is not None:
            instance = task.sample(np.random.default_rng(seed), self._site(), instruction)
        layout = Layout(()) if instance is None else instance.layout
        self._world = SapienWorld(self._config, self._cell, layout)
        self._layout, self._instance = layout, instance
        self._make_rig()
        return instance

    def observe(self) -> Observation:
        """RGB-D views of all cameras and the measured hand."""
        world = self._sane_world("observed")
        joints, width = world.joints, world.gripper_width
        world_from_tcp = self._arm.forward(joints)
        wanted = 0 if self._instance is None else self._instance.image_size
        size = max(self._config.image_size, wanted)
        cameras = [self._cell.mounts.camera(name, size, world_from_tcp) for name in self._config.cameras]
        opening = float(np.clip(width / self._arm.hand.max_width, 0.0, 1.0))
        return Observation(
            Views(tuple(self._sight()(cameras))),
            world_from_tcp,
            joints,
            opening,
            width,
            self._finer(world_from_tcp, size),
        )

    def _finer(self, world_from_tcp: FloatArray, size: int) -> Callable[[str], View] | None:
        """A function that takes a camera's picture of this moment with more pixels; None if there are enough."""
        if size >= SHOWN_SIZE:
            return None
        camera, sight = self._cell.mounts.camera, self._sight()
        return cache(lambda name: sight([camera(name, SHOWN_SIZE, world_from_tcp)])[0])

    def execute(
        self, trajectory: Trajectory, scene: Scene, listener: ExecutionListener = _SILENT
    ) -> ExecutionReport:
        """Move through the waypoints, planning around the perceived scene; stops at the first that fails."""
        world = self._sane_world("moved")

        def film() -> None:
            name, size = self._config.cameras[0], self._config.video_size
            view = self._cell.mounts.camera(name, size, self._arm.forward(world.joints))
            reel.shoot(
                Moment(world.time, world.joints.copy(), world.gripper_width), partial(self._sight(), [view])
            )

        driver = SapienDriver(
            world, self._config, self._arm.hand.max_width, None if listener is _SILENT else film
        )
        with Filming(listener) as reel:
            return execute(trajectory, scene, self._planner, driver, listener)

    def success_check(self) -> SuccessCheck | None:
        """Whether the episode's goal is reached once the arm has held still for a moment; None without a task."""
        if self._instance is None:
            return None
        world = self._sane_world("judged")
        driver = SapienDriver(world, self._config, self._arm.hand.max_width)
        driver.hold(JUDGE_SECONDS)
        state = TrueState(self._sane_world("judged"))
        return judge(self._instance, state)

    def servo(self, joints: FloatArray, opening: float, seconds: float) -> DriverState:
        """Drive the arm by joint targets; see :class:`gvla2.robot.driver.Servo`."""
        world, target = self._sane_world("moved"), np.asarray(joints, dtype=np.float64)
        if (
            target.shape != (self._arm.dof,)
            or not np.isfinite([*target, opening, seconds]).all()
            or seconds < 0
        ):
            raise RobotError(
                f"{self._cell.robot} is driven to finite joints ({self._arm.dof},) for 0 seconds or more, got shape "
                f"{target.shape}, an opening of {opening} and {seconds} s."
            )
        driver = SapienDriver(world, self._config, self._arm.hand.max_width)
        driver.servo(np.clip(target, *self._arm.limits), opening, seconds)
        self._sane_world("moved")
        return driver.state()

    def true_state(self) -> TrueState:
        """The state for success checks."""
        return TrueState(self._sane_world("read"))

    def true_scene(self) -> Scene:
        """The episode's bodies as scene objects, for the ``oracle`` perceiver."""
        return true_scene(
            self._sane_world("read"), self._layout, self._cell.table_height, self._arm.workspace
        )

    def true_masks(self, observation: Observation) -> tuple[tuple[str, ...], list[NDArray[np.int32]]]:
        """The object in each pixel of the observation's cameras, by :func:`cast_masks`; for measuring perceivers."""
        world = self._sane_world("read")
        cameras = [view.camera for view in observation.views]
        links = world.link_poses(self._robot.links)
        arm = self._robot.cast(cameras, links)
        bodies = {body.name: body for body in self._layout.bodies}
        poses = {name: world.body_pose(name) for name in bodies}
        return cast_masks(cameras, arm, bodies, poses, self._cell.table)

    def close(self) -> None:
        """Release the world; the arm's model stays, and :meth:`reset` makes a new world."""
        self._world, self._rig, self._instance = None, None, None

    def _make_rig(self) -> CameraRig:
        """A camera rig for the bodies' present looks: a lamp may have been switched on."""
        peaks = self._sane_world("seen").peaks
        self._lights = self._layout.lights(peaks)
        table = self._cell.table
        objects = {table.name: table, **{f"{PREFIX}{body.name}": body for body in self._layout.lit(peaks)}}
        self._rig = CameraRig(self._robot, {name: body_surface(b) for name, b in objects.items()})
        return self._rig

    def _sight(self) -> Callable[[Sequence[Camera]], list[View]]:
        """Draws what cameras see at this moment, when it is called, from any thread."""
        world, rig = self._sane_world("seen"), self._rig
        if rig is None or self._lights != self._layout.lights(world.peaks):
            rig = self._make_rig()
        links, objects = world.link_poses(self._robot.links), self._object_poses(world)
        return partial(rig.look, world_from_link=links, world_from_object=objects)

    def _object_poses(self, world: SapienWorld) -> dict[str, FloatArray]:
        """world_from_object (4, 4) of everything that the cameras see besides the robot, now."""
        poses = {f"{PREFIX}{body.name}": world.body_pose(body.name) for body in self._layout.bodies}
        return {**poses, self._cell.table.name: self._cell.table.world_from_body}

    def _site(self) -> TaskSite:
        cell = self._cell
        return TaskSite(
            cell.site_centre,
            cell.site_size,
            cell.table_height,
            self._reachable,
            TABLE_RGB,
            self._follows,
            self._arm.hand.max_width,
        )

    def _reachable(self, point: FloatArray) -> bool:
        """Whether the hand gets to a world point (3,), pointing down, whichever way it is turned."""
        if np.linalg.norm((point - self._cell.world_from_base[:3, 3])[:2]) > self._cell.reach:
            return False
        down, ways = np.array([0.0, 0.0, -1.0]), (1.0, -1.0) if self._cell.either_way else (1.0,)
        turns = (np.array([0.0, 1.0, 0.0]), np.array([1.0, 0.0, 0.0]))
        return all(
            any(self._easy(rigid(grasp_rotation(down, way * y), point)) for way in ways) for y in turns
        )

    def _easy(self, pose: FloatArray) -> bool:
        solution = self._arm.inverse(pose)
        return solution is not None and solution.manipulability >= self._cell.ease

    def _follows(self, poses: Sequence[FloatArray]) -> bool:
        """Whether the arm goes straight through tool poses (4, 4), from some posture, without touching itself."""
        if not all(self._easy(pose) for pose in (poses[0], poses[-1])):
            return False
        empty = Scene((), self._cell.table_height, self._arm.workspace)
        for start in self._arm.ik.solutions(poses[0], self._arm.home, 4):
            joints, lines = start.joints, []
            for pose in poses[1:]:
                line = self._arm.line(joints, pose, 0.03)
                if line is None:
                    break
                lines += list(line)
                joints = line[-1]
            else:
                checker = self._arm.checker(empty, 1.0)
                if all(checker.free(each) for each in (start.joints, *lines)):
                    return True
        return False

    def _sane_world(self, done: str) -> SapienWorld:
        if self._world is None:
            raise RobotError(f"Nothing can be {done} before reset: call reset(task, seed) first.")
        if not self._world.sane():
            raise SimulationError(
                f"The simulation has blown up and cannot be {done}; reset starts a clean one. "
                "Slower motions or a smaller robot.grip_force avoid it."
            )
        return self._world
