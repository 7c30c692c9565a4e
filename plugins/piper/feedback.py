"""An arm's feedback, with the age of each value, and the reasons to stop that every tick checks."""

from __future__ import annotations

import threading
import time
from dataclasses import dataclass

import numpy as np

from gvla2.geometry.transform import FloatArray
from gvla2_plugins.piper import frames
from gvla2_plugins.piper.arm import FULL_SPEED, HIGH, LOW

_SLACK, _JUMP = 0.10, 0.05  # radians beyond the limits, and on top of full speed, that are still plausible
NEVER = float("inf")


@dataclass(frozen=True)
class Snapshot:
    """Everything known at one moment of the monotonic clock.

    ``joints`` (6,) radians are the last plausible ones, NaN before any came; ``joint_age`` seconds, of the oldest of
    the three frames that make them up; ``zeros`` says that all six were exactly 0 when last heard. ``gripper_width``
    metres. ``state``, ``error_code`` and ``control`` come from the status frame; ``enabled`` by drive; ``faults`` in
    words. ``foreign`` describes a command of another program; ``unbelievable`` an impossible measurement.
    """

    time: float
    joints: FloatArray
    joint_age: float
    zeros: bool
    gripper_width: float
    gripper_age: float
    state: int
    error_code: int
    control: int
    teaching: int
    status_age: float
    enabled: tuple[bool, ...]
    faults: tuple[str, ...]
    drive_age: float
    foreign: str
    unbelievable: str
    answered: float


class Feedback:
    """Takes frames in the reader's thread, gives snapshots in any."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._joints = np.zeros(6)
        self._raw: list[int | None] = [None] * 6
        self._heard = [-NEVER] * 3  # when each joint frame last came, believable or not
        self._believed = [-NEVER] * 3
        self._width, self._gripper_at = 0.0, -NEVER
        self._status: tuple[int, int, int, int] = (0, 0, 0, 0)
        self._status_at = -NEVER
        self._drives: dict[int, tuple[float, int]] = {}
        self._foreign, self._unbelievable = "", ""
        self._answered = -NEVER

    def take(self, arbitration_id: int, data: bytes, own: bool = False, now: float | None = None) -> None:
        """One frame off the bus; ``own`` if it is the echo of this program's frame."""
        now = time.monotonic() if now is None else now
        with self._lock:
            if arbitration_id in frames.JOINTS:
                self._take_joints(arbitration_id - frames.JOINTS[0], data, now)
            elif arbitration_id == frames.STATUS:
                self._status = (data[0], data[1], data[3], int.from_bytes(data[6:8], "big"))
                self._status_at = now
            elif arbitration_id == frames.GRIPPER:
                self._width, self._gripper_at = frames.unpack_gripper(data)[0] * 1e-6, now
            elif arbitration_id in frames.SLOW_DRIVES:
                self._drives[arbitration_id - frames.SLOW_DRIVES[0]] = (now, data[5])
            elif arbitration_id in (frames.LIMIT_ANSWER, frames.ACCELERATION_ANSWER):
                self._answered = now
            elif arbitration_id in frames.COMMANDS and not own:
                self._foreign = f"{arbitration_id:03X} [{data.hex(' ')}]"

    def _take_joints(self, index: int, data: bytes, now: float) -> None:
        first, values = 2 * index, frames.unpack_pair(data)
        elapsed, self._heard[index] = now - self._heard[index], now
        self._raw[first : first + 2] = values
        for joint, value in zip((first, first + 1), values, strict=True):
            angle = frames.radians(value)
            if not LOW[joint] - _SLACK <= angle <= HIGH[joint] + _SLACK:
                self._unbelievable = f"joint {joint + 1} reads {angle:.3f} rad, far outside its limits"
                return
            since = now - self._believed[index]
            if np.isfinite(since):
                leap = abs(angle - self._joints[joint])
                if leap > FULL_SPEED[joint] * max(since, elapsed) + _JUMP:
                    self._unbelievable = f"joint {joint + 1} seems to have leapt by {leap:.2f} rad"
                    return
        self._joints[first : first + 2] = [frames.radians(v) for v in values]
        self._believed[index] = now

    def forget_trouble(self) -> None:
        """Before arming: earlier messages are not a reason to stop later."""
        with self._lock:
            self._foreign, self._unbelievable = "", ""

    def joints(self) -> FloatArray | None:
        """(6,) last believable joints, radians; None before all three frames came."""
        with self._lock:
            return self._joints.copy() if np.isfinite(self._believed).all() else None

    def snapshot(self, now: float | None = None) -> Snapshot:
        """What is known now."""
        now = time.monotonic() if now is None else now
        with self._lock:
            control, state, teaching, error = self._status
            known = [self._drives.get(i) for i in range(6)]
            return Snapshot(
                time=now,
                joints=self._joints.copy() if np.isfinite(self._believed).all() else np.full(6, np.nan),
                joint_age=now - min(self._heard),
                zeros=all(v == 0 for v in self._raw),
                gripper_width=self._width,
                gripper_age=now - self._gripper_at,
                state=state,
                error_code=error,
                control=control,
                teaching=teaching,
                status_age=now - self._status_at,
                enabled=tuple(d is not None and bool(d[1] >> frames.ENABLED_BIT & 1) for d in known),
                faults=tuple(
                    f"joint {i + 1}: {word}"
                    for i, d in enumerate(known)
                    if d is not None
                    for bit, word in frames.DRIVE_FAULTS.items()
                    if d[1] >> bit & 1
                ),
                drive_age=max((NEVER if d is None else now - d[0] for d in known), default=NEVER),
                foreign=self._foreign,
                unbelievable=self._unbelievable,
                answered=self._answered,
            )


@dataclass(frozen=True)
class WatchLimits:
    """Seconds and radians beyond which the arm is held.

    ``tracking`` is how far a joint may be from its target for ``tracking_ticks`` ticks in a row; ``heartbeat`` how long
    the controlling program may be silent, ``lateness`` how late a tick of the loop itself may be. Measurements that
    stay the same to the last digit for ``frozen`` seconds, while a target travels by more than ``frozen_travel``
    radians, count as frozen.
    """

    stale: float = 0.1
    stale_status: float = 0.25
    stale_drives: float = 1.0
    tracking: float = 0.10
    tracking_ticks: int = 5
    heartbeat: float = 0.25
    lateness: float = 0.1
    frozen: float = 0.15
    frozen_travel: float = 0.03


class Watch:
    """Judges snapshots; remembers for how long a joint has been off its target, and the last change measured."""

    def __init__(self, limits: WatchLimits) -> None:
        self.limits = limits
        self._off = 0
        self._same: tuple[float, FloatArray, FloatArray] | None = None  # since when, joints, target then

    def trouble(
        self, seen: Snapshot, target: FloatArray, reader_ok: bool, sending: str, asleep: float = 0.0
    ) -> str:
        """Why the arm must be held now, in words; "" when all is well.

        ``sending`` describes a failed command. ``asleep`` are seconds for which this process itself could not listen
        lately (a long call into a library): feedback may be older by that much.
        """
        limits = self.limits
        if seen.foreign:
            return f"another program commands the arm: frame {seen.foreign}"
        if sending:
            return sending
        if seen.joint_age > limits.stale + asleep:
            return f"no joint feedback for {1e3 * seen.joint_age:.0f} ms"
        if seen.status_age > limits.stale_status + asleep:
            return f"no status for {1e3 * seen.status_age:.0f} ms"
        if seen.drive_age > limits.stale_drives + asleep:
            return f"no word from a drive for {seen.drive_age:.1f} s"
        if not reader_ok and not asleep:
            return "the SDK's reader receives nothing"
        if seen.unbelievable:
            return f"the measurements can't be believed: {seen.unbelievable}"
        return self.condition(seen) or self._tracking(seen, target) or self._frozen(seen, target)

    @staticmethod
    def condition(seen: Snapshot, armed: bool = True) -> str:
        """The arm's own fault reports; an unarmed one may be disabled and in standby."""
        if seen.state != 0:
            return f"the arm's status is '{frames.ARM_STATES.get(seen.state, hex(seen.state))}'"
        if seen.error_code:
            return f"the arm's error code is {seen.error_code:#06x}"
        if seen.faults:
            return f"a drive reports a fault: {', '.join(seen.faults)}"
        if seen.teaching or seen.control not in (0, frames.CAN_CONTROL):
            return f"the arm is in another mode (control {seen.control:#04x}, teaching {seen.teaching:#04x})"
        if armed and seen.control != frames.CAN_CONTROL:
            return "the arm has left CAN control"
        if armed and not all(seen.enabled):
            off = [str(i + 1) for i, on in enumerate(seen.enabled) if not on]
            return f"the motors of joints {', '.join(off)} are off"
        return ""

    def _tracking(self, seen: Snapshot, target: FloatArray) -> str:
        error = np.abs(seen.joints - target)
        worst = int(error.argmax())
        self._off = self._off + 1 if error[worst] > self.limits.tracking else 0
        if self._off < self.limits.tracking_ticks:
            return ""
        return (
            f"joint {worst + 1} is {error[worst]:.2f} rad from its target: stuck, pushed or frozen feedback"
        )

    def _frozen(self, seen: Snapshot, target: FloatArray) -> str:
        if self._same is None or not np.array_equal(self._same[1], seen.joints):
            self._same = (seen.time, seen.joints, target.copy())
        since, _, then = self._same
        travel = float(np.abs(target - then).max())
        if seen.time - since <= self.limits.frozen or travel <= self.limits.frozen_travel:
            return ""
        return f"the feedback is frozen: no digit has changed while the target travelled by {travel:.2f} rad"

    def forget(self) -> None:
        """A new target was set on purpose."""
        self._off, self._same = 0, None
