"""The only access to the bus: frames that are not explicitly allowed never leave this process."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Any

import can
import numpy as np

from gvla2.geometry.transform import FloatArray
from gvla2_plugins.piper import frames
from gvla2_plugins.piper.arm import HIGH, LOW, MAX_WIDTH, NEAR, SLACK, Bounds
from gvla2_plugins.piper.writer import CommandLog

_ECHO_SECONDS, _MOST_SENT = 1.0, 2000
"""A frame that was sent within this long is an echo; number of frames from which on older ones are forgotten."""


class CommandGate(can.BusABC):
    """A python-can bus around another one; the SDK sends and receives through it, unmodified.

    A closed gate (``log`` None, or before :meth:`open_gate`) lets nothing out: that is the dry run. An open one lets
    out only the frames of :meth:`objection`'s list, each written to the log first. Anything else that the SDK could
    send (reset, stop, disable, standby, zero setting, parameters) raises ``CanOperationError`` and is counted in
    ``refused``.
    """

    def __init__(
        self,
        inner: can.BusABC,
        bounds: Bounds,
        log: CommandLog | None,
        measured: Callable[[], FloatArray | None],
    ) -> None:
        super().__init__(channel=inner.channel_info)
        self.channel_info = inner.channel_info
        self._inner, self._bounds, self._log, self._measured = inner, bounds, log, measured
        self._open, self._closed = False, False
        self._targets: list[int | None] = [None] * 6  # last frames sent, thousandths of a degree
        self._sent: dict[tuple[int, bytes], float] = {}  # when each frame last went out
        self._lock = threading.Lock()
        self.refused: list[str] = []
        self.trouble = ""

    def open_gate(self) -> None:
        """From now on allowed frames go out. Only arming calls this."""
        if self._log is None:
            raise can.CanOperationError("A dry run has no log to write to and sends nothing.")
        self._open = True

    def shut_gate(self) -> None:
        """Nothing goes out any more."""
        self._open = False

    def objection(self, arbitration_id: int, data: bytes) -> str:
        """Why this frame may not go out now; "" when it may."""
        if not self._open:
            return "nothing is sent before the arm is armed"
        if reason := frames.ends_power(arbitration_id, data):
            return f"{reason}: never sent by this program"
        match arbitration_id:
            case frames.MODE:
                wanted = (frames.CAN_CONTROL, frames.MOVE_JOINTS)
                if tuple(data[:2]) != wanted or data[2] > self._bounds.percent or any(data[3:8]):
                    return f"only joint moves at up to {self._bounds.percent} % are allowed"
            case 0x155 | 0x156 | 0x157:
                return self._far_target(2 * (arbitration_id - 0x155), frames.unpack_pair(data))
            case frames.GRIPPER_TARGET:
                width, effort, code = frames.unpack_gripper(data)
                if code != 0x01 or data[7] != 0:
                    return "only the gripper's plain closing and opening is allowed"
                if not 0 <= width <= 1e6 * MAX_WIDTH or not 0 <= effort <= 1e3 * self._bounds.grip_effort:
                    return f"the gripper's target {width} um at {effort} mNm is out of bounds"
            case frames.ENABLE | frames.LIMIT_QUERY | frames.FIRMWARE_QUERY:
                return ""
            case _:
                return "it is not on the list of allowed frames"
        return ""

    def _far_target(self, first: int, values: tuple[int, int]) -> str:
        measured = self._measured()
        for offset, value in enumerate(values):
            joint = first + offset
            angle, last = frames.radians(value), self._targets[joint]
            if not LOW[joint] - SLACK <= angle <= HIGH[joint] + SLACK:
                return f"joint {joint + 1} would leave its limits"
            step = np.inf if last is None else abs(angle - frames.radians(last))
            away = np.inf if measured is None else abs(angle - float(measured[joint]))
            if step > self._bounds.step[joint] + 1e-5 and away > NEAR:
                return f"joint {joint + 1} would jump by {min(step, away):.3f} rad"
        return ""

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Log and send an allowed frame; raise ``can.CanOperationError`` for any other, and when sending fails."""
        data = bytes(msg.data)
        name, reason, log = f"{msg.arbitration_id:03X}", self.objection(msg.arbitration_id, data), self._log
        if reason or log is None:
            self.refused.append(f"{name}: {reason}")
            if self._open:
                self.trouble = f"the frame {name} was refused: {reason}"
            if log is not None:
                log.write("event", event="refused", id=name, data=data.hex(), why=reason)
            raise can.CanOperationError(f"Frame {name} was not sent: {reason}.")
        try:
            log.write("frame", id=name, data=data.hex())
            with self._lock:
                self._sent[msg.arbitration_id, data] = time.monotonic()
            self._inner.send(msg, timeout)
        except Exception as error:
            self.trouble = f"a command could not be sent ({error})"
            raise can.CanOperationError(str(error)) from error
        if msg.arbitration_id in frames.JOINT_TARGETS:
            first = 2 * (msg.arbitration_id - frames.JOINT_TARGETS[0])
            self._targets[first : first + 2] = frames.unpack_pair(data)

    def own(self, arbitration_id: int, data: bytes) -> bool:
        """Whether a received frame was sent by this gate within the last second."""
        now = time.monotonic()
        with self._lock:
            if len(self._sent) > _MOST_SENT:
                self._sent = {key: at for key, at in self._sent.items() if now - at < _ECHO_SECONDS}
            return now - self._sent.get((arbitration_id, data), -np.inf) < _ECHO_SECONDS

    def recv(self, timeout: float | None = None) -> can.Message | None:
        """The next frame; short waits, so that the SDK's reader ends soon after :meth:`shutdown`."""
        end = time.monotonic() + (1.0 if timeout is None else timeout)
        while not self._closed:
            try:
                message = self._inner.recv(min(0.1, max(0.0, end - time.monotonic())))
            except Exception:
                time.sleep(0.01)  # the SDK's reader swallows errors and asks again at once
                raise
            if message is not None or time.monotonic() >= end:
                return message
        time.sleep(0.01)
        raise can.CanOperationError("The bus is closed.")

    @property
    def state(self) -> Any:
        """The inner bus's state; the SDK asks before each frame."""
        return self._inner.state

    @state.setter
    def state(self, new_state: Any) -> None:
        raise can.CanOperationError("The state of an arm's bus is not changed here.")

    def shutdown(self) -> None:
        """Close the bus; safe to call twice."""
        if not self._closed:
            self._closed, self._open = True, False
            self._inner.shutdown()
        super().shutdown()
