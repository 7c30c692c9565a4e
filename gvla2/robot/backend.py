"""The contract of a robot, simulated or real."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from gvla2.geometry.views import Observation
from gvla2.planning.arm import Arm
from gvla2.planning.scene import Scene
from gvla2.planning.trajectory import Trajectory
from gvla2.robot.report import ExecutionReport, WaypointReport
from gvla2.robot.task import Task, TaskInstance


@dataclass(frozen=True)
class SuccessCheck:
    """Whether an episode succeeded, from true state: only in simulation."""

    relaxed: bool
    strict: bool


@dataclass(frozen=True)
class Moment:
    """The measured robot at the time of a frame: ``time`` in seconds of a monotonic clock, ``joints`` (dof,) in
    radians, ``gripper_width`` in metres.
    """

    time: float
    joints: NDArray[np.float64]
    gripper_width: float


@runtime_checkable
class MotionListener(Protocol):
    """A listener of an episode that also gets the robot's measured state at the time of each frame."""

    def moment(self, moment: Moment) -> None:
        """The state now; its frame follows, in order, perhaps after further moments."""
        ...


@dataclass(frozen=True)
class ExecutionListener:
    """Called while a robot moves: ``frame`` with an RGB image (H, W, 3) uint8 several times a second, ``waypoint``
    after each waypoint, ``moment`` just before a frame by robots that know its state. An exception from any of them
    stops the motion. Without ``frame`` none need be drawn, see :attr:`wants_frames`.
    """

    frame: Callable[[NDArray[np.uint8]], None] = lambda image: None
    waypoint: Callable[[WaypointReport], None] = lambda report: None
    moment: Callable[[Moment], None] = lambda moment: None

    @property
    def wants_frames(self) -> bool:
        """Whether anybody looks: to draw a motion takes longer than to simulate it."""
        return self.frame is not type(self).frame


class RobotBackend(Protocol):
    """One robot with its cameras.

    The loop calls ``reset``, ``observe``, ``execute``, ``observe``, ``success_check``, and ``close`` at the end, also
    after an error. Everything past ``observe`` sees the perceived scene only.
    """

    @property
    def arm(self) -> Arm:
        """Kinematics and collision model, usable before and after ``reset``."""
        ...

    def reset(self, task: Task | None, seed: int, instruction: str | None = None) -> TaskInstance | None:
        """Bring the arm home; a simulator also lays out the task's episode for the seed.

        Returns the sampled episode, None on a real robot.
        """
        ...

    def observe(self) -> Observation:
        """RGB-D views of all cameras and the measured hand."""
        ...

    def execute(
        self, trajectory: Trajectory, scene: Scene, listener: ExecutionListener = ExecutionListener()
    ) -> ExecutionReport:
        """Move through the waypoints, planning around the perceived scene; stops at the first that fails.

        Keyboard interrupts are passed on after the arm has stopped; the listener gets the progress up to then.
        """
        ...

    def success_check(self) -> SuccessCheck | None:
        """Whether the episode's goal is reached now, by true state; None when the robot cannot know."""
        ...

    def close(self) -> None:
        """Release the simulator or the arm; safe to call twice."""
        ...
