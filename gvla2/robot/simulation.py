"""A simulator that somebody else built, as a robot backend: it steps, measures and looks, and the rest is here."""

from __future__ import annotations

import itertools
import math
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gvla2.errors import ConfigurationError, RobotError, SimulationError, did_you_mean
from gvla2.geometry.transform import FloatArray
from gvla2.geometry.views import Observation, View
from gvla2.planning.scene import Scene
from gvla2.planning.trajectory import Trajectory
from gvla2.robot.arm_from_urdf import RobotModel
from gvla2.robot.backend import ExecutionListener, Moment, SuccessCheck
from gvla2.robot.driven import SILENT, DrivenRobot
from gvla2.robot.driver import DriverState, GripResult, MoveResult, StopRule
from gvla2.robot.executor import ExecutorOptions
from gvla2.robot.options import SimulationConfig
from gvla2.robot.report import ExecutionReport
from gvla2.robot.task import Task, TaskInstance

JUDGE_STEPS = 100
"""Steps, within those that the world allows, that the arm holds still before a task counts as failed: what was let go
must come to rest, and LIBERO's objects fall slowly."""

PAUSE, PAUSES = 2, 20
"""Steps between two depth maps that are compared, and how often they are at most."""

MOVED, FEW = 0.001, 0.001
"""Metres of depth by which a pixel shows motion, and the share of pixels that may."""


class Simulation(ABC):
    """A world with an arm in it, somebody's simulator; metres, radians, seconds, world frame.

    ``robot`` is the arm's model, by :func:`gvla2.robot.arm_from_urdf.arm_from_urdf` or
    :func:`gvla2.robot.mujoco.arm.arm_from_mjcf`. ``rate`` is in steps a second; ``steps`` counts those of the present
    episode, which ends after ``max_steps`` (0: never). The arm follows its targets ``lag`` seconds late, and the hand's
    target moves over its whole range in ``hand_steps``. ``goal`` is the criterion in words, for the run's page.
    """

    robot: RobotModel
    rate: float
    instruction: str = ""
    goal: str = ""
    steps: int = 0
    max_steps: int = 0
    lag: float = 0.0
    hand_steps: int = 1

    @abstractmethod
    def begin(self, seed: int) -> None:
        """The initial state of that number, objects at rest, the arm where it starts."""

    @abstractmethod
    def step(self, joints: FloatArray, opening: float) -> None:
        """One step towards joints (dof,) and an opening in [0, 1] of the hand."""

    @abstractmethod
    def measure(self) -> tuple[FloatArray, FloatArray, float]:
        """The arm's joints (dof,), their speeds (dof,) and the width between the fingers."""

    @abstractmethod
    def look(self) -> Sequence[View]:
        """RGB-D views of all cameras."""

    def succeeded(self) -> bool | None:
        """Whether the task's goal is reached now; None where the world cannot know."""
        return None

    def sane(self) -> bool:
        """Whether the physics went well so far."""
        return bool(np.isfinite(self.measure()[0]).all())

    def depths(self) -> Sequence[NDArray[np.float32]]:
        """The cameras' depth maps (H, W), where they are to be had for less than whole views."""
        return [view.depth for view in self.look() if view.depth is not None]

    def finer(self) -> Callable[[str], View] | None:
        """What takes a picture with more pixels by the camera of a name; None without."""
        return None

    def draw_later(self) -> Callable[[], NDArray[np.uint8]]:
        """A function that draws a frame of the film as the world is now, until the next ``begin``."""
        image = self.look()[0].image
        return lambda: image

    def true_scene(self) -> Scene:
        """The world's bodies as scene objects, for the ``oracle`` perceiver: diagnosis only."""
        raise ConfigurationError(
            "This simulator doesn't say where its objects are: choose another perceiver."
        )

    def close(self) -> None:  # noqa: B027 - not every simulator has something
        """Release what the simulator holds."""


class SimulatedRobot(DrivenRobot):
    """A robot backend of simulations. ``tasks`` are sentences by the tasks' names, none for a world without tasks;
    ``load`` makes the simulation of a task, of "" where there are none.

    A task is loaded once: its next seed only sets the state. The same task, seed and calls give the same episode, if
    the simulator does.
    """

    def __init__(
        self, config: SimulationConfig, tasks: Mapping[str, str], load: Callable[[str], Simulation]
    ) -> None:
        self._config, self._tasks, self._load = config, tasks, load
        self.options = ExecutorOptions(velocity_scale=0.9, acceleration=config.acceleration)
        self.viewpoint = "facing" if config.viewpoint == "facing" else "robot"
        self._task: Task | str | None = None
        self._world: Simulation | None = None
        self._model: RobotModel | None = None
        self._driver: StepDriver | None = None

    def tasks(self) -> Mapping[str, str]:
        """Each task's sentence by its name."""
        return self._tasks

    @property
    def model(self) -> RobotModel:
        """The present world's arm; before the first reset, the first task's."""
        return self._model or self._open(next(iter(self._tasks), None)).robot

    def reset(self, task: Task | str | None, seed: int, instruction: str | None = None) -> TaskInstance:
        """The task's world in the initial state ``seed``, the arm at home."""
        world = self._world
        if world is None or task != self._task:
            world = self._open(task)
        world.begin(seed)
        world.steps = 0
        self._driver = StepDriver(world)
        return TaskInstance(instruction or world.instruction, goal=world.goal)

    def _open(self, task: Task | str | None) -> Simulation:
        self.close()
        there, asked = self._tasks, task if isinstance(task, str) else ""
        if asked not in there if there else task is not None:
            raise ConfigurationError(
                f"robot={self._config.name} has a world and tasks of its own, but none called '{asked or 'none'}'."
                f"{did_you_mean(asked, there)} `gvla2 tasks robot={self._config.name}` lists them."
            )
        world = self._world = self._load(asked)
        world.begin(0)  # an environment's first reset differs from all later ones in the fourth digit
        self._task, self._model = task, world.robot
        return world

    def driver(self, done: str) -> StepDriver:
        """What steps the world; raises :class:`SimulationError` when its physics has blown up."""
        if self._driver is None:
            raise RobotError(f"Nothing can be {done} before reset: call reset(task, seed) first.")
        if not self._driver.world.sane():
            raise SimulationError(
                f"The simulation has blown up and cannot be {done}: this episode is not measured. reset starts anew."
            )
        return self._driver

    def observe(self) -> Observation:
        """RGB-D views of all cameras and the measured hand.

        The first look waits until the cameras see nothing move: initial states may have objects that still fall.
        """
        driver = self.driver("observed")
        now = driver.world.depths() if driver.world.steps == 0 else ()
        for _ in range(PAUSES if now else 0):
            before = now
            driver.hold(PAUSE)
            now = driver.world.depths()
            if not any(_differ(one, other) for one, other in zip(before, now, strict=True)):
                break
        return super().observe()

    def look(self, state: DriverState) -> Sequence[View]:
        """The simulation's views."""
        return self.driver("observed").world.look()

    def finer(self, state: DriverState) -> Callable[[str], View] | None:
        """The simulation's finer views."""
        return self.driver("observed").world.finer()

    def execute(
        self, trajectory: Trajectory, scene: Scene, listener: ExecutionListener = SILENT
    ) -> ExecutionReport:
        """Move through the waypoints, planning around the perceived scene; stops at the first that fails."""
        driver, shot, rate = self.driver("moved"), -np.inf, self._config.video_fps

        def film() -> None:
            nonlocal shot
            state = driver.state()
            if driver.time - shot < 1.0 / rate - 1e-9 or not driver.world.sane():
                return
            shot, draw = driver.time, driver.world.draw_later()
            listener.moment(Moment(driver.time, state.joints, state.gripper_width, draw, driver.command))
            if listener.wants_frames:
                listener.frame(draw())

        driver.film = film if rate > 0 and listener is not SILENT else _nothing
        faster = Trajectory(tuple(replace(w, speed=self._config.pace * w.speed) for w in trajectory))
        return super().execute(faster, scene, listener)

    def success_check(self) -> SuccessCheck | None:
        """Whether the world's own check was met at any step, within its steps; None without a check."""
        driver = self.driver("judged")
        world, driver.film = driver.world, _nothing
        until = world.steps + JUDGE_STEPS if world.steps > 0 else 0
        while driver.succeeded() is False and world.steps < until and not driver.expired():
            driver.hold(1)
        done = driver.succeeded()
        return None if done is None else SuccessCheck(done, done)

    def servo(self, joints: FloatArray, opening: float, seconds: float) -> DriverState:
        """Drive the arm by joint targets; see :class:`gvla2.robot.driver.Servo`."""
        driver = self.driver("moved")
        driver.film = _nothing
        driver.servo(self.joint_target(joints, opening, seconds), opening, seconds)
        return self.driver("moved").state()

    def reached(self) -> bool:
        """Whether the world's own check was met at any step so far."""
        return bool(self.driver("judged").succeeded())

    def seconds_left(self) -> float:
        """Simulated seconds that the world still allows, infinite without a limit."""
        world = self.driver("timed").world
        return (world.max_steps - world.steps) / world.rate if world.max_steps > 0 else np.inf

    def true_scene(self) -> Scene:
        """The world's bodies as scene objects, for the ``oracle`` perceiver: diagnosis only."""
        return self.driver("read").world.true_scene()

    def close(self) -> None:
        """Release the world; the arm's model stays."""
        if self._world is not None:
            self._world.close()
        self._world, self._task, self._driver = None, None, None


def _differ(one: NDArray[np.float32], other: NDArray[np.float32]) -> bool:
    """Whether something moved between two depth maps (H, W) of a camera, metres."""
    return bool((np.abs(one - other) > MOVED).mean() > FEW)


SETTLED, SLOW, SETTLE_SECONDS = 3e-3, 0.03, 0.3
"""A motion is over at this joint error (rad) and speed (rad/s), or when it came no nearer by that error for so long."""

GRIP_SECONDS, STILL, STILL_STEPS = 1.0, 5e-4, 3
"""Gripping is over, once the hand's target has arrived, when the width (metres) changed by less over this number of
steps, or after this long."""

STOPPED_SHORT = 0.004
"""Fingers hold something when they stop this far short of where they were sent, metres."""

HOLD_STEPS = 3


class StepDriver:
    """Implements :class:`gvla2.robot.driver.Driver` in steps of a simulation, calling ``film`` after each.

    Targets run ahead of the samples by the arm's lag, so that it follows them without delay.
    """

    def __init__(self, world: Simulation) -> None:
        self.world = world
        self.film: Callable[[], None] = _nothing
        self._max_width = world.robot.arm.hand.max_width
        self._opening = 1.0  # that the hand was sent to
        self._target = self.joints  # that the arm was sent to
        self._reached = False

    @property
    def joints(self) -> FloatArray:
        """(dof,) radians."""
        return self.world.measure()[0]

    @property
    def width(self) -> float:
        """Between the fingers, metres."""
        return self.world.measure()[2]

    @property
    def time(self) -> float:
        """Simulated seconds of the episode."""
        return self.world.steps / self.world.rate

    @property
    def command(self) -> FloatArray:
        """(dof + 1,) the joints and the width between the fingers that the last step was sent to."""
        return np.append(self._target, self._opening * self._max_width)

    def state(self) -> DriverState:
        """The measured state, now."""
        joints, _, width = self.world.measure()
        return DriverState(joints, width, self.time)

    def follow(
        self, samples: FloatArray, dt: float, gripper: float, stop: StopRule | None = None
    ) -> MoveResult:
        """Send the arm through joint targets (T, dof), radians, one every ``dt`` seconds, then settle.

        ``stop`` is asked once a step and feels no force.
        """
        # The opening was measured: it must not release what the fingers squeeze at just that width.
        measured = self.width / self._max_width
        short = measured > self._opening + STOPPED_SHORT / self._max_width
        if not (short and abs(gripper - measured) < 0.1):
            self._opening = gripper
        times, rate = np.arange(len(samples)) * dt, self.world.rate

        def at(moment: float) -> FloatArray:
            return np.array([np.interp(moment, times, column) for column in samples.T])

        count, patience = math.ceil(times[-1] * rate - 1e-9), math.ceil(SETTLE_SECONDS * rate)
        nearest, until = np.inf, count + patience
        for step in itertools.count(1):
            joints, speeds, _ = self.world.measure()
            off = float(np.abs(joints - samples[-1]).max())
            arrived = off < SETTLED and np.abs(speeds).max() < SLOW
            # Late, since its motors are at their limits, but on its way.
            if step > count and off < nearest - SETTLED:
                nearest, until = off, step + patience
            if self._over() or step >= until or (step > count and arrived):
                break
            self._step(at(step / rate + self.world.lag))
            if stop is not None and stop(at(step / rate), self.joints, None):
                return MoveResult(stopped=True)
        return MoveResult(diverged=not self.world.sane(), expired=self.expired())

    def grip(self, opening: float) -> GripResult:
        """Open or close to ``opening`` in [0, 1] with the arm held, and wait for it."""
        way = math.ceil(self.world.hand_steps * abs(opening - self._opening))
        still, self._opening = self.joints, opening
        widths: deque[float] = deque(maxlen=STILL_STEPS)
        for step in range(way + math.ceil(GRIP_SECONDS * self.world.rate)):
            widths.append(self.width)
            if self._over() or (step >= way and len(widths) == STILL_STEPS and np.ptp(widths) < STILL):
                break
            self._step(still)
        return GripResult(self.width, self.width > opening * self._max_width + STOPPED_SHORT)

    def servo(self, joints: FloatArray, opening: float, seconds: float) -> None:
        """Drive on to joints (dof,) and an opening in [0, 1] for ``seconds``, arriving or not; nothing settles."""
        start, self._opening = self._target, opening
        for share in np.linspace(0.0, 1.0, 1 + round(seconds * self.world.rate))[1:]:
            if not self._over():
                self._step(start + share * (joints - start))

    def hold(self, steps: int = HOLD_STEPS) -> None:
        """Stop at the measured position and stay there."""
        joints = self.joints
        for _ in range(steps):
            if not self._over():
                self._step(joints)

    def expired(self) -> str:
        """Why the world has ended the episode, "" while it goes on."""
        world = self.world
        ended = 0 < world.max_steps <= world.steps
        return f"The world allows {world.max_steps} steps of {1 / world.rate:g} s." if ended else ""

    def succeeded(self) -> bool | None:
        """Whether the task's goal was reached at any step of the episode; None where the world cannot know."""
        done = self.world.succeeded()
        return None if done is None else self._reached or bool(done)

    def _over(self) -> bool:
        return bool(self.expired()) or not self.world.sane()

    def _step(self, joints: FloatArray) -> None:
        self.world.step(joints, self._opening)
        self.world.steps += 1
        self._target = joints
        self._reached = self._reached or bool(self.world.succeeded())
        film, self.film = self.film, _nothing  # a picture that raises is the last: the arm must still be held
        film()
        self.film = film


def _nothing() -> None:
    """No film."""
