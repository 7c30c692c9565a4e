"""Arms from modified Denavit-Hartenberg parameters: their links' poses, and a URDF written from them.

For arms whose maker gives numbers rather than a description: six numbers per joint and some solids become a model for
kinematics, collision checks and simulators.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from xml.etree import ElementTree as ET

import numpy as np

from gvla2.geometry.transform import FloatArray, rigid
from gvla2.robot.task import Primitive

BASE_LINK, TCP_FRAME = "base_link", "tcp"
FINGERS = ("finger_left", "finger_right")
"""Links of the two fingers: they open along +y and -y of the last link, by joints named ``<link>_joint``."""


@dataclass(frozen=True)
class DhArm:
    """A chain of N revolute joints and a parallel gripper, metres and radians.

    Link i's transform is RotX(alpha) TransX(a) RotZ(q + theta) TransZ(d) (Craig). ``low``, ``high`` and ``speed`` (N,)
    are the joints' limits; ``max_width`` between the opened fingers, which are ``tcp_offset`` beyond the last link's
    frame, along its z. ``solids`` are each link's solids, in its frame; ``resting_pairs`` links whose nearness is not a
    collision.
    """

    name: str
    a: tuple[float, ...]
    alpha: tuple[float, ...]
    theta: tuple[float, ...]
    d: tuple[float, ...]
    low: FloatArray
    high: FloatArray
    speed: FloatArray
    max_width: float
    tcp_offset: float
    solids: Mapping[str, tuple[Primitive, ...]]
    resting_pairs: tuple[tuple[str, str], ...]

    @property
    def dof(self) -> int:
        """Number of joints, fingers left out."""
        return len(self.a)

    @property
    def links(self) -> tuple[str, ...]:
        """Names: the base, one link per joint, the fingers."""
        return (BASE_LINK, *(f"link{i + 1}" for i in range(self.dof)), *FINGERS)

    @property
    def last_link(self) -> str:
        """The link that carries the gripper."""
        return f"link{self.dof}"

    def joint_origin(self, index: int) -> FloatArray:
        """(4, 4) of joint ``index``'s frame in the frame before it, at angle zero."""
        turn_x = _turn_x(self.alpha[index])
        return rigid(turn_x @ turn_z(self.theta[index]), turn_x @ [self.a[index], 0.0, self.d[index]])

    def link_poses(self, joints: FloatArray, width: float) -> dict[str, FloatArray]:
        """base_from_link (4, 4) of all links at joints (N,) and a gripper opening in metres."""
        pose = np.eye(4)
        poses = {BASE_LINK: pose}
        for index in range(self.dof):
            pose = pose @ self.joint_origin(index) @ rigid(turn_z(float(joints[index])))
            poses[f"link{index + 1}"] = pose
        for name, sign in zip(FINGERS, (1.0, -1.0), strict=True):
            poses[name] = pose @ rigid(translation=(0.0, sign * 0.5 * width, self.tcp_offset))
        return poses

    def urdf(self) -> str:
        """The URDF: revolute joints, two prismatic fingers that move as one, a frame ``tcp``; the solids as links."""
        robot = ET.Element("robot", name=self.name)
        for name in (*self.links, TCP_FRAME):
            link = ET.SubElement(robot, "link", name=name)
            for what in ("collision", "visual"):
                for solid in self.solids.get(name, ()):
                    drawn = ET.SubElement(link, what)
                    _solid(drawn, solid)
                    if what == "visual":
                        paint = ET.SubElement(drawn, "material", name="")
                        ET.SubElement(paint, "color", rgba=f"{_numbers(solid.rgb)} 1.0")
        for index in range(self.dof):
            joint = _joint(robot, f"joint{index + 1}", "revolute", self.links[index], f"link{index + 1}")
            _origin(joint, self.joint_origin(index))
            ET.SubElement(joint, "axis", xyz="0 0 1")
            _limit(joint, self.low[index], self.high[index], self.speed[index], 100.0)
        grip = rigid(translation=(0.0, 0.0, self.tcp_offset))
        for name, sign in zip(FINGERS, (1, -1), strict=True):
            joint = _joint(robot, f"{name}_joint", "prismatic", self.last_link, name)
            _origin(joint, grip)
            ET.SubElement(joint, "axis", xyz=f"0 {sign} 0")
            _limit(joint, 0.0, 0.5 * self.max_width, 0.1, 10.0)
            if sign < 0:
                ET.SubElement(joint, "mimic", joint=f"{FINGERS[0]}_joint")
        _origin(_joint(robot, "tcp_joint", "fixed", self.last_link, TCP_FRAME), grip)
        ET.indent(robot)
        return ET.tostring(robot, encoding="unicode") + "\n"

    def srdf(self) -> str:
        """The SRDF: pairs of links whose nearness is not a collision."""
        robot = ET.Element("robot", name=self.name)
        for one, other in self.resting_pairs:
            ET.SubElement(robot, "disable_collisions", link1=one, link2=other, reason="Adjacent")
        ET.indent(robot)
        return ET.tostring(robot, encoding="unicode") + "\n"


def turn_z(angle: float) -> FloatArray:
    """(3, 3) rotation about z."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def _turn_x(angle: float) -> FloatArray:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])


def _solid(parent: ET.Element, solid: Primitive) -> None:
    _origin(parent, solid.body_from_shape)
    geometry = ET.SubElement(parent, "geometry")
    if solid.kind == "box":
        ET.SubElement(geometry, "box", size=_numbers(solid.size))
    elif solid.kind == "cylinder":
        ET.SubElement(geometry, "cylinder", radius=repr(0.5 * solid.size[0]), length=repr(solid.size[2]))
    else:
        ET.SubElement(geometry, "sphere", radius=repr(0.5 * solid.size[0]))


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
