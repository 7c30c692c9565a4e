"""The connection to an arm: the maker's SDK, its bus wrapped by the gate, its frames tapped for feedback."""

from __future__ import annotations

import time
import warnings
from typing import Any

import can
import numpy as np

from gvla2.errors import MissingDependencyError, RobotError
from gvla2.geometry.transform import FloatArray
from gvla2_plugins.piper import frames
from gvla2_plugins.piper.arm import MAX_WIDTH, Bounds
from gvla2_plugins.piper.feedback import Feedback, Snapshot
from gvla2_plugins.piper.gate import CommandGate
from gvla2_plugins.piper.writer import CommandLog, be_urgent


def import_sdk() -> Any:
    """The SDK's interface class; raises :class:`MissingDependencyError` when it is not installed."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DeprecationWarning)
            import piper_sdk
    except ImportError as error:
        raise MissingDependencyError("piper_sdk", "The Piper arm", 'pip install "gvla2[piper]"') from error
    return piper_sdk


class PiperLink:
    """An open bus with an arm on it. Listens at once; sends only after :meth:`open_gate`.

    ``bus`` is python-can's word (``socketcan``, ``slcan``, ``virtual``, ``udp_multicast``), ``channel`` its
    channel. Without ``log`` nothing can ever be sent. Raises :class:`RobotError` when the bus can't be opened.
    """

    def __init__(self, bus: str, channel: str, bounds: Bounds, log: CommandLog | None) -> None:
        sdk = import_sdk()
        self.bus, self.channel, self.bounds, self.log = bus, channel, bounds, log
        self.feedback = Feedback()
        self._urgent = False
        self._sdk = sdk.C_PiperInterface_V2(
            can_name=channel, judge_flag=False, can_auto_init=False, logger_level=sdk.LogLevel.SILENT
        )
        if self._sdk.get_connect_status():
            raise RobotError(
                f"This process is already connected to '{channel}': the SDK has one connection each."
            )
        try:
            with warnings.catch_warnings():
                # The SDK calls python-can by a keyword that its version 5 will drop.
                warnings.simplefilter("ignore", DeprecationWarning)
                self._sdk.CreateCanBus(channel, bustype=bus, judge_flag=False)
            port = self._sdk.GetCanBus()
            if port.recv_bus is None or port.send_bus is None:
                raise OSError("no bus")
        except Exception as error:
            how = (
                f"; `sudo ip link set {channel} up type can bitrate 1000000` brings it up"
                if bus == "socketcan"
                else ""
            )
            raise RobotError(
                f"The bus {bus} '{channel}' can't be opened{how}. Or plan without an arm: robot.bus=none."
            ) from (error.__context__ or error)
        # One bus for both directions, as the SDK itself does on some systems: a sender of its own would hear all
        # feedback and never read it, and on a virtual bus the reader would hear the sender.
        inner = port.recv_bus
        if port.send_bus is not inner:
            port.send_bus.shutdown()
        self.gate = CommandGate(inner, bounds, log, self.feedback.joints)
        port.recv_bus = port.send_bus = self.gate
        port.callback_function = self._heard
        self._sdk.ConnectPort(piper_init=False)  # True would send queries

    def _heard(self, message: can.Message) -> None:
        if not self._urgent:
            self._urgent = True
            be_urgent()  # this is the reader's thread: what it is late with looks stale
        data = bytes(message.data)
        if not message.is_error_frame and len(data) == 8:
            own = message.arbitration_id in frames.COMMANDS and self.gate.own(message.arbitration_id, data)
            self.feedback.take(message.arbitration_id, data, own)
        self._sdk.ParseCANFrame(message)

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
                f"No frames come from the arm on {self.bus} '{self.channel}' within {seconds:g} s. Is it powered, "
                "the cable in, and the bus at 1 Mbit/s (`ip -details link show`)? A wrong bitrate looks like no arm."
            )
        why = seen.unbelievable or f"these frames don't come: {', '.join(missing)}"
        raise RobotError(f"The arm on '{self.channel}' talks, but {why}.")

    def reader_ok(self) -> bool:
        """Whether the SDK receives frames (it takes a third of a second to notice)."""
        return bool(self._sdk.isOk())

    def open_gate(self) -> None:
        """Let allowed frames out from now on."""
        self.feedback.forget_trouble()
        self.gate.open_gate()

    def ask(self) -> None:
        """Query a harmless limit; the answer is noted in :attr:`Snapshot.answered`."""
        self._sdk.SearchMotorMaxAngleSpdAccLimit(1, 0x01)

    def enable(self, everything: bool = False) -> None:
        """Switch the motors on; ``everything`` by the number that names the gripper's too."""
        self._sdk.EnableArm(0xFF if everything else 7)

    def joint_mode(self) -> None:
        """Joint moves by CAN at the bounded speed."""
        self._sdk.MotionCtrl_2(frames.CAN_CONTROL, frames.MOVE_JOINTS, self.bounds.percent, 0x00)

    def move_joints(self, joints: FloatArray) -> None:
        """One joint target (6,), radians."""
        self._sdk.JointCtrl(*(frames.millidegrees(float(angle)) for angle in joints))

    def move_gripper(self, width: float) -> None:
        """One gripper target, metres, with the bounded effort."""
        micrometres = round(1e6 * min(max(width, 0.0), MAX_WIDTH))
        self._sdk.GripperCtrl(micrometres, round(1e3 * self.bounds.grip_effort), 0x01, 0)

    def close(self) -> None:
        """Shut the gate and leave the bus; the arm stays as it is, powered. Safe to call twice."""
        self.gate.shut_gate()
        self._sdk.DisconnectPort()
