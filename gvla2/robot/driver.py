"""The executor's interface to a robot's lowest level: measure, follow joint samples, move the gripper, hold."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from gvla2.geometry.transform import FloatArray


@dataclass(frozen=True)
class DriverState:
    """The present measurement: ``joints`` (dof,) of the arm without fingers, radians; ``gripper_width`` between the
    fingers, metres; ``time`` of the robot's own clock, seconds, simulated or not, None if it has none.
    """

    joints: FloatArray
    gripper_width: float
    time: float | None = None


@dataclass(frozen=True)
class MoveResult:
    """The result of following.

    ``contacts`` are names of the robot's own links that touched something on the way, each once (never names of scene
    bodies; empty for a robot without such sensing). ``diverged`` is True when a measurement was not finite or
    physically impossible: the motion was aborted there. ``stopped`` is True when a stop rule ended it. ``expired``
    says why a world has ended the episode, "" while it goes on.
    """

    contacts: tuple[str, ...] = ()
    diverged: bool = False
    stopped: bool = False
    expired: str = ""


@dataclass(frozen=True)
class GripResult:
    """The result of opening or closing.

    ``width`` between the fingers at the end, metres; ``held`` True when something stopped the fingers before their
    target, None when the robot does not measure it; ``contacts`` as in :class:`MoveResult` (fingers included).
    """

    width: float
    held: bool | None
    contacts: tuple[str, ...] = ()


StopRule = Callable[[FloatArray, FloatArray, FloatArray | None], bool]
"""Commanded joints (dof,), measured joints (dof,), radians, and the force (3,) on the hand and what it holds, newtons,
world frame, None for a robot that does not measure it; True to end the motion. A force is a mean over some hundredths
of a second, so a knock does not count as a press."""


class Driver(Protocol):
    """One arm with its gripper, simulated or real, as the executor drives it.

    All calls block until the motion is over. Commands keep acting after a call returns: the arm holds the last sample
    and the gripper keeps squeezing what it closed on. An exception from a call (a listener's, a keyboard interrupt)
    leaves the arm in motion: the executor then calls :meth:`hold`.
    """

    def state(self) -> DriverState:
        """The measured state, now."""
        ...

    def follow(
        self, samples: FloatArray, dt: float, gripper: float, stop: StopRule | None = None
    ) -> MoveResult:
        """Send the arm through joint targets (T, dof), radians, one every ``dt`` seconds, then settle.

        ``samples[0]`` is where the arm is; the first and last samples are at rest. ``gripper`` in [0, 1] is the opening
        that stays commanded on the way (the fingers keep squeezing a held object). A robot that feels contact asks
        ``stop`` at least 50 times per second, also while it settles: on True the arm stops where it is, without
        settling, and the result says ``stopped``. Others ignore it.
        """
        ...

    def grip(self, opening: float) -> GripResult:
        """Open or close to ``opening`` in [0, 1] (1 is ``Hand.max_width``) with the arm held, and wait for it."""
        ...

    def hold(self) -> None:
        """Stop at the measured position and stay there; must work after any error, and twice."""
        ...


@runtime_checkable
class Servo(Protocol):
    """A simulated robot that follows a policy's joint targets among the task's objects, without planning or checks."""

    def servo(self, joints: FloatArray, opening: float, seconds: float) -> DriverState:
        """The measurement after driving for ``seconds`` (0 only measures), without waiting for the arm to arrive.

        The arm's targets move evenly to ``joints`` (dof,), radians, within its limits; the fingers' are immediately at
        ``opening`` in [0, 1]. Raises :class:`gvla2.errors.RobotError` for joints that don't fit the arm, and when the
        simulation has blown up.
        """
        ...

    def reached(self) -> bool:
        """Whether the episode's goal looks reached now, by true state; nothing moves, so it may be passing through."""
        ...
