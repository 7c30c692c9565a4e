"""The robot backend of a MuJoCo world: any arm of two fingers, the model's cameras, the world's own success check."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cache

import numpy as np
from numpy.typing import NDArray

from gvla2.errors import ConfigurationError, RobotError, SimulationError, did_you_mean
from gvla2.geometry.views import Observation, View, Viewpoint, Views
from gvla2.planning.scene import Scene
from gvla2.planning.trajectory import Trajectory
from gvla2.robot.arm_from_urdf import ArmModel, UrdfArm, arm_from_urdf
from gvla2.robot.backend import ExecutionListener, Moment, SuccessCheck
from gvla2.robot.executor import ExecutorOptions, execute
from gvla2.robot.mujoco.description import write_urdf
from gvla2.robot.mujoco.objects import true_scene
from gvla2.robot.mujoco.options import MujocoConfig
from gvla2.robot.mujoco.world import ModelEyes, World, WorldDriver
from gvla2.robot.options import ArmConfig
from gvla2.robot.report import ExecutionReport
from gvla2.robot.task import Task, TaskInstance, WorldState

JUDGE_STEPS = 100
"""Steps, within those that the world allows, that the arm holds still before a task counts as failed: what was let go
must come to rest, and LIBERO's objects fall slowly."""
PAUSE, PAUSES = 2, 20
"""Steps between two depth maps that are compared, and how often they are at most."""
MOVED, FEW = 0.001, 0.001
"""Metres of depth by which a pixel shows motion, and the share of pixels that may."""

_SILENT = ExecutionListener()


class MujocoArm:
    """Implements :class:`gvla2.robot.backend.RobotBackend`, and offers tasks: each one's sentence by its name, none for
    a world without tasks. ``load`` makes the world of a task, of "" where there are none.

    The model of a task is loaded once: its next seed only sets the state. The same task, seed and calls give the same
    episode. The true state is read by the world's success check and :meth:`true_scene` only.
    """

    def __init__(self, config: MujocoConfig, tasks: Mapping[str, str], load: Callable[[str], World]) -> None:
        self._config, self._tasks, self._world_of = config, tasks, load
        self._task: Task | str | None = None
        self._world: World | None = None
        self._made: UrdfArm | None = None
        self._driver: WorldDriver | None = None
        self._eyes: ModelEyes | None = None

    def tasks(self) -> Mapping[str, str]:
        """Each task's sentence by its name."""
        return self._tasks

    @property
    def arm(self) -> ArmModel:
        """Kinematics and collision model of the present world's arm; before the first reset, of the first task's."""
        if self._made is None:
            self._load(next(iter(self.tasks()), None))
        assert self._made is not None
        return self._made.arm

    def reset(self, task: Task | str | None, seed: int, instruction: str | None = None) -> TaskInstance:
        """The task's world in the initial state ``seed``, the arm at home."""
        if self._world is None or task != self._task:
            self._load(task)
        world, made = self._world, self._made
        assert world is not None
        assert made is not None
        world.begin(seed)
        self._driver = WorldDriver(world, made.gap, made.arm.hand.max_width)
        return TaskInstance(instruction or world.instruction, goal=world.goal)

    def _load(self, task: Task | str | None) -> None:
        self.close()
        there, asked = self.tasks(), task if isinstance(task, str) else ""
        if asked not in there if there else task is not None:
            raise ConfigurationError(
                f"robot={self._config.name} has a world and tasks of its own, but none called '{asked or 'none'}'."
                f"{did_you_mean(asked, there)} `gvla2 tasks robot={self._config.name}` lists them."
            )
        world = self._world_of(asked)
        world.begin(0)  # an environment's first reset differs from all later ones in the fourth digit
        base = world.data.body(world.names.base)
        home = [float(world.data.joint(name).qpos[0]) for name in world.names.joints]
        self._made = arm_from_urdf(
            ArmConfig(
                name=self._config.name,
                urdf=str(write_urdf(world.model, world.names, self._config.joint_speed)),
                tool_link=world.names.tool,
                gripper_joints=list(world.names.fingers),
                home=home,
                base_position=base.xpos.tolist(),
                base_yaw=float(np.arctan2(base.xmat[3], base.xmat[0])),
                table_height=world.table_height,
                workspace_low=world.workspace.low.tolist(),
                workspace_high=world.workspace.high.tolist(),
            )
        )
        self._eyes = ModelEyes(world.model, world.data, self._config.cameras, world.groups)
        self._world, self._task = world, task

    def observe(self) -> Observation:
        """RGB-D views of the cameras, the robot's own pixels cast from its model, and the measured hand.

        The first look waits until the cameras see nothing move: initial states may have objects that still fall.
        """
        driver, eyes, made = self._ready("observed")
        size = self._config.image_size
        if driver.world.steps == 0:
            self._wait_until_still(driver, eyes)
        looks = [eyes.view(name, size) for name in eyes.cameras]
        joints, width = driver.joints, driver.width
        views = made.mask(looks, joints, width)
        opening = float(np.clip(width / made.arm.hand.max_width, 0.0, 1.0))
        viewpoint: Viewpoint = "facing" if self._config.viewpoint == "facing" else "robot"
        return Observation(
            Views(views),
            made.arm.forward(joints),
            joints,
            opening,
            width,
            self._finer(eyes) if self._config.picture_size > size else None,
            viewpoint,
        )

    def _wait_until_still(self, driver: WorldDriver, eyes: ModelEyes) -> None:
        """Hold the arm until no camera sees a change of depth."""
        size = self._config.image_size
        now = [eyes.depth(name, size) for name in eyes.cameras]
        for _ in range(PAUSES):
            before = now
            driver.hold(PAUSE)
            now = [eyes.depth(name, size) for name in eyes.cameras]
            if not any(_differ(one, other) for one, other in zip(before, now, strict=True)):
                break

    def _finer(self, eyes: ModelEyes) -> Callable[[str], View]:
        """A function that takes a camera's picture of this moment with more pixels, for as long as nothing moves."""
        size = self._config.picture_size
        return cache(lambda name: View(eyes.camera(name, size), eyes.picture(name, size)))

    def execute(
        self, trajectory: Trajectory, scene: Scene, listener: ExecutionListener = _SILENT
    ) -> ExecutionReport:
        """Move through the waypoints, planning around the perceived scene; stops at the first that fails."""
        driver, eyes, made = self._ready("moved")
        config, shot = self._config, -np.inf

        def film() -> None:
            nonlocal shot
            if driver.time - shot < 1.0 / config.video_fps - 1e-9 or not driver.sane():
                return
            shot = driver.time
            draw = eyes.draw_later(eyes.cameras[0], config.video_size)
            listener.moment(Moment(driver.time, driver.joints, driver.width, draw))
            if listener.wants_frames:
                listener.frame(draw())

        driver.film = (lambda: None) if listener is _SILENT or not config.video_fps else film
        options = ExecutorOptions(velocity_scale=0.9, acceleration=config.acceleration)
        faster = Trajectory(tuple(replace(w, speed=config.pace * w.speed) for w in trajectory))
        return execute(faster, scene, made.arm, driver, listener, options)

    def success_check(self) -> SuccessCheck | None:
        """Whether the world's own check was met at any step, within its steps; None without a check."""
        driver, _, _ = self._ready("judged")
        world, until, driver.film = driver.world, driver.world.steps + JUDGE_STEPS, lambda: None
        moved = world.steps > 0
        while moved and world.succeeded() is False and world.steps < until and not driver.expired():
            driver.hold(1)
        done = world.succeeded()
        return None if done is None else SuccessCheck(done, done)

    def seconds_left(self) -> float:
        """Simulated seconds that the world still allows, infinite without a limit."""
        world = self._ready("timed")[0].world
        return (world.max_steps - world.steps) / world.rate if world.max_steps > 0 else np.inf

    def true_state(self) -> WorldState:
        """Raises :class:`ConfigurationError`: there is no scripted demonstration that would read it."""
        raise ConfigurationError(f"The tasks of robot={self._config.name} have no demonstrations.")

    def true_scene(self) -> Scene:
        """The world's bodies as scene objects, for the ``oracle`` perceiver: diagnosis only."""
        driver, _, _ = self._ready("read")
        return true_scene(driver.world)

    def close(self) -> None:
        """Release the world and its framebuffer; the arm's model stays."""
        if self._eyes is not None:
            self._eyes.close()
        self._world, self._task, self._driver, self._eyes = None, None, None, None

    def _ready(self, done: str) -> tuple[WorldDriver, ModelEyes, UrdfArm]:
        if self._driver is None or self._eyes is None or self._made is None:
            raise RobotError(f"Nothing can be {done} before reset: call reset(task, seed) first.")
        if not self._driver.sane():
            raise SimulationError(
                f"The simulation has blown up and cannot be {done}: this episode is not measured. reset starts anew."
            )
        return self._driver, self._eyes, self._made


def _differ(one: NDArray[np.float32], other: NDArray[np.float32]) -> bool:
    """Whether something moved between two depth maps (H, W) of a camera, metres."""
    return bool((np.abs(one - other) > MOVED).mean() > FEW)
