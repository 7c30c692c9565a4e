"""AgileX's Piper: the maker's limits, and its model from the URDF that the simulated one shares.

The URDF has the maker's DH numbers (modified convention, joints 2 and 3 shifted by 2 degrees as current firmware has
it). Its solids are cylinders and boxes drawn a little larger than the real links; they are ours.
"""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np

from gvla2.errors import ConfigurationError
from gvla2.geometry.transform import FloatArray
from gvla2.planning.arm import Hand
from gvla2.planning.scene import Box
from gvla2.robot.arm_from_urdf import UrdfArm, arm_from_urdf
from gvla2.robot.options import ArmConfig
from gvla2.robot.urdf import find_file, read_urdf

DESCRIPTION = "package://gvla2/robot/descriptions/piper"

LOW = np.array([-2.6179, 0.0, -2.967, -1.745, -1.22, -2.09439])
HIGH = np.array([2.6179, 3.14, 0.0, 1.745, 1.22, 2.09439])
"""Joint limits of the maker, radians."""

FULL_SPEED = np.radians([180.0, 195.0, 180.0, 225.0, 225.0, 225.0])
"""Joint speeds at 100 %, rad/s; check them against the data sheet of your arm before you raise ``speed``."""

MAX_WIDTH = 0.07
"""Opening of the gripper, metres."""

TCP_OFFSET = 0.1358
"""From the flange (the SDK's end pose) to between the fingertips, metres; measure your own (docs/piper.md)."""

HOME = (0.0, 1.35, -1.0, 0.0, 1.0, 0.0)
"""The preferred posture, radians: the hand in front of the base, pointing down."""

FINGERS = ("finger_left", "finger_right")

HAND = Hand(
    max_width=MAX_WIDTH,
    finger_length=0.055,
    finger_thickness=0.012,
    finger_breadth=0.022,
    tip_beyond_tcp=0.008,
    palm_breadth=0.11,
    palm_depth=0.064,
)


def make_arm(
    workspace: Box,
    base_position: Sequence[float] = (0.0, 0.0, 0.0),
    base_yaw: float = 0.0,
    tcp_offset: float = TCP_OFFSET,
) -> UrdfArm:
    """The Piper at its place in the world, metres and radians."""
    with tempfile.TemporaryDirectory(prefix="gvla2-piper-") as folder:
        urdf = Path(folder) / "piper.urdf"
        urdf.write_bytes(ET.tostring(piper_urdf(tcp_offset)))
        config = ArmConfig(
            name="piper",
            urdf=str(urdf),
            srdf=f"{DESCRIPTION}.srdf",
            tool_link="tcp",
            tool_offset=[0.0, 0.0, 0.0],
            gripper_joints=[f"{name}_joint" for name in FINGERS],
            hand=asdict(HAND),
            home=list(HOME),
            limit_margin=0.02,
            base_position=list(base_position),
            base_yaw=base_yaw,
            table_height=base_position[2] - 1.0,  # the table is the path guard's, not the arm's
            workspace_low=workspace.low.tolist(),
            workspace_high=workspace.high.tolist(),
        )
        return arm_from_urdf(config)


def piper_urdf(tcp_offset: float = TCP_OFFSET) -> ET.Element:
    """The URDF without the block under the simulated arm, its fingertips ``tcp_offset`` metres beyond the flange."""
    robot = read_urdf(find_file(f"{DESCRIPTION}.urdf", "the URDF"))
    for link in robot.iterfind("link[@name='base_link']"):
        for solid in [s for s in link if s.find("geometry/box") is not None]:
            link.remove(solid)
    for joint in ("finger_left_joint", "finger_right_joint", "tcp_joint"):
        for origin in robot.iterfind(f"joint[@name='{joint}']/origin"):
            origin.set("xyz", f"0 0 {tcp_offset}")
    palm_end = tcp_offset + HAND.tip_beyond_tcp - HAND.finger_length
    for solid in robot.iterfind("link[@name='link6']/*[geometry]"):
        for box, origin in zip(solid.iterfind("geometry/box"), solid.iterfind("origin"), strict=False):
            box.set("size", f"{HAND.palm_depth} {HAND.palm_breadth} {palm_end}")
            origin.set("xyz", f"0 0 {0.5 * palm_end}")
    return robot


PERIOD = 0.01
"""Seconds between joint targets."""

HIGHEST_SPEED_SHARE = 0.20
"""No configuration makes this backend faster than this share of full speed."""

HIGHEST_GRIP_EFFORT = 2.0
"""Nm; the gripper itself goes to 5."""


@dataclass(frozen=True)
class Bounds:
    """The gate's limits: ``speed_share`` of full speed, targets every :data:`PERIOD` seconds, ``grip_effort`` Nm.

    A joint target is a step of at most ``step`` (6,) radians from the last one, or lies within ``near`` radians of
    where the arm was measured; ``slack`` radians beyond the maker's limits are tolerated, because a parked arm
    measures a little outside of them. Raises :class:`ConfigurationError` for more than this backend ever allows.
    """

    speed_share: float = 0.2
    grip_effort: float = 1.0
    near: float = 0.05
    slack: float = 0.05

    def __post_init__(self) -> None:
        if not 0.0 < self.speed_share <= HIGHEST_SPEED_SHARE:
            raise ConfigurationError(
                f"robot.speed={self.speed_share} must lie in (0, {HIGHEST_SPEED_SHARE}]."
            )
        if not 0.0 < self.grip_effort <= HIGHEST_GRIP_EFFORT:
            raise ConfigurationError(
                f"robot.grip_effort={self.grip_effort} must lie in (0, {HIGHEST_GRIP_EFFORT}] Nm."
            )

    @cached_property
    def step(self) -> FloatArray:
        """(6,) radians between two targets, with some room."""
        return 1.25 * self.speed_share * FULL_SPEED * PERIOD

    @property
    def percent(self) -> int:
        """The speed as the mode frame carries it."""
        return max(1, round(100 * self.speed_share))
