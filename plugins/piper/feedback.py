"""An arm's feedback, with the age of each value, and the reasons to stop that every tick checks."""

from __future__ import annotations

import threading
import time
from collections import defaultdict
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

    ``joints`` (6,) radians are the last plausible ones, NaN before they came; ``joint_age`` seconds, of the oldest of
    the three frames that make them up; ``zeros`` says that all six were exactly 0 when last heard. ``gripper_width``
    metres. ``state``, ``error_code`` and ``control`` come from the status frame; ``enabled`` by drive; ``faults`` in
    words. ``foreign`` describes a command of another program; ``unbelievable`` an impossible measurement; ``lost`` says
    in brackets why the bus cannot be read, since the last frame.
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
    lost: str


class Feedback:
    """Takes frames in the reader's thread, gives snapshots in any."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._data: dict[int, bytes] = {}
        # When each frame last came, believable or not.
        self._heard: dict[int, float] = defaultdict(lambda: -NEVER)
        self._joints = np.full(6, np.nan)
        self._believed = [-NEVER] * 3  # when each joint frame was last believable
        self._foreign, self._unbelievable, self._lost = "", "", ""

    def lose(self, why: str) -> None:
        """The bus cannot be read now."""
        with self._lock:
            self._lost = f" ({why})"

    def take(self, arbitration_id: int, data: bytes, now: float | None = None) -> None:
        """One frame off the bus, which does not give this program's own frames back."""
        now = time.monotonic() if now is None else now
        with self._lock:
            self._lost = ""
            if arbitration_id in frames.COMMANDS:
                self._foreign = f"{arbitration_id:03X} [{data.hex(' ')}]"
                return
            if arbitration_id in frames.JOINTS:
                self._take_joints(arbitration_id - frames.JOINTS[0], data, now)
            self._heard[arbitration_id], self._data[arbitration_id] = now, data

    def _take_joints(self, index: int, data: bytes, now: float) -> None:
        angles = [frames.radians(value) for value in frames.unpack_pair(data)]
        since = now - self._believed[index]
        for joint, angle in enumerate(angles, 2 * index):
            if not LOW[joint] - _SLACK <= angle <= HIGH[joint] + _SLACK:
                self._unbelievable = f"joint {joint + 1} reads {angle:.3f} rad, far outside its limits"
                return
            leap = abs(angle - self._joints[joint])
            if leap > FULL_SPEED[joint] * since + _JUMP:  # never so before the first
                self._unbelievable = f"joint {joint + 1} seems to have leapt by {leap:.2f} rad"
                return
        self._joints[2 * index : 2 * index + 2] = angles
        self._believed[index] = now

    def forget_trouble(self) -> None:
        """Before arming: earlier messages are not a reason to stop later."""
        with self._lock:
            self._foreign, self._unbelievable = "", ""

    def joints(self) -> FloatArray | None:
        """(6,) last believable joints, radians; None before all three frames came."""
        with self._lock:
            return self._joints.copy() if np.isfinite(self._joints).all() else None

    def snapshot(self, now: float | None = None) -> Snapshot:
        """What is known now."""
        now = time.monotonic() if now is None else now
        with self._lock:
            status = self._data.get(frames.STATUS, bytes(8))
            drives = [self._data.get(drive, bytes(8))[5] for drive in frames.SLOW_DRIVES]
            return Snapshot(
                time=now,
                joints=self._joints.copy(),
                joint_age=now - min(self._heard[frame] for frame in frames.JOINTS),
                zeros=all(self._data.get(frame) == bytes(8) for frame in frames.JOINTS),
                gripper_width=frames.unpack_gripper(self._data.get(frames.GRIPPER, bytes(8)))[0] * 1e-6,
                gripper_age=now - self._heard[frames.GRIPPER],
                state=status[1],
                error_code=int.from_bytes(status[6:8], "big"),
                control=status[0],
                teaching=status[3],
                status_age=now - self._heard[frames.STATUS],
                enabled=tuple(bool(bits >> frames.ENABLED_BIT & 1) for bits in drives),
                faults=tuple(
                    f"joint {joint}: {word}"
                    for joint, bits in enumerate(drives, 1)
                    for bit, word in frames.DRIVE_FAULTS.items()
                    if bits >> bit & 1
                ),
                drive_age=now - min(self._heard[drive] for drive in frames.SLOW_DRIVES),
                foreign=self._foreign,
                unbelievable=self._unbelievable,
                answered=max(self._heard[answer] for answer in frames.ANSWERS),
                lost=self._lost,
            )


STALE, STALE_STATUS, STALE_DRIVES = 0.1, 0.25, 1.0
"""Ages of feedback beyond which the arm is held, seconds."""

TRACKING_TICKS = 5
"""Number of ticks in a row that a joint may be far from its target."""

FROZEN, FROZEN_TRAVEL = 0.15, 0.03
"""Measurements that stay the same to the last digit for this many seconds, while a target travels by more than this
many radians, count as frozen."""


class Watch:
    """Judges snapshots; remembers for how long a joint has been off its target, and the last change measured.

    ``tracking`` is how far a joint may be from its target, radians.
    """

    def __init__(self, tracking: float = 0.10) -> None:
        self._tracking_limit = tracking
        self._off = 0
        self._same: tuple[float, FloatArray, FloatArray] | None = None  # since when, joints, target then

    def trouble(self, seen: Snapshot, target: FloatArray, sending: str, asleep: float = 0.0) -> str:
        """Why the arm must be held now, in words; "" when all is well.

        ``sending`` describes a failed command. ``asleep`` are seconds for which this process itself could not listen
        lately (a long call into a library): feedback may be older by that much.
        """
        if seen.foreign:
            return f"another program commands the arm: frame {seen.foreign}"
        if sending:
            return sending
        if seen.joint_age > STALE + asleep:
            return f"no joint feedback for {1e3 * seen.joint_age:.0f} ms{seen.lost}"
        if seen.status_age > STALE_STATUS + asleep:
            return f"no status for {1e3 * seen.status_age:.0f} ms"
        if seen.drive_age > STALE_DRIVES + asleep:
            return f"no word from a drive for {seen.drive_age:.1f} s"
        if seen.unbelievable:
            return f"the measurements can't be believed: {seen.unbelievable}"
        return self.condition(seen) or self._tracking(seen, target) or self._frozen(seen, target)

    @staticmethod
    def condition(seen: Snapshot, armed: bool = True) -> str:
        """The arm's own fault reports; an unarmed one may be disabled and in standby."""
        if seen.state != 0:
            known = seen.state < len(frames.ARM_STATES)
            return f"the arm's status is '{frames.ARM_STATES[seen.state] if known else hex(seen.state)}'"
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
        self._off = self._off + 1 if error[worst] > self._tracking_limit else 0
        if self._off < TRACKING_TICKS:
            return ""
        return (
            f"joint {worst + 1} is {error[worst]:.2f} rad from its target: stuck, pushed or frozen feedback"
        )

    def _frozen(self, seen: Snapshot, target: FloatArray) -> str:
        if self._same is None or not np.array_equal(self._same[1], seen.joints):
            self._same = (seen.time, seen.joints, target.copy())
        since, _, then = self._same
        travel = float(np.abs(target - then).max())
        if seen.time - since <= FROZEN or travel <= FROZEN_TRAVEL:
            return ""
        return f"the feedback is frozen: no digit has changed while the target travelled by {travel:.2f} rad"

    def forget(self) -> None:
        """A new target was set on purpose."""
        self._off, self._same = 0, None
