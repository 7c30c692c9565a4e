"""What the executor needs of a robot's lowest level: measure, follow joint samples, work the gripper, hold."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from gvla2.geometry.transform import FloatArray


@dataclass(frozen=True)
class DriverState:
    """What is measured now: ``joints`` (dof,) of the arm without fingers, radians; ``gripper_width`` between the
    fingers, metres.
    """

    joints: FloatArray
    gripper_width: float


@dataclass(frozen=True)
class MoveResult:
    """How following went.

    ``tracking_error`` is the largest joint error at the end of the motion, radians, after the driver gave the arm
    its time to settle. ``contacts`` are names of the robot's own links that touched something on the way, each
    once (never names of scene bodies; empty for a robot without such sensing). ``diverged`` is True when a
    measurement was not finite or physically impossible: the motion was broken off there. ``stopped`` is True when
    a guard ended it (see :class:`GuardedDriver`).
    """

    tracking_error: float
    contacts: tuple[str, ...] = ()
    diverged: bool = False
    stopped: bool = False


@dataclass(frozen=True)
class GripResult:
    """How opening or closing went.

    ``width`` between the fingers at the end, metres; ``held`` True when the fingers were stopped by something
    before they got where they were told to go, None when the robot cannot tell; ``contacts`` as in
    :class:`MoveResult` (fingers included).
    """

    width: float
    held: bool | None
    contacts: tuple[str, ...] = ()


class Driver(Protocol):
    """One arm with its gripper, simulated or real, as the executor drives it.

    All calls block until the motion is over. Commands keep acting after a call returns: the arm holds the last
    sample and the gripper keeps squeezing what it closed on. An exception out of a call (a listener's, a keyboard
    interrupt) leaves the arm in whatever motion it was: the executor then calls :meth:`hold`.
    """

    def state(self) -> DriverState:
        """The measured state, now."""
        ...

    def follow(self, samples: FloatArray, dt: float, gripper: float) -> MoveResult:
        """Send the arm through joint targets (T, dof), radians, one every ``dt`` seconds, then settle.

        ``samples[0]`` is where the arm is; the first and last samples are at rest. ``gripper`` in [0, 1] is the
        opening that stays commanded on the way (the fingers go on squeezing a held object).
        """
        ...

    def grip(self, opening: float) -> GripResult:
        """Open or close to ``opening`` in [0, 1] (1 is ``Hand.max_width``) with the arm held, and wait for it."""
        ...

    def hold(self) -> None:
        """Stop where the arm is measured to be and stay there; must work after any error, and twice."""
        ...


StopRule = Callable[[FloatArray, FloatArray, FloatArray | None], bool]
"""Commanded joints (dof,), measured joints (dof,), radians, and the force (3,) on the hand and what it holds, newtons,
world frame, None for a robot that does not measure it; True where the motion is to end."""


@runtime_checkable
class GuardedDriver(Protocol):
    """What a :class:`Driver` has besides when it can end a motion on contact; without it guards are not felt."""

    def follow_guarded(self, samples: FloatArray, dt: float, gripper: float, stop: StopRule) -> MoveResult:
        """As :meth:`Driver.follow`, asking ``stop`` at least 50 times a second, also while it settles.

        A force is a mean over some hundredths of a second: a knock is no press.
        On True the arm stops where it is, without settling, and the result says ``stopped``.
        """
        ...
