"""The Piper's URDF, written from its DH facts, and the arm that planning sees."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np

from gvla2.geometry.transform import FloatArray
from gvla2.planning.arm import Hand
from gvla2.planning.scene import Box
from gvla2.robot.arm_model import ArmModel
from gvla2.robot.kinematics import Finger
from gvla2_plugins.piper import shape
from gvla2_plugins.piper.limits import FULL_SPEED, HIGH, LOW, MAX_WIDTH

HOME = (0.0, 1.35, -1.0, 0.0, 1.0, 0.0)
"""Where plans like to be, radians: the hand in front of the base, looking down."""

TCP_OFFSET = 0.1358
"""From the flange (the SDK's end pose) to between the fingertips, metres; measure yours and set robot.tcp_offset."""

TCP_FRAME = "tcp"


def urdf_text(tcp_offset: float = TCP_OFFSET) -> str:
    """The URDF: six revolute joints, two prismatic fingers, a frame ``tcp``; cylinders and boxes for links."""
    robot = ET.Element("robot", name="piper")
    solids = shape.solids(tcp_offset)
    for name in ("base_link", *(f"link{i}" for i in range(1, 7)), *shape.FINGERS, TCP_FRAME):
        link = ET.SubElement(robot, "link", name=name)
        for what in ("collision", "visual"):
            for solid in (s for s in solids if s.link == name):
                element = ET.SubElement(link, what)
                _origin(element, solid.link_from_solid)
                geometry = ET.SubElement(element, "geometry")
                if solid.kind == "box":
                    ET.SubElement(geometry, "box", size=_numbers(solid.size))
                else:
                    ET.SubElement(
                        geometry, "cylinder", radius=repr(0.5 * solid.size[0]), length=repr(solid.size[2])
                    )
    before = "base_link"
    for index in range(6):
        joint = _joint(robot, f"joint{index + 1}", "revolute", before, f"link{index + 1}")
        _origin(joint, shape.dh_origin(index))
        ET.SubElement(joint, "axis", xyz="0 0 1")
        _limit(joint, LOW[index], HIGH[index], FULL_SPEED[index], 100.0)
        before = f"link{index + 1}"
    for name, sign in zip(shape.FINGERS, (1, -1), strict=True):
        joint = _joint(robot, f"{name}_joint", "prismatic", "link6", name)
        ET.SubElement(joint, "origin", xyz=_numbers((0.0, 0.0, tcp_offset)), rpy="0 0 0")
        ET.SubElement(joint, "axis", xyz=f"0 {sign} 0")
        _limit(joint, 0.0, 0.5 * MAX_WIDTH, 0.1, 10.0)
    tcp = _joint(robot, "tcp_joint", "fixed", "link6", TCP_FRAME)
    ET.SubElement(tcp, "origin", xyz=_numbers((0.0, 0.0, tcp_offset)), rpy="0 0 0")
    ET.indent(robot)
    return ET.tostring(robot, encoding="unicode") + "\n"


def srdf_text() -> str:
    """The SRDF: pairs of links whose nearness is no collision."""
    robot = ET.Element("robot", name="piper")
    for one, other in shape.RESTING_PAIRS:
        ET.SubElement(robot, "disable_collisions", link1=one, link2=other, reason="Adjacent")
    ET.indent(robot)
    return ET.tostring(robot, encoding="unicode") + "\n"


def make_arm(
    world_from_base: FloatArray, workspace: Box, tcp_offset: float = TCP_OFFSET, limit_margin: float = 0.02
) -> ArmModel:
    """The Piper at its place in the world; ``limit_margin`` radians are kept to each joint limit."""
    hand = Hand(
        max_width=MAX_WIDTH,
        finger_length=shape.FINGER_LENGTH,
        finger_thickness=shape.FINGER_THICKNESS,
        finger_breadth=shape.FINGER_BREADTH,
        tip_beyond_tcp=shape.TIP_BEYOND_TCP,
        palm_breadth=shape.PALM_BREADTH,
        palm_depth=shape.PALM_DEPTH,
    )
    with tempfile.TemporaryDirectory(prefix="gvla2-piper-") as folder:
        urdf, srdf = Path(folder) / "piper.urdf", Path(folder) / "piper.srdf"
        urdf.write_text(urdf_text(tcp_offset))
        srdf.write_text(srdf_text())
        return ArmModel.from_urdf(
            urdf,
            (),
            world_from_base=world_from_base,
            tcp_frame=TCP_FRAME,
            hand=hand,
            home=HOME,
            workspace=workspace,
            hand_links=("link6", *shape.FINGERS),
            fingers=tuple(Finger(f"{name}_joint", 0.0, 0.5 * MAX_WIDTH) for name in shape.FINGERS),
            srdf=srdf,
            limit_margin=limit_margin,
        )


def _joint(robot: ET.Element, name: str, kind: str, parent: str, child: str) -> ET.Element:
    joint = ET.SubElement(robot, "joint", name=name, type=kind)
    ET.SubElement(joint, "parent", link=parent)
    ET.SubElement(joint, "child", link=child)
    return joint


def _limit(joint: ET.Element, low: float, high: float, speed: float, effort: float) -> None:
    values = {"lower": low, "upper": high, "velocity": speed, "effort": effort}
    ET.SubElement(joint, "limit", {key: repr(float(value)) for key, value in values.items()})


def _origin(parent: ET.Element, pose: FloatArray) -> None:
    ET.SubElement(parent, "origin", xyz=_numbers(pose[:3, 3]), rpy=_numbers(_roll_pitch_yaw(pose[:3, :3])))


def _roll_pitch_yaw(rotation: FloatArray) -> tuple[float, float, float]:
    """A URDF's angles, fixed axes x, y, z; at a pitch of 90 degrees yaw is set to 0, as any pair would do."""
    level = float(np.hypot(rotation[0, 0], rotation[1, 0]))
    pitch = float(np.arctan2(-rotation[2, 0], level))
    if level < 1e-12:
        return float(np.arctan2(-rotation[1, 2], rotation[1, 1])), pitch, 0.0
    roll = float(np.arctan2(rotation[2, 1], rotation[2, 2]))
    return roll, pitch, float(np.arctan2(rotation[1, 0], rotation[0, 0]))


def _numbers(values: Sequence[float] | FloatArray) -> str:
    return " ".join(repr(float(value)) for value in values)
