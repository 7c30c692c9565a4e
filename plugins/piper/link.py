"""The connection to an arm: its bus, feedback off it, and commands through the gate."""

from __future__ import annotations

import struct
import time

import can
import numpy as np

from gvla2.errors import RobotError
from gvla2.geometry.transform import FloatArray
from gvla2_plugins.piper import frames
from gvla2_plugins.piper.arm import MAX_WIDTH, Bounds
from gvla2_plugins.piper.feedback import Feedback, Snapshot
from gvla2_plugins.piper.gate import CommandGate
from gvla2_plugins.piper.writer import CommandLog, be_urgent

BITRATE = 1_000_000


class _Listener(can.Listener):  # type: ignore[misc]
    """Hands frames to ``feedback``, and goes on listening where the bus cannot be read: it may come back."""

    def __init__(self, feedback: Feedback) -> None:
        self._feedback, self._urgent = feedback, False

    def on_message_received(self, msg: can.Message) -> None:
        """One frame."""
        if not self._urgent:
            self._urgent = True
            be_urgent()  # this is the reader's thread: what it is late with looks stale
        if not msg.is_error_frame and len(msg.data) == 8:
            self._feedback.take(msg.arbitration_id, bytes(msg.data))

    def on_error(self, exc: Exception) -> None:
        """Why the bus cannot be read; the pause keeps a dead one from filling a core."""
        self._feedback.lose(str(exc))
        time.sleep(0.05)


class PiperLink:
    """An open bus with an arm on it. Listens at once; sends only after ``gate.open_gate``.

    ``bus`` is python-can's word (``socketcan``, ``slcan``, ``virtual``, ``udp_multicast``), ``channel`` its
    channel. Without ``log`` nothing can ever be sent. Raises :class:`RobotError` when the bus can't be opened.
    """

    def __init__(self, bus: str, channel: str, bounds: Bounds, log: CommandLog | None) -> None:
        self.bus, self.channel, self.bounds = bus, channel, bounds
        self.feedback = Feedback()
        try:
            self._bus = can.Bus(channel=channel, interface=bus, bitrate=BITRATE)
        except (can.CanError, OSError, ValueError, ImportError) as error:
            how = f"; `sudo ip link set {channel} up type can bitrate {BITRATE}` brings it up"
            raise RobotError(
                f"The bus {bus} '{channel}' can't be opened ({error}){how if bus == 'socketcan' else ''}. Or plan "
                "without an arm: robot.bus=none."
            ) from error
        self.gate = CommandGate(self._bus, bounds, log, self.feedback.joints)
        self._reader = can.Notifier(self._bus, [_Listener(self.feedback)], timeout=0.1)

    def wait_for_feedback(self, seconds: float = 3.0) -> Snapshot:
        """Wait for joints, status and all drives; raises :class:`RobotError` if they do not come."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            seen = self.feedback.snapshot()
            if np.isfinite([*seen.joints, seen.status_age, seen.drive_age]).all():
                return seen
            time.sleep(0.01)
        ages = {"joints": seen.joint_age, "status": seen.status_age, "drives": seen.drive_age}
        missing = [name for name, age in ages.items() if not np.isfinite(age)]
        if len(missing) == len(ages):
            raise RobotError(
                f"No frames come from the arm on {self.bus} '{self.channel}' within {seconds:g} s{seen.lost}. Is it "
                "powered, the cable in, and the bus at 1 Mbit/s (`ip -details link show`)? A wrong bitrate looks like "
                "no arm."
            )
        why = seen.unbelievable or f"these frames don't come: {', '.join(missing)}"
        raise RobotError(f"The arm on '{self.channel}' talks, but {why}.")

    def ask(self) -> None:
        """Query a harmless limit; the answer is noted in :attr:`Snapshot.answered`."""
        self.gate.send(frames.LIMIT_QUERY, bytes([1, 1, 0, 0, 0, 0, 0, 0]))

    def enable(self, everything: bool = False) -> None:
        """Switch the motors on; ``everything`` by the number that names the gripper's too."""
        self.gate.send(frames.ENABLE, bytes([0xFF if everything else 7, 2, 0, 0, 0, 0, 0, 0]))

    def joint_mode(self) -> None:
        """Joint moves by CAN at the bounded speed."""
        mode = frames.CAN_CONTROL, frames.MOVE_JOINTS, self.bounds.percent
        self.gate.send(frames.MODE, bytes([*mode, 0, 0, 0, 0, 0]))

    def move_joints(self, joints: FloatArray) -> None:
        """One joint target (6,), radians."""
        values = [frames.millidegrees(float(angle)) for angle in joints]
        for k, frame in enumerate(frames.JOINT_TARGETS):
            self.gate.send(frame, struct.pack(">ii", *values[2 * k : 2 * k + 2]))

    def move_gripper(self, width: float) -> None:
        """One gripper target, metres, with the bounded effort."""
        micrometres = round(1e6 * min(max(width, 0.0), MAX_WIDTH))
        effort = round(1e3 * self.bounds.grip_effort)
        self.gate.send(frames.GRIPPER_TARGET, struct.pack(">ihBB", micrometres, effort, 1, 0))

    def close(self) -> None:
        """Shut the gate and leave the bus; the arm stays as it is, powered. Safe to call twice."""
        self.gate.shut_gate()
        self._reader.stop()
        self._bus.shutdown()
