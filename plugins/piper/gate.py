"""The only access to the bus: frames that are not explicitly allowed never leave this process."""

from __future__ import annotations

import contextlib
from collections.abc import Callable

import can
import numpy as np

from gvla2.errors import RobotError
from gvla2.geometry.transform import FloatArray
from gvla2_plugins.piper import frames
from gvla2_plugins.piper.arm import HIGH, LOW, MAX_WIDTH, NEAR, SLACK, Bounds
from gvla2_plugins.piper.writer import CommandLog


class CommandGate:
    """Sends frames on a python-can bus.

    A closed gate (``log`` None, or before :meth:`open_gate`) lets nothing out: that is the dry run. An open one lets
    out only the frames of :meth:`objection`'s list, each written to the log first. Anything else (reset, stop, disable,
    standby, zero setting, parameters) is counted in ``refused``; ``trouble`` says what went wrong since it was opened.
    """

    def __init__(
        self,
        bus: can.BusABC,
        bounds: Bounds,
        log: CommandLog | None,
        measured: Callable[[], FloatArray | None],
    ) -> None:
        self._bus, self._bounds, self._log, self._measured = bus, bounds, log, measured
        self._open = False
        self._targets: list[int | None] = [None] * 6  # last frames sent, thousandths of a degree
        self.refused: list[str] = []
        self.trouble = ""

    def open_gate(self) -> None:
        """From now on allowed frames go out. Only arming calls this; raises :class:`RobotError` without a log."""
        if self._log is None:
            raise RobotError("A dry run has no log to write to and sends nothing.")
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
            case frames.ENABLE | frames.LIMIT_QUERY:
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

    def send(self, arbitration_id: int, data: bytes) -> None:
        """Log and send an allowed frame; one that is not, or that can't be sent, is noted and does not go out."""
        name, reason, log = f"{arbitration_id:03X}", self.objection(arbitration_id, data), self._log
        if reason or log is None:
            self.refused.append(f"{name}: {reason}")
            if self._open:
                self.trouble = f"the frame {name} was refused: {reason}"
            if log is not None:
                with contextlib.suppress(RobotError):
                    log.write("event", event="refused", id=name, data=data.hex(), why=reason)
            return
        try:
            log.write("frame", id=name, data=data.hex())
            self._bus.send(can.Message(arbitration_id=arbitration_id, data=data, is_extended_id=False))
        except (RobotError, can.CanError, OSError) as error:
            self.trouble = f"a command could not be sent ({error})"
            return
        if arbitration_id in frames.JOINT_TARGETS:
            first = 2 * (arbitration_id - frames.JOINT_TARGETS[0])
            self._targets[first : first + 2] = frames.unpack_pair(data)
