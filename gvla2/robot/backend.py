"""The contract of a robot, simulated or real."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from gvla2.errors import PluginError, RobotError
from gvla2.geometry.transform import FloatArray
from gvla2.geometry.views import Observation, View
from gvla2.planning.arm import Arm
from gvla2.planning.scene import Scene
from gvla2.planning.trajectory import Trajectory
from gvla2.robot.report import ExecutionReport, WaypointReport
from gvla2.robot.task import Task, TaskInstance, WorldState


@dataclass(frozen=True)
class SuccessCheck:
    """Whether an episode succeeded, from true state: only in simulation."""

    relaxed: bool
    strict: bool


@dataclass(frozen=True)
class Moment:
    """The measured robot at the time of a frame: ``time`` in seconds of a monotonic clock, ``joints`` (dof,) in
    radians, ``gripper_width`` in metres; ``command`` (dof + 1,) the joints and the width that it is driven to, None for
    a robot that does not know them.

    ``draw`` makes that frame, (H, W, 3) uint8, whenever it is called until the robot's next reset: a film that few will
    see is only drawn for them. None for a robot that cannot.
    """

    time: float
    joints: NDArray[np.float64]
    gripper_width: float
    draw: Callable[[], NDArray[np.uint8]] | None = None
    command: NDArray[np.float64] | None = None


@runtime_checkable
class MotionListener(Protocol):
    """A listener of an episode that also gets the robot's measured state at the time of each frame."""

    def moment(self, moment: Moment) -> None:
        """The state now; its frame follows, in order, perhaps after further moments."""
        ...


@dataclass(frozen=True)
class ExecutionListener:
    """Called while a robot moves: ``frame`` with an RGB image (H, W, 3) uint8 several times per second, ``waypoint``
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
    after an error. Everything past ``observe`` sees the perceived scene only. A world that somebody else built is a
    robot backend too: it owns scene, arm, cameras, sentences, initial states and success check, and may offer its tasks
    by name (:class:`OffersTasks`).
    """

    @property
    def arm(self) -> Arm:
        """Kinematics and collision model, usable before and after ``reset``."""
        ...

    def reset(
        self, task: Task | str | None, seed: int, instruction: str | None = None
    ) -> TaskInstance | None:
        """Bring the arm home; a simulator also sets up the episode for the seed.

        ``task`` is one that a plugin offers, the name of one that this robot offers, or None (``task=none``). Returns
        the episode, in which only the instruction is required; None where there is no more than the caller's
        ``instruction``, as on a real robot. Raises :class:`ConfigurationError` for a task that it cannot set up.
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


@runtime_checkable
class OffersTasks(Protocol):
    """A robot with tasks of its own: ``gvla2 run robot=NAME task=suite/task``, and no others but ``none``."""

    def tasks(self) -> Mapping[str, str]:
        """Each task's sentence by its name ``suite/task``; "" for a sentence that only ``reset`` knows."""
        ...


@dataclass(frozen=True)
class CameraFrames:
    """The cameras' frames of one moment.

    ``views`` are RGB-D: depth in metres along the camera's z, aligned to the colour image, NaN where nothing was
    measured; each view's ``camera.world_from_camera`` is its pose in the robot's *base* frame (the robot moves it on
    into the world). ``timestamps`` are the moments of exposure, one per view, seconds of ``time.time()``.
    ``camera=none`` gives no views. Raises :class:`RobotError` when the two differ in number.
    """

    views: tuple[View, ...]
    timestamps: tuple[float, ...]

    def __post_init__(self) -> None:
        if len(self.views) != len(self.timestamps):
            raise RobotError(
                f"A camera gave {len(self.views)} views and {len(self.timestamps)} timestamps; each view has one."
            )


class DepthCamera(Protocol):
    """One or several calibrated depth cameras, live or recorded.

    ``observe`` may be called any number of times; ``close`` twice. A camera that was unplugged, is frozen, or gives
    images of a different size than its calibration's raises :class:`gvla2.errors.RobotError`, naming it.
    """

    @property
    def live(self) -> bool:
        """Whether it shows the present; a real arm does not move by recorded or synthetic pictures."""
        ...

    def observe(self, base_from_tcp: FloatArray | None = None) -> CameraFrames:
        """Frames taken after the call began. A camera on the hand needs the tool's pose ``base_from_tcp`` (4, 4)."""
        ...

    def close(self) -> None:
        """Release the device or the files."""
        ...


@runtime_checkable
class Truthful(Protocol):
    """A simulated robot that exposes its world as a scene, for the ``oracle`` perceiver and for reports."""

    def true_scene(self) -> Scene:
        """Every body of the episode as a scene object, its id the body's name."""
        ...


@runtime_checkable
class HasTrueState(Protocol):
    """A simulated robot whose world gives the poses of a task's bodies, for environments with ``obs_mode="state"``."""

    def true_state(self) -> WorldState:
        """The state that a success check may read, live."""
        ...


@runtime_checkable
class TimeLimited(Protocol):
    """A robot whose world ends an episode after some time."""

    def seconds_left(self) -> float:
        """Seconds of the robot's own clock until then, infinite where there is no limit."""
        ...


@runtime_checkable
class OffersGallery(Protocol):
    """A robot whose world comes with meshes of its objects."""

    def write_gallery(self, folder: Path) -> Sequence[str]:
        """Write them as a gallery of known objects, a file each, in metres; returns their names."""
        ...


def judge(instance: TaskInstance, state: WorldState) -> SuccessCheck | None:
    """The episode's success checks of the true state; one alone counts for both profiles, none gives None.

    Raises :class:`PluginError` for a check whose answer is not True or False.
    """
    if not instance.succeeded:
        return None
    answers: dict[str, object] = {profile: check(state) for profile, check in instance.succeeded.items()}
    for profile, answer in answers.items():
        if not isinstance(answer, bool | np.bool_):
            raise PluginError(
                f"The task's success check '{profile}' answered {answer!r:.80}; it must be True or False."
            )
    first = next(iter(answers.values()))
    return SuccessCheck(bool(answers.get("relaxed", first)), bool(answers.get("strict", first)))
