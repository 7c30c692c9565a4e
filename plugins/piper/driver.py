"""Drivers for the executor: the armed arm, and the dry run's imaginary arm."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np

from gvla2.errors import RobotError
from gvla2.geometry.transform import FloatArray
from gvla2.robot.arm_from_urdf import ArmModel
from gvla2.robot.driver import DriverState, GripResult, MoveResult, StopRule
from gvla2_plugins.piper.arm import MAX_WIDTH, PERIOD
from gvla2_plugins.piper.link import PiperLink
from gvla2_plugins.piper.loop import ControlLoop

SETTLED, SETTLE_SECONDS = 0.008, 1.5
"""A motion is over at this joint error (rad), or after this long."""

GRIP_SECONDS, STILL_SECONDS, STILL = 4.0, 0.25, 2e-4
"""Gripping is over when the fingers moved less than this (m) for this long, or after four seconds."""

STOPPED_SHORT, ASSUMED_WIDTH = 0.002, 0.02
"""Metres: fingers that stop this far short of their target hold something; what they hold in a dry run."""


class PathGuard:
    """The backend's own limits on joint samples, independent of the planner: ``arm``'s workspace, and the fingertips
    above ``floor``, world z in metres. Calls must not run at the same time as planning.
    """

    def __init__(self, arm: ArmModel, floor: float) -> None:
        self._arm, self._floor = arm, floor

    def check(self, samples: FloatArray) -> None:
        """Raise :class:`RobotError` for joint samples (T, 6) that leave the workspace or come under the table's margin.

        A path that starts outside (a parked arm) may only come nearer.
        """
        tools = self._arm.tool_positions(samples)
        box = self._arm.workspace
        outside = np.maximum(box.low - tools, tools - box.high).max(axis=1).clip(0.0)
        under = (self._floor + self._arm.hand.tip_beyond_tcp - tools[:, 2]).clip(0.0)
        rules = ((outside, 5e-3, "leave the workspace"), (under, 2e-3, "come under the table's margin"))
        for gaps, slack, what in rules:
            if (gaps > np.minimum.accumulate(gaps) + slack).any():
                x, y, z = tools[int(gaps.argmax())]
                raise RobotError(f"The tool would {what} at ({x:.3f}, {y:.3f}, {z:.3f}) m. Nothing was sent.")


def measured(link: PiperLink) -> DriverState:
    """The arm's present measurement; raises :class:`RobotError` when it is stale."""
    seen = link.feedback.snapshot()
    if seen.joint_age > 0.5 or seen.gripper_age > 0.5:
        age = max(seen.joint_age, seen.gripper_age)
        raise RobotError(
            f"The arm on '{link.channel}' was last heard {age:.2f} s ago{seen.lost}: is the cable out?"
        )
    return DriverState(seen.joints, seen.gripper_width, time.monotonic())


class PiperDriver:
    """Implements :class:`gvla2.robot.driver.Driver` on a running control loop."""

    def __init__(
        self, link: PiperLink, loop: ControlLoop, guard: PathGuard, watcher: Callable[[], None] = lambda: None
    ) -> None:
        self._link, self._loop, self._guard, self._watcher = link, loop, guard, watcher

    def state(self) -> DriverState:
        """The measured state, now; see :func:`measured`."""
        return measured(self._link)

    def follow(
        self, samples: FloatArray, dt: float, gripper: float, stop: StopRule | None = None
    ) -> MoveResult:
        """Send the arm through joint targets (T, 6), radians, one every ``dt`` seconds, then settle."""
        self._guard.check(samples)
        ticks = _ticks(self._loop.target, samples, dt, self._link.bounds.step)
        self._loop.move(ticks, self._watcher)
        goal = samples[-1]

        def there() -> bool:
            measured = self._link.feedback.joints()
            return measured is not None and bool(np.abs(measured - goal).max() < SETTLED)

        self._loop.rest(SETTLE_SECONDS, there)
        return MoveResult()

    def grip(self, opening: float) -> GripResult:
        """Open or close to ``opening`` in [0, 1] with the arm held, and wait for it."""
        goal = MAX_WIDTH * float(np.clip(opening, 0.0, 1.0))
        closing = goal < self.state().gripper_width
        self._loop.grip(goal)
        last, since = self.state().gripper_width, time.monotonic()

        def still() -> bool:
            nonlocal last, since
            width = self._link.feedback.snapshot().gripper_width
            if abs(width - last) > STILL:
                last, since = width, time.monotonic()
            return time.monotonic() - since > STILL_SECONDS

        self._loop.rest(GRIP_SECONDS, still)
        width = self.state().gripper_width
        return GripResult(width, closing and width - goal > STOPPED_SHORT)

    def hold(self) -> None:
        """Stop at the measured position and stay there."""
        self._loop.hold()


class DryDriver:
    """An imaginary arm: it reaches every target immediately, and nothing is sent. The guard still checks."""

    def __init__(self, state: DriverState, guard: PathGuard) -> None:
        self._joints, self._width, self._guard = state.joints.copy(), state.gripper_width, guard

    def state(self) -> DriverState:
        """Where the arm would be."""
        return DriverState(self._joints.copy(), self._width)

    def follow(
        self, samples: FloatArray, dt: float, gripper: float, stop: StopRule | None = None
    ) -> MoveResult:
        """Check the samples and jump to the last."""
        self._guard.check(samples)
        self._joints = np.asarray(samples[-1], dtype=np.float64).copy()
        return MoveResult()

    def grip(self, opening: float) -> GripResult:
        """Set the opening. What closing fingers would meet is unknown: they are assumed to stop on something."""
        goal = MAX_WIDTH * float(np.clip(opening, 0.0, 1.0))
        self._width = max(goal, ASSUMED_WIDTH) if goal < self._width else goal
        return GripResult(self._width, None)

    def hold(self) -> None:
        """Nothing moves in a dry run."""


def _ticks(start: FloatArray, samples: FloatArray, dt: float, step: FloatArray) -> FloatArray:
    """Targets (S, 6), one every :data:`PERIOD` seconds: half steps from what is commanded, which is near-by, to the
    first sample, then linear between samples, the last one exact.
    """
    count = int(np.ceil((np.abs(samples[0] - start) / (0.5 * step)).max()))
    approach = start + np.linspace(0.0, 1.0, count + 1)[1:-1, None] * (samples[0] - start)
    times = np.arange(len(samples)) * dt
    at = np.append(np.arange(0.0, times[-1], PERIOD), times[-1])
    return np.vstack([approach, np.stack([np.interp(at, times, column) for column in samples.T], axis=1)])
