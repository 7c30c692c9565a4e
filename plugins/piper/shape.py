"""The Piper's kinematics as facts, and its links as simple solids.

The DH numbers are the maker's (modified convention, joints 2 and 3 shifted by 2 degrees as current firmware has
it). The solids are cylinders and boxes drawn a little larger than the real links; they are ours.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from gvla2.geometry.transform import FloatArray, rigid

DH_A = (0.0, 0.0, 0.28503, -0.02198, 0.0, 0.0)
DH_ALPHA = tuple(np.radians((0.0, -90.0, 0.0, 90.0, -90.0, 90.0)).tolist())
DH_THETA = tuple(np.radians((0.0, -172.22, -102.78, 0.0, 0.0, 0.0)).tolist())
DH_D = (0.123, 0.0, 0.0, 0.25075, 0.0, 0.091)
"""Metres and radians; link i's transform is RotX(alpha) TransX(a) RotZ(q + theta) TransZ(d) (Craig)."""

FINGER_LENGTH, FINGER_THICKNESS, FINGER_BREADTH = 0.055, 0.012, 0.022
TIP_BEYOND_TCP = 0.008
PALM_BREADTH, PALM_DEPTH = 0.11, 0.064
FINGERS = ("finger_left", "finger_right")


@dataclass(frozen=True)
class Solid:
    """``size``: box (x, y, z) full lengths; cylinder (diameter, diameter, length) along z; in the link's frame."""

    link: str
    kind: Literal["box", "cylinder"]
    size: tuple[float, float, float]
    link_from_solid: FloatArray


def dh_origin(index: int) -> FloatArray:
    """(4, 4) of joint ``index``'s frame in the frame before it, at angle zero."""
    alpha, theta = DH_ALPHA[index], DH_THETA[index]
    turn_x = np.array(
        [[1, 0, 0], [0, np.cos(alpha), -np.sin(alpha)], [0, np.sin(alpha), np.cos(alpha)]], dtype=np.float64
    )
    return rigid(turn_x @ turn_z(theta), turn_x @ [DH_A[index], 0.0, DH_D[index]])


def turn_z(angle: float) -> FloatArray:
    """(3, 3) rotation about z."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def link_poses(joints: FloatArray, width: float, tcp_offset: float) -> dict[str, FloatArray]:
    """base_from_link (4, 4) of all links at joints (6,) and a gripper opening in metres."""
    pose = np.eye(4)
    poses = {"base_link": pose}
    for index in range(6):
        pose = pose @ dh_origin(index) @ rigid(turn_z(float(joints[index])))
        poses[f"link{index + 1}"] = pose
    for name, sign in zip(FINGERS, (1.0, -1.0), strict=True):
        poses[name] = pose @ rigid(translation=(0.0, sign * 0.5 * width, tcp_offset))
    return poses


def solids(tcp_offset: float) -> list[Solid]:
    """All links' solids, for fingertips ``tcp_offset`` metres beyond the flange."""
    along_x = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])  # turns z into x
    along_y = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])  # turns z into y
    palm_end = tcp_offset + TIP_BEYOND_TCP - FINGER_LENGTH
    finger = (FINGER_BREADTH, FINGER_THICKNESS, FINGER_LENGTH)
    finger_z = TIP_BEYOND_TCP - 0.5 * FINGER_LENGTH
    half = 0.5 * FINGER_THICKNESS
    return [
        Solid("base_link", "cylinder", (0.12, 0.12, 0.09), rigid(translation=(0.0, 0.0, 0.045))),
        Solid("link1", "cylinder", (0.08, 0.08, 0.07), rigid(translation=(0.0, 0.0, -0.015))),
        Solid("link2", "cylinder", (0.06, 0.06, 0.285), rigid(along_x, (0.1425, 0.0, 0.0))),
        Solid("link3", "cylinder", (0.055, 0.055, 0.13), rigid(along_y, (-0.022, -0.065, 0.0))),
        Solid("link4", "cylinder", (0.055, 0.055, 0.13), rigid(translation=(0.0, 0.0, -0.065))),
        Solid("link5", "cylinder", (0.055, 0.055, 0.055), rigid(translation=(0.0, 0.0, 0.0))),
        Solid("link6", "cylinder", (0.06, 0.06, 0.03), rigid(translation=(0.0, 0.0, -0.015))),
        Solid(
            "link6",
            "box",
            (PALM_DEPTH, PALM_BREADTH, palm_end),
            rigid(translation=(0.0, 0.0, 0.5 * palm_end)),
        ),
        Solid(FINGERS[0], "box", finger, rigid(translation=(0.0, half, finger_z))),
        Solid(FINGERS[1], "box", finger, rigid(translation=(0.0, -half, finger_z))),
    ]


RESTING_PAIRS = (
    ("base_link", "link1"),
    ("base_link", "link2"),
    ("base_link", "link3"),
    ("link1", "link2"),
    ("link1", "link3"),
    ("link1", "link4"),
    ("link2", "link3"),
    ("link2", "link4"),
    ("link3", "link4"),
    ("link3", "link5"),
    ("link4", "link5"),
    ("link4", "link6"),
    ("link5", "link6"),
    ("link6", FINGERS[0]),
    ("link6", FINGERS[1]),
    (FINGERS[0], FINGERS[1]),
)
"""Links that are joined, or lie side by side when the arm is folded up: their nearness is no collision."""
