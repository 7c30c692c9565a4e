"""AgileX's Piper: the maker's limits, ours, and its model from the URDF that the simulated one shares.

The URDF has the maker's DH numbers (modified convention, joints 2 and 3 shifted by 2 degrees as current firmware has
it). Its solids are cylinders and boxes drawn a little larger than the real links; they are ours.
"""

from __future__ import annotations

import tempfile
from functools import cached_property
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np

from gvla2.errors import ConfigurationError
from gvla2.geometry.transform import FloatArray
from gvla2.robot.arm_from_urdf import RobotModel, arm_from_urdf
from gvla2.robot.options import ArmConfig
from gvla2.robot.urdf import find_file, read_urdf
from gvla2_plugins.piper import PiperConfig

DESCRIPTION = "package://gvla2/robot/descriptions/piper"

LOW = np.array([-2.6179, 0.0, -2.967, -1.745, -1.22, -2.09439])
HIGH = np.array([2.6179, 3.14, 0.0, 1.745, 1.22, 2.09439])
"""Joint limits of the maker, radians."""

FULL_SPEED = np.radians([180.0, 195.0, 180.0, 225.0, 225.0, 225.0])
"""Joint speeds at 100 %, rad/s; check them against the data sheet of your arm before you raise ``speed``."""

MAX_WIDTH = 0.07
"""Opening of the gripper, metres."""

HOME = (0.0, 1.35, -1.0, 0.0, 1.0, 0.0)
"""The preferred posture, radians: the hand in front of the base, pointing down."""

PERIOD = 0.01
"""Seconds between joint targets."""

HIGHEST_SPEED_SHARE = 0.20
"""No configuration makes this backend faster than this share of full speed."""

HIGHEST_GRIP_EFFORT = 2.0
"""Nm; the gripper itself goes to 5."""

NEAR, SLACK = 0.05, 0.05
"""A joint target far from the last one lies within this many radians of where the arm was measured; and what is
tolerated beyond the maker's limits: a parked arm measures a little outside of them."""


def make_arm(config: PiperConfig) -> RobotModel:
    """The Piper at its place in the world, without the block under the simulated one."""
    robot = read_urdf(find_file(f"{DESCRIPTION}.urdf", "the URDF"))
    for link in robot.iterfind("link[@name='base_link']"):
        for solid in [s for s in link if s.find("geometry/box") is not None]:
            link.remove(solid)
    for joint in ("finger_left_joint", "finger_right_joint", "tcp_joint"):
        for origin in robot.iterfind(f"joint[@name='{joint}']/origin"):
            origin.set("xyz", f"0 0 {config.tcp_offset}")
    with tempfile.TemporaryDirectory(prefix="gvla2-piper-") as folder:
        urdf = Path(folder) / "piper.urdf"
        urdf.write_bytes(ET.tostring(robot))
        return arm_from_urdf(
            ArmConfig(
                name="piper",
                urdf=str(urdf),
                srdf=f"{DESCRIPTION}.srdf",
                tool_link="tcp",
                tool_offset=[0.0, 0.0, 0.0],
                gripper_joints=["finger_left_joint", "finger_right_joint"],
                home=list(HOME),
                limit_margin=0.02,
                base_position=config.base_position,
                base_yaw=config.base_yaw,
                table_height=config.base_position[2] - 1.0,  # the table is the path guard's, not the arm's
                workspace_low=config.workspace_low,
                workspace_high=config.workspace_high,
            )
        )


class Bounds:
    """The gate's limits: ``speed_share`` of full speed, targets every :data:`PERIOD` seconds, ``grip_effort`` Nm.

    A joint target is a step of at most ``step`` (6,) radians from the last one, or near where the arm was measured.
    Raises :class:`ConfigurationError` for more than this backend ever allows.
    """

    def __init__(self, speed_share: float = HIGHEST_SPEED_SHARE, grip_effort: float = 1.0) -> None:
        given = {
            "speed": (speed_share, HIGHEST_SPEED_SHARE),
            "grip_effort": (grip_effort, HIGHEST_GRIP_EFFORT),
        }
        for name, (value, most) in given.items():
            if not 0.0 < value <= most:
                raise ConfigurationError(f"robot.{name}={value} must lie in (0, {most}].")
        self.speed_share, self.grip_effort = speed_share, grip_effort

    @cached_property
    def step(self) -> FloatArray:
        """(6,) radians between two targets, with some room."""
        return 1.25 * self.speed_share * FULL_SPEED * PERIOD

    @property
    def percent(self) -> int:
        """The speed as the mode frame carries it."""
        return max(1, round(100 * self.speed_share))
