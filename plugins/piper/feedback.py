"""An arm's feedback, with the age of each value."""

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

    ``joints`` (6,) radians are the last plausible ones, None before any came; ``joint_age`` seconds, of the oldest of
    the three frames that make them up; ``zeros`` says that all six were exactly 0 when last heard. ``gripper_width``
    metres. ``state``, ``error_code`` and ``control`` come from the status frame; ``enabled`` by drive; ``faults`` in
    words. ``foreign`` describes a command of another program; ``unbelievable`` an impossible measurement.
    """

    time: float
    joints: FloatArray | None
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
                joints=self._joints.copy() if np.isfinite(self._believed).all() else None,
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
