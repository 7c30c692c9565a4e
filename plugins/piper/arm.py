"""AgileX's Piper as data; `plugins/sapien/piper.urdf` is written from it (a test compares the two).

The DH numbers are the maker's (modified convention, joints 2 and 3 shifted by 2 degrees as current firmware has
it). The solids are cylinders and boxes drawn a little larger than the real links; they are ours.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np

from gvla2.geometry.transform import FloatArray, rigid
from gvla2.planning.arm import Hand
from gvla2.planning.scene import Box
from gvla2.robot.arm_model import ArmModel
from gvla2.robot.collision import CollisionModel
from gvla2.robot.kinematics import Finger, Kinematics
from gvla2.robot.task import Primitive
from gvla2_plugins.piper.dh import BASE_LINK, FINGERS, TCP_FRAME, DhArm

DH_A = (0.0, 0.0, 0.28503, -0.02198, 0.0, 0.0)
DH_ALPHA = tuple(np.radians((0.0, -90.0, 0.0, 90.0, -90.0, 90.0)).tolist())
DH_THETA = tuple(np.radians((0.0, -172.22, -102.78, 0.0, 0.0, 0.0)).tolist())
DH_D = (0.123, 0.0, 0.0, 0.25075, 0.0, 0.091)

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

FINGER_LENGTH, FINGER_THICKNESS, FINGER_BREADTH = 0.055, 0.012, 0.022
TIP_BEYOND_TCP = 0.008
PALM_BREADTH, PALM_DEPTH = 0.11, 0.064
"""Of the gripper's solids, metres."""

ARM_RGB, FINGER_RGB = (0.88, 0.88, 0.90), (0.25, 0.25, 0.28)

STAND_SIDE = 0.16
"""Of the block that the base may stand on, metres."""

RESTING_PAIRS = (
    (BASE_LINK, "link1"),
    (BASE_LINK, "link2"),
    (BASE_LINK, "link3"),
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
    FINGERS,
)
"""Links that are joined, or lie side by side when the arm is folded up."""

HAND = Hand(
    max_width=MAX_WIDTH,
    finger_length=FINGER_LENGTH,
    finger_thickness=FINGER_THICKNESS,
    finger_breadth=FINGER_BREADTH,
    tip_beyond_tcp=TIP_BEYOND_TCP,
    palm_breadth=PALM_BREADTH,
    palm_depth=PALM_DEPTH,
)


def piper_description(tcp_offset: float = TCP_OFFSET, stand: float = 0.0) -> DhArm:
    """The arm with fingertips ``tcp_offset`` metres beyond the flange, on a block ``stand`` metres high."""
    return DhArm(
        name="piper",
        a=DH_A,
        alpha=DH_ALPHA,
        theta=DH_THETA,
        d=DH_D,
        low=LOW,
        high=HIGH,
        speed=FULL_SPEED,
        max_width=MAX_WIDTH,
        tcp_offset=tcp_offset,
        solids=_solids(tcp_offset, stand),
        resting_pairs=RESTING_PAIRS,
    )


def make_arm(
    world_from_base: FloatArray,
    workspace: Box,
    tcp_offset: float = TCP_OFFSET,
    limit_margin: float = 0.02,
) -> ArmModel:
    """The Piper at its place in the world; ``limit_margin`` radians are kept from each joint limit."""
    arm = piper_description(tcp_offset)
    with tempfile.TemporaryDirectory(prefix="gvla2-piper-") as folder:
        urdf, srdf = Path(folder) / "piper.urdf", Path(folder) / "piper.srdf"
        urdf.write_text(arm.urdf())
        srdf.write_text(arm.srdf())
        kinematics = Kinematics(
            urdf,
            world_from_base=world_from_base,
            tcp_frame=TCP_FRAME,
            frame_from_tcp=np.eye(4),
            fingers=finger_joints(),
            limit_margin=limit_margin,
        )
        collisions = CollisionModel(kinematics, urdf, (), hand_links=(arm.last_link, *FINGERS), srdf=srdf)
    return ArmModel(kinematics, collisions, hand=HAND, home=HOME, workspace=workspace)


def finger_joints() -> tuple[Finger, ...]:
    """The fingers' joints and their travel."""
    return tuple(Finger(f"{name}_joint", 0.0, 0.5 * MAX_WIDTH) for name in FINGERS)


def _solids(tcp_offset: float, stand: float) -> dict[str, tuple[Primitive, ...]]:
    along_x = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])  # turns z into x
    along_y = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])  # turns z into y
    palm_end = tcp_offset + TIP_BEYOND_TCP - FINGER_LENGTH
    half, height = 0.5 * FINGER_THICKNESS, TIP_BEYOND_TCP - 0.5 * FINGER_LENGTH
    base = [_round(0.12, 0.09, rigid(translation=(0.0, 0.0, 0.045)))]
    if stand > 0:
        base.append(_box((STAND_SIDE, STAND_SIDE, stand), (0.0, 0.0, -0.5 * stand)))
    fingers = {
        name: (_box((FINGER_BREADTH, FINGER_THICKNESS, FINGER_LENGTH), (0.0, sign * half, height), FINGER_RGB),)
        for name, sign in zip(FINGERS, (1.0, -1.0), strict=True)
    }  # fmt: skip
    return {
        BASE_LINK: tuple(base),
        "link1": (_round(0.08, 0.07, rigid(translation=(0.0, 0.0, -0.015))),),
        "link2": (_round(0.06, 0.285, rigid(along_x, (0.1425, 0.0, 0.0))),),
        "link3": (_round(0.055, 0.13, rigid(along_y, (-0.022, -0.065, 0.0))),),
        "link4": (_round(0.055, 0.13, rigid(translation=(0.0, 0.0, -0.065))),),
        "link5": (_round(0.055, 0.055, np.eye(4)),),
        "link6": (
            _round(0.06, 0.03, rigid(translation=(0.0, 0.0, -0.015))),
            _box((PALM_DEPTH, PALM_BREADTH, palm_end), (0.0, 0.0, 0.5 * palm_end)),
        ),
        **fingers,
    }


def _round(diameter: float, length: float, pose: FloatArray) -> Primitive:
    return Primitive("cylinder", (diameter, diameter, length), ARM_RGB, pose)


def _box(
    size: tuple[float, float, float],
    centre: tuple[float, float, float],
    rgb: tuple[float, float, float] = ARM_RGB,
) -> Primitive:
    return Primitive("box", size, rgb, rigid(translation=centre))
