"""The Piper's CAN frames: commands, feedback, and those that must never be sent.

All numbers are big-endian: joints in thousandths of a degree, the gripper in micrometres and mNm.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Sequence

STOP_AND_TEACH = 0x150
MODE = 0x151
JOINT_TARGETS = (0x155, 0x156, 0x157)
GRIPPER_TARGET = 0x159
ENABLE = 0x471
LIMIT_QUERY = 0x472

STATUS = 0x2A1
JOINTS = (0x2A5, 0x2A6, 0x2A7)
GRIPPER = 0x2A8
SLOW_DRIVES = tuple(range(0x261, 0x267))
LIMIT_ANSWER = 0x473
ANSWERS = (LIMIT_ANSWER, 0x47C)

COMMANDS = frozenset(range(0x150, 0x160)) | {0x121, 0x470, 0x471, 0x474, 0x475, 0x477, 0x479, 0x47A, 0x47D}
"""Frames that command an arm; queries are not among them."""

CAN_CONTROL, MOVE_JOINTS = 0x01, 0x01
ENABLED_BIT = 6
DRIVE_FAULTS = {
    0: "low voltage", 1: "motor too hot", 2: "overcurrent", 3: "driver too hot", 4: "collision", 5: "driver error",
    7: "stall",
}  # fmt: skip
"""Bits of byte 5 of a slow drive frame; bit 6 is not a fault: the drive is enabled."""

ARM_STATES = (
    "normal", "emergency stop", "no solution", "singularity", "target beyond the limits", "joint communication broken",
    "brake not released", "collision", "too fast while taught", "joint state abnormal", "other error",
    "teaching records", "teaching replays", "teaching paused", "controller too hot", "brake resistor too hot",
)  # fmt: skip
"""By the number in byte 1 of a status frame."""


def millidegrees(radians: float) -> int:
    """An angle as the frames carry it."""
    return round(math.degrees(radians) * 1000.0)


def radians(millidegrees: int) -> float:
    """An angle from the frames."""
    return math.radians(millidegrees * 1e-3)


def unpack_pair(data: Sequence[int]) -> tuple[int, int]:
    """Two signed numbers of eight bytes."""
    first, second = struct.unpack(">ii", bytes(data[:8]))
    return first, second


def unpack_gripper(data: Sequence[int]) -> tuple[int, int, int]:
    """Micrometres, mNm and the status byte of a gripper frame (target or feedback)."""
    width, effort, code = struct.unpack(">ihB", bytes(data[:7]))
    return width, effort, code


def ends_power(arbitration_id: int, data: Sequence[int]) -> str:
    """Why this frame would stop, drop or release the arm or its gripper; "" if it would not.

    An emergency stop lets the arm sink, a reset cuts its power and it falls, a disabled motor goes limp.
    """
    data = bytes(data)
    if arbitration_id == STOP_AND_TEACH:
        return {0x01: "emergency stop", 0x02: "reset"}.get(data[0] if data else 0, "stop and teach frame")
    if arbitration_id == ENABLE and (len(data) < 2 or data[1] != 0x02):
        return "motors disabled"
    if arbitration_id == GRIPPER_TARGET and (len(data) < 7 or data[6] not in (0x01, 0x03)):
        return "gripper disabled"
    if arbitration_id == MODE and (not data or data[0] == 0x00):
        return "standby mode"
    return ""
