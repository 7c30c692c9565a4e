"""Driving a simulated arm: implements :class:`gvla2.robot.driver.Driver`, and feels contact."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable

import numpy as np

from gvla2.geometry.transform import FloatArray
from gvla2.robot.driver import DriverState, GripResult, MoveResult, StopRule
from gvla2_plugins.sapien import SapienArmConfig
from gvla2_plugins.sapien.world import SapienWorld

WATCH_EVERY = 4
"""Physics steps between looks at contacts and sanity: 60 a second at 240 steps."""

SETTLED_ERROR, SETTLED_SPEED, SETTLE_SECONDS = 1e-3, 5e-3, 0.5
"""A motion is over at this joint error (rad) and speed (rad/s), or after this long."""

GRIP_SECONDS, STILL, STILL_SECONDS = 3.0, 1e-4, 0.1
"""Gripping is over when the width changed by less than this (metres) in this long, or after three seconds.

The engine's speed of a squeezed finger is no criterion: it stays at centimetres per second.
"""

STOPPED_SHORT, PRESSING = 0.002, 0.2
"""Fingers hold something when they stop this far short of their target (metres), both pressing (newtons)."""

BRAKE_SECONDS = 0.2

FELT_STEPS = 4
"""Number of physics steps over which a guard averages the force: a knock in one step does not count as a press."""


class SapienDriver:
    """Advances a :class:`SapienWorld`, and takes a picture by ``film`` every ``1 / video_fps`` s of physics."""

    def __init__(
        self,
        world: SapienWorld,
        config: SapienArmConfig,
        max_width: float,
        film: Callable[[], None] | None = None,
    ) -> None:
        self._world, self._config, self._max_width = world, config, max_width
        self._film = film if config.video_fps > 0 else None
        self._filmed_every = max(1, round(world.rate / config.video_fps)) if config.video_fps > 0 else 1
        self._steps = 0
        self._stop: StopRule | None = None
        self._begin()
        self._felt: deque[FloatArray] = deque(maxlen=FELT_STEPS)  # newtons on the hand, a step each

    def _begin(self) -> None:
        self._touched: set[str] = set()
        self._diverged = self._stopped = False

    def state(self) -> DriverState:
        """The measured state, now."""
        return DriverState(self._world.joints, self._world.gripper_width, self._world.time)

    def follow(
        self, samples: FloatArray, dt: float, gripper: float, stop: StopRule | None = None
    ) -> MoveResult:
        """Send the arm through joint targets (T, dof), radians, one every ``dt`` seconds, then settle.

        The force that ``stop`` gets is the wrist's, the mean of the last physics steps.
        """
        self._begin()
        self._stop = stop
        self._felt.clear()
        if not self._squeezes_at(gripper):
            self._world.drive_fingers(self._travel(gripper))
        for target, speed in zip(*self._resample(samples, dt), strict=True):
            self._world.drive_arm(target, speed)
            self._advance(target)
            if self._diverged or self._stopped:
                break
        else:
            self._world.drive_arm(samples[-1], np.zeros(samples.shape[1]))
        for _ in range(self._count(SETTLE_SECONDS)):
            error = np.abs(self._world.joints - samples[-1]).max()
            slow = np.abs(self._world.joint_speeds).max() < SETTLED_SPEED
            if self._diverged or self._stopped or (error < SETTLED_ERROR and slow):
                break
            self._advance(samples[-1])
        self._watch()
        return MoveResult(tuple(sorted(self._touched)), self._diverged, self._stopped)

    def grip(self, opening: float) -> GripResult:
        """Open or close to ``opening`` in [0, 1] with the arm held, and wait for it."""
        self._begin()
        goal = self._travel(opening)
        start = 0.5 * self._world.gripper_width
        ramp = max(1, self._count(abs(goal - start) / self._config.grip_speed))
        for share in np.linspace(0.0, 1.0, ramp + 1)[1:]:
            self._world.drive_fingers(float(start + share * (goal - start)))
            self._advance()
        widths: deque[float] = deque(maxlen=self._count(STILL_SECONDS))
        for _ in range(self._count(GRIP_SECONDS)):
            widths.append(self._world.gripper_width)
            still = len(widths) == widths.maxlen and max(widths) - min(widths) < STILL
            if self._diverged or still:
                break
            self._advance()
        self._watch()
        width = self._world.gripper_width
        pressed = any(min(pair) > PRESSING for pair in self._world.finger_forces().values())
        return GripResult(width, pressed and width - 2 * goal > STOPPED_SHORT, tuple(sorted(self._touched)))

    def servo(self, joints: FloatArray, gripper: float, seconds: float) -> None:
        """Drive on to joints (dof,) and an opening in [0, 1] for ``seconds``, arriving or not; nothing settles."""
        goal = self._travel(gripper)
        self._world.drive_fingers(goal)
        start, steps = self._world.arm_target, self._count(seconds)
        for share in np.linspace(0.0, 1.0, steps + 1)[1:]:
            self._world.drive_arm(start + share * (joints - start), (joints - start) / seconds)
            self._world.step()

    def hold(self, seconds: float = BRAKE_SECONDS) -> None:
        """Stop at the measured position and stay there; simulates ``seconds`` of it."""
        joints = self._world.joints
        if not np.isfinite(joints).all():
            return  # blown up: nothing is left to hold, and the next reset builds a new world
        self._world.drive_arm(joints, np.zeros(len(joints)))
        for _ in range(self._count(seconds)):
            self._advance()

    def _resample(self, samples: FloatArray, dt: float) -> tuple[FloatArray, FloatArray]:
        """Targets (S, dof) and speeds (S, dof), one per physics step, linear between samples."""
        times = np.arange(len(samples)) * dt
        count = int(np.ceil(times[-1] * self._world.rate - 1e-9))
        steps = np.minimum(np.arange(1, count + 1) / self._world.rate, times[-1])
        targets = np.stack([np.interp(steps, times, column) for column in samples.T], axis=1)
        before = np.vstack([samples[:1], targets[:-1]])
        return targets, (targets - before) * self._world.rate

    def _squeezes_at(self, opening: float) -> bool:
        """Whether the fingers squeeze something and the opening is where it stops them.

        A new execution starts from measurements: it must not release an earlier grasp.
        """
        width = self._world.gripper_width
        stopped_short = width - 2 * self._world.finger_target > STOPPED_SHORT
        return stopped_short and abs(2 * self._travel(opening) - width) < STOPPED_SHORT

    def _travel(self, opening: float) -> float:
        """One finger's travel from closed, metres, of an opening in [0, 1]."""
        return 0.5 * self._max_width * float(np.clip(opening, 0.0, 1.0))

    def _advance(self, target: FloatArray | None = None) -> None:
        """One step; with a guard also a check of the hand's force on its way to the joints ``target`` (7,)."""
        self._world.step()
        self._steps += 1
        if self._stop is not None and target is not None:
            self._felt.append(self._world.hand_force())
            felt = np.sum(self._felt, axis=0) / FELT_STEPS
            self._stopped = self._stop(target, self._world.joints, felt)
        if self._steps % WATCH_EVERY == 0:
            self._watch()
        if (self._world.steps - 1) % self._filmed_every == 0:
            self._shoot()

    def _watch(self) -> None:
        self._diverged = self._diverged or not self._world.sane()
        if not self._diverged:
            self._touched |= self._world.touching_links()

    def _shoot(self) -> None:
        """A frame of the film; one that raises is the last, since the arm must still be held."""
        film, self._film = self._film, None
        if film is not None and self._world.sane():
            film()
        self._film = film

    def _count(self, seconds: float) -> int:
        return int(np.ceil(seconds * self._world.rate))
