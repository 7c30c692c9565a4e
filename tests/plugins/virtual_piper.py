"""A Piper made of frames, for tests: it answers on any python-can bus, with first-order joints."""

from __future__ import annotations

import struct
import threading
import time
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from random import Random

import can
import numpy as np

from gvla2.geometry.transform import FloatArray
from gvla2_plugins.piper import frames
from gvla2_plugins.piper.arm import FULL_SPEED, HIGH, LOW, MAX_WIDTH

FAST_DRIVES, ALL_MOTORS = tuple(range(0x251, 0x257)), (0x07, 0xFF)
PARKED = (0.0, 0.02, -0.02, 0.0, 0.15, 0.0)
RATE = 200.0
LAG, GRIPPER_SPEED = 0.04, 0.08
"""Seconds of the joints' first-order lag; metres a second of the gripper."""


def pair(first: int, second: int) -> bytes:
    """Eight bytes of two signed numbers."""
    return struct.pack(">ii", first, second)


@dataclass
class Faults:
    """What goes wrong, settable at any time from any thread.

    ``silent``: nothing in or out; ``loss``: share of frames lost both ways; ``delay`` seconds both ways;
    ``frozen``: feedback repeats itself; ``stuck``: index of a joint that does not move; ``state``: the status
    byte (7 is a collision); ``zeros``: all joints read 0.
    """

    silent: bool = False
    loss: float = 0.0
    delay: float = 0.0
    frozen: bool = False
    stuck: int | None = None
    state: int = 0
    zeros: bool = False


class VirtualArm:
    """One arm on a bus. ``object_width`` metres is what its fingers find between them, None for nothing.

    Runs in a thread of its own from :meth:`start` to :meth:`stop`. ``heard`` gets each command frame that
    reaches the arm (before faults), as (id, data), for bus monitors.
    """

    def __init__(
        self,
        bus: str,
        channel: str,
        *,
        joints: Sequence[float] = PARKED,
        enabled: bool = False,
        object_width: float | None = None,
        seed: int = 0,
    ) -> None:
        self._bus = can.Bus(channel=channel, interface=bus)
        self.joints: FloatArray = np.array(joints, dtype=np.float64)
        self.width, self.effort = MAX_WIDTH, 0.0
        self.enabled, self.control, self.percent = enabled, 0, 0
        self.object_width = object_width
        self.faults = Faults()
        self.heard: deque[tuple[float, int, bytes]] = deque(maxlen=500_000)
        self._target, self._width_target = self.joints.copy(), self.width
        self._random = Random(seed)
        self._frozen_at: list[tuple[int, bytes]] | None = None
        self._inbox: deque[tuple[float, int, bytes]] = deque()
        self._outbox: deque[tuple[float, int, bytes]] = deque()
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._live, name="virtual-piper", daemon=True)
        self._tick = 0

    def start(self) -> VirtualArm:
        """Start the thread; returns itself."""
        self._thread.start()
        return self

    def stop(self) -> None:
        """End the thread and leave the bus; safe to call twice."""
        self._stop.set()
        if self._thread.is_alive():
            self._thread.join(2.0)
        self._bus.shutdown()

    def __enter__(self) -> VirtualArm:
        return self.start()

    def __exit__(self, *exc: object) -> None:
        self.stop()

    @property
    def targets(self) -> tuple[FloatArray, float]:
        """Target joints (6,), radians, and opening, metres."""
        return self._target.copy(), self._width_target

    def _live(self) -> None:
        before = time.monotonic()
        while not self._stop.is_set():
            due = before + 1.0 / RATE
            while (left := due - time.monotonic()) > 0 and not self._stop.is_set():
                message = self._bus.recv(left)
                if message is not None:
                    self.hear(message.arbitration_id, bytes(message.data), time.monotonic())
            now = time.monotonic()
            self.step(now - before, now)
            before = now
            self._publish(now)

    def hear(self, arbitration_id: int, data: bytes, now: float) -> None:
        """A frame off the bus."""
        if arbitration_id in frames.COMMANDS or arbitration_id == frames.LIMIT_QUERY:
            self.heard.append((now, arbitration_id, data))
            if self.faults.silent or self._random.random() < self.faults.loss:
                return
            self._inbox.append((now + self.faults.delay, arbitration_id, data))

    def step(self, seconds: float, now: float) -> None:
        """Apply commands that arrived by ``now`` and advance by ``seconds``: first order, limited in speed."""
        while self._inbox and self._inbox[0][0] <= now:
            _, arbitration_id, data = self._inbox.popleft()
            self._obey(arbitration_id, data, now)
        if not self.enabled:
            return
        top = FULL_SPEED * self.percent / 100.0
        rate = np.clip((self._target - self.joints) / LAG, -top, top)
        step = np.clip(
            rate * seconds, -np.abs(self._target - self.joints), np.abs(self._target - self.joints)
        )
        if self.faults.stuck is not None:
            step[self.faults.stuck] = 0.0
        self.joints = np.clip(self.joints + step, LOW - 0.02, HIGH + 0.02)
        goal, self.effort = self._width_target, 0.0
        if self.object_width is not None and goal < self.object_width <= self.width + 1e-9:
            goal, self.effort = self.object_width, 0.5
        self.width += float(np.clip(goal - self.width, -GRIPPER_SPEED * seconds, GRIPPER_SPEED * seconds))

    def _obey(self, arbitration_id: int, data: bytes, now: float) -> None:
        match arbitration_id:
            case frames.MODE:
                self.control, self.percent = data[0], min(data[2], 100)
            case 0x155 | 0x156 | 0x157 if self.control == frames.CAN_CONTROL:
                first = 2 * (arbitration_id - 0x155)
                wanted = [frames.radians(v) for v in frames.unpack_pair(data)]
                self._target[first : first + 2] = np.clip(
                    wanted, LOW[first : first + 2], HIGH[first : first + 2]
                )
            case frames.GRIPPER_TARGET:
                width, _, code = frames.unpack_gripper(data)
                if code & 1:
                    self._width_target = min(max(width * 1e-6, 0.0), MAX_WIDTH)
            case frames.ENABLE:
                if data[0] in ALL_MOTORS:
                    if data[1] == 0x02 and not self.enabled:
                        self._target = self.joints.copy()
                    self.enabled = data[1] == 0x02
            case frames.STOP_AND_TEACH:
                if data[0] == 0x02:  # like the real one: without power, the arm falls
                    self.enabled, self.control = False, 0
            case frames.LIMIT_QUERY:
                motor = data[0]
                low, high = (round(np.degrees(v[motor - 1]) * 10) for v in (LOW, HIGH))
                self._say(frames.LIMIT_ANSWER, struct.pack(">BhhHB", motor, high, low, 3000, 0), now)

    def _report(self) -> list[tuple[int, bytes]]:
        raw = [0 if self.faults.zeros else frames.millidegrees(float(v)) for v in self.joints]
        moving = int(np.abs(self._target - self.joints).max() > 2e-3)
        status = bytes([self.control, self.faults.state, frames.MOVE_JOINTS, 0, moving, 0, 0, 0])
        report = [(frames.STATUS, status)]
        report += [(i, pair(raw[2 * k], raw[2 * k + 1])) for k, i in enumerate(frames.JOINTS)]
        grip = struct.pack(">ihBB", round(1e6 * self.width), round(1e3 * self.effort), self.enabled << 6, 0)
        report.append((frames.GRIPPER, grip))
        if self._tick % 5 == 0:
            collision = (1 << 4) if self.faults.state == 7 else 0
            drive = struct.pack(">HhbBH", 240, 30, 30, (self.enabled << 6) | collision, 500)
            report += [(i, drive) for i in frames.SLOW_DRIVES]
        if self._tick % 10 == 0:
            fast = [struct.pack(">hhi", 0, 200, value) for value in raw]
            report += list(zip(FAST_DRIVES, fast, strict=True))
        return report

    def _publish(self, now: float) -> None:
        self._tick += 1
        report = self._report()
        if self.faults.frozen:
            if self._frozen_at is None:
                self._frozen_at = [entry for entry in report if entry[0] in (*frames.JOINTS, frames.GRIPPER)]
            still = dict(self._frozen_at)
            report = [(i, still.get(i, data)) for i, data in report]
        else:
            self._frozen_at = None
        for arbitration_id, data in report:
            self._say(arbitration_id, data, now)
        while self._outbox and self._outbox[0][0] <= now:
            _, arbitration_id, data = self._outbox.popleft()
            if not self.faults.silent and self._random.random() >= self.faults.loss:
                self._bus.send(can.Message(arbitration_id=arbitration_id, data=data, is_extended_id=False))

    def _say(self, arbitration_id: int, data: bytes, now: float) -> None:
        self._outbox.append((now + self.faults.delay, arbitration_id, data))
