"""Hands: one mounted on an arm without fingers, or the arm's own, measured from its geometry."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from gvla2.errors import RobotError
from gvla2.geometry.transform import FloatArray, invert_rigid, rigid, transform_points
from gvla2.geometry.urdf_files import link_of, numbers
from gvla2.robot.kinematics import Finger, Kinematics
from gvla2.robot.options import ArmConfig

PALM, FINGERS = "gripper_palm", ("gripper_left", "gripper_right")
_PALM_SIZE, _FINGER_SIZE, _TRAVEL = (0.064, 0.12, 0.06), (0.022, 0.013, 0.05), 0.0425

TIP_BEYOND_TCP = 0.008
"""Default distance of the tool point from the fingertips' end, metres."""

_PAD = 0.02
"""The end of a finger, metres, used to measure its thickness and the gap: it is wider above."""


@dataclass(frozen=True)
class Gripper:
    """A hand on an arm: its joints and links; ``palm`` carries the fingers."""

    palm: str
    fingers: tuple[Finger, ...]
    finger_links: tuple[str, ...]

    @property
    def links(self) -> tuple[str, ...]:
        """All of it."""
        return (self.palm, *self.finger_links)


def mount(robot: ET.Element, config: ArmConfig) -> Gripper:
    """Add a parallel gripper at the tool link, along its z as ``tool_rpy`` turns it."""
    frame = f'<parent link="{config.tool_link}"/><origin rpy="{" ".join(map(str, config.tool_rpy))}"/>'
    _add(robot, PALM, "fixed", frame, _box(_PALM_SIZE), 0.5 * _PALM_SIZE[2])
    for link, sign in zip(FINGERS, (1, -1), strict=True):
        at = f'<parent link="{PALM}"/><origin xyz="0 {sign * 0.5 * _FINGER_SIZE[1]} {_PALM_SIZE[2]}"/>'
        at += f'<axis xyz="0 {sign} 0"/><limit lower="0" upper="{_TRAVEL}" velocity="0.1" effort="100"/>'
        _add(robot, link, "prismatic", at, _box(_FINGER_SIZE), 0.5 * _FINGER_SIZE[2])
    return Gripper(PALM, tuple(Finger(f"{link}_joint", 0.0, _TRAVEL) for link in FINGERS), FINGERS)


def own_gripper(robot: ET.Element, config: ArmConfig) -> Gripper:
    """The arm's own fingers: two sliding joints, those that ``mimic`` a named one among them.

    Raises :class:`RobotError` for joints that don't exist, don't slide, or number other than two.
    """
    joints = {j.get("name", ""): j for j in robot.iterfind("joint")}
    asked = list(config.gripper_joints)
    for name in asked:
        known("robot.gripper_joints", name, joints)
    followers = {name: mimic.get("joint") for name, j in joints.items() for mimic in j.iterfind("mimic")}
    asked += [name for name, leader in followers.items() if leader in asked and name not in asked]
    kinds = {name: joints[name].get("type") for name in asked}
    if set(kinds.values()) != {"prismatic"} or len(asked) != 2:
        sliding = [name for name, joint in joints.items() if joint.get("type") == "prismatic"]
        raise RobotError(
            "robot.gripper_joints must be two prismatic joints, one a finger, got "
            f"{', '.join(f'{name} ({kind})' for name, kind in kinds.items())}. This arm has {sliding or 'none'}. "
            "Without its own fingers (robot.gripper_joints=[]) a gripper is mounted at the tool link."
        )
    fingers = []
    for name in asked:
        limit = joints[name].find("limit")
        ends = [float(numbers(limit, k, (0.0,))[0]) for k in ("lower", "upper")]
        fingers.append(Finger(name, *ends))
    palm, *others = {link_of(joints[name], "parent") for name in asked}
    if others:
        raise RobotError(
            f"The fingers {asked} hang on different links, {sorted([palm, *others])}; one must carry both."
        )
    return Gripper(palm, tuple(fingers), tuple(link_of(joints[name], "child") for name in asked))


def known(option: str, asked: str, names: Mapping[str, object] | Sequence[str]) -> None:
    """Raises :class:`RobotError` listing the existing names if ``asked`` is not among them."""
    if asked not in names:
        raise RobotError(f"{option}={asked or chr(39) * 2} is not in the URDF. It has: {', '.join(names)}.")


def measured(
    kinematics: Kinematics, gripper: Gripper, vertices: Mapping[str, FloatArray]
) -> tuple[Gripper, FloatArray, dict[str, float]]:
    """Which end of the fingers' joints is open, tool_from_tips (4, 4), and the hand's measures by their names.

    ``kinematics`` has its tool at the tool link, z out of the hand; ``vertices`` (N, 3) of each link in its own frame.
    The tips' frame is between the fingers' ends, turned about z until the first finger opens along y. Raises
    :class:`RobotError` for fingers that don't open, or don't open across z.
    """
    low, high = (_in_tool(kinematics, gripper, vertices, share) for share in (0.0, 1.0))
    left, right = gripper.finger_links
    apart = [np.linalg.norm(at[left].mean(axis=0) - at[right].mean(axis=0)) for at in (low, high)]
    if abs(apart[1] - apart[0]) < 1e-3:
        limits = {finger.joint: (finger.closed, finger.opened) for finger in gripper.fingers}
        raise RobotError(
            f"The gripper cannot open: over the whole range {limits} m of its joints their fingers stay as far apart. "
            "Correct the joints' limits or axes in the URDF, or name other joints."
        )
    if apart[1] < apart[0]:
        low, high = high, low
        flipped = tuple(Finger(f.joint, f.opened, f.closed) for f in gripper.fingers)
        gripper = replace(gripper, fingers=flipped)
    moved = [high[link].mean(axis=0) - low[link].mean(axis=0) for link in (left, right)]
    way = moved[0] / np.linalg.norm(moved[0])
    if abs(way[2]) > 0.2:
        raise RobotError(
            f"The fingers of robot.tool_link slide along {np.round(way, 2).tolist()} of it; z must point out of the "
            "hand and the fingers slide across. robot.tool_rpy=[roll,pitch,yaw] (radians) turns the frame."
        )
    yaw = float(np.arctan2(-way[0], way[1]))
    turn = rigid(Rotation.from_euler("z", yaw if abs(yaw) > 1e-6 else 0.0).as_matrix())
    opened = {link: transform_points(invert_rigid(turn), points) for link, points in high.items()}
    end = max(opened[link][:, 2].max() for link in (left, right))
    pads = [opened[link][opened[link][:, 2] > end - _PAD] for link in (left, right)]
    inner, outer, body = pads[0][:, 1].min(), pads[1][:, 1].max(), opened[gripper.palm]
    between = (np.mean([pad[:, 0].mean() for pad in pads]), 0.5 * (inner + outer), end)
    hand = {
        "max_width": max(inner - outer, sum(np.linalg.norm(m) for m in moved)),
        "finger_length": end - min(body[:, 2].max(), end - _PAD),
        "finger_thickness": max(np.ptp(pad[:, 1]) for pad in pads),
        "finger_breadth": max(np.ptp(pad[:, 0]) for pad in pads),
        "palm_breadth": np.ptp(body[:, 1]),
        "palm_depth": np.ptp(body[:, 0]),
    }
    return gripper, turn @ rigid(translation=between), {name: float(size) for name, size in hand.items()}


def _in_tool(
    kinematics: Kinematics, gripper: Gripper, vertices: Mapping[str, FloatArray], share: float
) -> dict[str, FloatArray]:
    """The hand's corners in the tool's frame, its joints at ``share`` of their way from lower to upper limit."""
    joints = 0.5 * (kinematics.low + kinematics.high)
    poses = kinematics.link_poses(joints, share)
    tool_from_world = invert_rigid(kinematics.forward(joints))
    return {link: transform_points(tool_from_world @ poses[link], vertices[link]) for link in gripper.links}


def _add(robot: ET.Element, link: str, kind: str, joint: str, shape: str, height: float) -> None:
    solid = f'<collision><origin xyz="0 0 {height}"/><geometry>{shape}</geometry></collision>'
    robot.append(ET.fromstring(f'<link name="{link}">{solid}</link>'))
    robot.append(
        ET.fromstring(f'<joint name="{link}_joint" type="{kind}"><child link="{link}"/>{joint}</joint>')
    )


def _box(size: Sequence[float]) -> str:
    return f'<box size="{" ".join(map(str, size))}"/>'
