"""Drivers for the executor: the armed arm, and the dry run's imaginary arm."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np

from gvla2.errors import RobotError
from gvla2.geometry.transform import FloatArray
from gvla2.planning.scene import Box
from gvla2.robot.arm_model import ArmModel
from gvla2.robot.driver import DriverState, GripResult, MoveResult
from gvla2_plugins.piper.arm import MAX_WIDTH, Bounds
from gvla2_plugins.piper.link import PiperLink
from gvla2_plugins.piper.loop import ControlLoop

SETTLED, SETTLE_SECONDS = 0.008, 1.5
"""A motion is over at this joint error (rad), or after this long."""

GRIP_SECONDS, STILL_SECONDS, STILL = 4.0, 0.25, 2e-4
"""Gripping is over when the fingers moved less than this (m) for this long, or after four seconds."""

STOPPED_SHORT = 0.002
"""Fingers that stop this far short of their target (m) hold something."""


ASSUMED_WIDTH = 0.02
"""Assumed width of an object in a dry run's fingers, metres."""


class PathGuard:
    """The backend's own limits on joint samples, independent of the planner: workspace, table, steps.

    ``arm``'s forward kinematics are used, so calls must not run at the same time as planning.
    """

    def __init__(self, arm: ArmModel, workspace: Box, table_height: float, table_margin: float) -> None:
        self._arm, self._workspace = arm, workspace
        self._floor = table_height + table_margin

    def check(self, samples: FloatArray) -> None:
        """Raise :class:`RobotError` for joint samples (T, 6) that leave the workspace or come under the table's margin.

        A path that starts outside (a parked arm) may only come nearer.
        """
        tools = self._arm.tool_positions(samples)
        gaps = np.maximum(self._workspace.low - tools, tools - self._workspace.high).max(axis=1).clip(0.0)
        if (gaps > np.minimum.accumulate(gaps) + 5e-3).any():
            worst = int(gaps.argmax())
            x, y, z = tools[worst]
            raise RobotError(
                f"The tool would leave the workspace at ({x:.3f}, {y:.3f}, {z:.3f}) m. Nothing was sent."
            )
        tips = tools[:, 2] - self._arm.hand.tip_beyond_tcp
        under = (self._floor - tips).clip(0.0)
        if (under > np.minimum.accumulate(under) + 2e-3).any():
            lowest = float(tips.min())
            raise RobotError(
                f"The fingertips would come down to {lowest:.3f} m; the table's margin ends at {self._floor:.3f} m. "
                "Nothing was sent."
            )


def measured(link: PiperLink) -> DriverState:
    """The arm's present measurement; raises :class:`RobotError` when it is stale."""
    seen = link.feedback.snapshot()
    if seen.joint_age > 0.5 or seen.gripper_age > 0.5:
        age = max(seen.joint_age, seen.gripper_age)
        raise RobotError(f"The arm on '{link.channel}' was last heard {age:.2f} s ago: is the cable out?")
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

    def follow(self, samples: FloatArray, dt: float, gripper: float) -> MoveResult:
        """Send the arm through joint targets (T, 6), radians, one every ``dt`` seconds, then settle."""
        samples = np.atleast_2d(np.asarray(samples, dtype=np.float64))
        if samples.shape[1] != 6 or not np.isfinite(samples).all() or dt <= 0:
            raise RobotError(
                f"The Piper follows finite joint samples (T, 6), got {samples.shape} at dt={dt}."
            )
        self._guard.check(samples)
        ticks = _resample(samples, dt, self._loop.period)
        ticks = np.vstack([_approach(self._loop.target, ticks[0], self._link.bounds), ticks])
        steps = np.abs(np.diff(np.vstack([self._loop.target, ticks]), axis=0))
        if (steps > self._link.bounds.step + 1e-9).any():
            joint = int((steps / self._link.bounds.step).max(axis=0).argmax())
            raise RobotError(
                f"Joint {joint + 1} would be moved faster than this arm is allowed. Nothing was sent."
            )
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

    def follow(self, samples: FloatArray, dt: float, gripper: float) -> MoveResult:
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


def _resample(samples: FloatArray, dt: float, period: float) -> FloatArray:
    """Targets (S, 6) one a ``period``, linear between samples, the last one exact."""
    times = np.arange(len(samples)) * dt
    ticks = np.append(np.arange(0.0, times[-1], period), times[-1])
    return np.stack([np.interp(ticks, times, column) for column in samples.T], axis=1)


def _approach(start: FloatArray, goal: FloatArray, bounds: Bounds) -> FloatArray:
    """Small steps (S, 6) from what is commanded to where a motion begins, which is near-by."""
    count = int(np.ceil((np.abs(goal - start) / (0.5 * bounds.step)).max()))
    return start + np.linspace(0.0, 1.0, count + 1)[1:-1, None] * (goal - start)
