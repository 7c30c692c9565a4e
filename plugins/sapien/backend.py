"""The robot backend: an arm at a table, simulated."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from functools import cache, partial

import numpy as np
from numpy.typing import NDArray

from gvla2.component import Range, check_ranges
from gvla2.errors import ConfigurationError, RobotError, SimulationError
from gvla2.geometry.camera import Camera
from gvla2.geometry.raycast import RayCaster, RayImage
from gvla2.geometry.transform import FloatArray, rigid
from gvla2.geometry.views import View
from gvla2.planning.scene import Scene
from gvla2.planning.trajectory import Trajectory, grasp_rotation
from gvla2.robot.backend import ExecutionListener, Moment, SuccessCheck, judge
from gvla2.robot.driven import SILENT, DrivenRobot
from gvla2.robot.driver import DriverState
from gvla2.robot.executor import execute
from gvla2.robot.looks import OWN_DEPTH, RobotLooks, body_surface
from gvla2.robot.report import ExecutionReport
from gvla2.robot.task import Layout, Task, TaskInstance, TaskSite, WorldState
from gvla2.robot.workcell import TABLE_RGB, Workcell, make_cell
from gvla2_plugins.sapien import SapienArmConfig
from gvla2_plugins.sapien.bodies import import_sapien
from gvla2_plugins.sapien.driver import SapienDriver
from gvla2_plugins.sapien.truth import true_scene
from gvla2_plugins.sapien.world import SapienWorld

SHOWN_SIZE = 640
"""Side in pixels of pictures for people; perception gets those of ``image_size``."""

RANGES: Mapping[str, Range] = {
    **dict.fromkeys(("image_size", "video_size"), (1, 8192, "pixels")),
    **dict.fromkeys(
        ("arm_stiffness", "arm_damping", "arm_force", "grip_force", "grip_speed"), (1e-3, 1e6, "")
    ),
    "physics_rate": (1, 100_000, "Hz"),
    "video_fps": (0, 1000, ""),
}

JUDGE_SECONDS = 0.25
"""The arm holds still this long before success is checked, so that slipping objects have slipped."""


def look(
    robot: RobotLooks,
    objects: RayCaster,
    world_from_link: Mapping[str, FloatArray],
    world_from_object: Mapping[int, FloatArray],
    cameras: Sequence[Camera],
) -> list[View]:
    """One view per camera: the robot's links by their model, everything else at its true pose (4, 4).

    The two are cast separately and merged by depth: this gives the robot's own depth image, explained by its measured
    joints, for free.
    """
    images = robot.cast(cameras, world_from_link), objects.cast(cameras, world_from_object)
    return [_merge(*three) for three in zip(cameras, *images, strict=True)]


def _merge(camera: Camera, robot: RayImage, objects: RayImage) -> View:
    nearer = np.isfinite(robot.depth) & ~(objects.depth < robot.depth)
    depth = np.where(nearer, robot.depth, objects.depth)
    with np.errstate(invalid="ignore"):
        mask = np.abs(depth - robot.depth) <= OWN_DEPTH
    return View(camera, np.where(nearer[..., None], robot.image, objects.image), depth, robot_mask=mask)


class Filming:
    """Draws frames in another thread while the robot moves; the listener gets them in order, in the caller's thread."""

    def __init__(self, listener: ExecutionListener) -> None:
        self._listener = listener
        self._studio = ThreadPoolExecutor(1, "film")
        self._awaited: deque[Future[NDArray[np.uint8]]] = deque()

    def shoot(self, moment: Moment) -> None:
        """Report the moment, and have its frame drawn if frames are wanted; those that are ready go to the listener."""
        self._listener.moment(moment)
        if not self._listener.wants_frames or moment.draw is None:
            return
        self._awaited.append(self._studio.submit(moment.draw))
        while self._awaited and self._awaited[0].done():
            self._deliver()

    def __enter__(self) -> Filming:
        return self

    def __exit__(self, *_: object) -> None:
        with self._studio:
            while self._awaited:
                self._deliver()

    def _deliver(self) -> None:
        self._listener.frame(self._awaited.popleft().result())


class SapienArm(DrivenRobot):
    """An arm at a table, of any URDF.

    The same seed and calls give the same episode, bit by bit. Only :meth:`success_check`, :meth:`true_state` and
    :meth:`true_scene` read the true state of the task's bodies; the cameras see the bodies by ray casting.
    """

    def __init__(self, config: SapienArmConfig) -> None:
        import_sapien()
        self._config, self._cell = config, make_cell(config)
        self._cell.check_cameras(config.cameras)
        self._cell.check_cameras(config.video_cameras or config.cameras[:1])
        check_ranges(config, "robot", RANGES)
        self._arm = self._cell.arm
        self._robot = self._cell.looks
        self._world: SapienWorld | None = None
        self._objects: RayCaster | None = None
        self._layout = Layout(())
        self._lights: tuple[bool, ...] = ()
        self._instance: TaskInstance | None = None

    @property
    def model(self) -> Workcell:
        """The arm at its table."""
        return self._cell

    def driver(self, done: str, film: Callable[[], None] | None = None) -> SapienDriver:
        """What advances the world, and takes pictures by ``film``."""
        return SapienDriver(self._sane_world(done), self._config, self._arm.hand.max_width, film)

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
        return instance

    @property
    def _image_size(self) -> int:
        """Side of the pictures, pixels: at least what the task needs."""
        return max(self._config.image_size, self._instance.image_size if self._instance else 0)

    def look(self, state: DriverState) -> Sequence[View]:
        """The views by ray casting, the robot's pixels marked."""
        pose = self._arm.forward(state.joints)
        return self._sight()(
            [self._cell.camera(name, self._image_size, pose) for name in self._config.cameras]
        )

    def finer(self, state: DriverState) -> Callable[[str], View] | None:
        """A function that takes a camera's picture of this moment with more pixels; None if there are enough."""
        if self._image_size >= SHOWN_SIZE:
            return None
        pose, camera, sight = self._arm.forward(state.joints), self._cell.camera, self._sight()
        return cache(lambda name: sight([camera(name, SHOWN_SIZE, pose)])[0])

    def execute(
        self, trajectory: Trajectory, scene: Scene, listener: ExecutionListener = SILENT
    ) -> ExecutionReport:
        """Move through the waypoints, planning around the perceived scene; stops at the first that fails."""
        world = self._sane_world("moved")

        def film() -> None:
            size, tool = -(-self._config.video_size // 2) * 2, self._arm.forward(world.joints)
            filming = self._config.video_cameras or self._config.cameras[:1]
            cameras, sight = [self._cell.camera(name, size, tool) for name in filming], self._sight()

            def draw() -> NDArray[np.uint8]:
                return np.hstack([view.image for view in sight(cameras)])

            command = np.append(world.arm_target, 2.0 * world.finger_target)
            reel.shoot(Moment(world.time, world.joints.copy(), world.gripper_width, draw, command))

        driver = self.driver("moved", None if listener is SILENT else film)
        with Filming(listener) as reel:
            return execute(trajectory, scene, self._arm, driver, listener)

    def success_check(self) -> SuccessCheck | None:
        """Whether the episode's goal is reached once the arm has held still for a moment; None without a task."""
        if self._instance is None:
            return None
        self.driver("judged").hold(JUDGE_SECONDS)
        return judge(self._instance, self._sane_world("judged"))

    def servo(self, joints: FloatArray, opening: float, seconds: float) -> DriverState:
        """Drive the arm by joint targets; see :class:`gvla2.robot.driver.Servo`."""
        driver = self.driver("moved")
        driver.servo(self.joint_target(joints, opening, seconds), opening, seconds)
        self._sane_world("moved")
        return driver.state()

    def reached(self) -> bool:
        """Whether the goal looks reached at this moment."""
        now = None if self._instance is None else judge(self._instance, self._sane_world("judged"))
        return now is not None and (now.relaxed or now.strict)

    def true_state(self) -> WorldState:
        """The state for success checks."""
        return self._sane_world("read")

    def true_scene(self) -> Scene:
        """The episode's bodies as scene objects, for the ``oracle`` perceiver."""
        return true_scene(
            self._sane_world("read"), self._layout, self._cell.table_height, self._arm.workspace
        )

    def close(self) -> None:
        """Release the world; the arm's model stays, and :meth:`reset` makes a new world."""
        self._world, self._objects, self._instance = None, None, None

    def _sight(self) -> Callable[[Sequence[Camera]], list[View]]:
        """Draws what cameras see at this moment, when it is called, from any thread."""
        world = self._sane_world("seen")
        lights = self._layout.lights(world.peaks)
        if self._objects is None or self._lights != lights:  # a lamp may have been switched on
            self._lights, bodies = lights, (self._cell.table, *self._layout.lit(world.peaks))
            self._objects = RayCaster([body_surface(body) for body in bodies])
        poses = [self._cell.table.world_from_body, *(world.pose(b.name) for b in self._layout.bodies)]
        links = world.link_poses(self._robot.links)
        return partial(look, self._robot, self._objects, links, dict(enumerate(poses)))

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
        down, ways = np.array([0.0, 0.0, -1.0]), (1.0, -1.0) if self._config.either_way else (1.0,)
        turns = (np.array([0.0, 1.0, 0.0]), np.array([1.0, 0.0, 0.0]))
        return all(
            any(self._easy(rigid(grasp_rotation(down, way * y), point)) for way in ways) for y in turns
        )

    def _easy(self, pose: FloatArray) -> bool:
        solution = self._arm.inverse(pose)
        return solution is not None and solution.manipulability >= self._config.ease

    def _follows(self, poses: Sequence[FloatArray]) -> bool:
        """Whether the arm goes straight through tool poses (4, 4), from some posture, without touching itself."""
        if not all(self._easy(pose) for pose in (poses[0], poses[-1])):
            return False
        empty = Scene((), self._cell.table_height, self._arm.workspace)
        for start in self._arm.ik.solutions(poses[0], self._arm.home, 4):
            path: list[FloatArray] | None = [start.joints]
            for pose in poses[1:]:
                line = path and self._arm.line(path[-1], pose, 0.03)
                path = [*path, *line] if path and line else None
            if path and self._arm.checker(empty, 1.0).first_blocked(np.array(path)) is None:
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
