"""Arms by DH numbers: the URDF that is written means the same links as the numbers do."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gvla2.errors import RobotError
from gvla2.planning.arm import Hand
from gvla2.planning.scene import Box, Scene
from gvla2.robot.arm_model import ArmModel
from gvla2.robot.kinematics import Finger, Kinematics
from gvla2.robot.task import Primitive
from gvla2_plugins.piper.arm import (
    FULL_SPEED,
    HIGH,
    HOME,
    LOW,
    MAX_WIDTH,
    TCP_OFFSET,
    finger_joints,
    make_arm,
    piper_description,
)
from gvla2_plugins.piper.dh import FINGERS, TCP_FRAME, DhArm
from gvla2_plugins.sapien import SapienPiperConfig
from gvla2_plugins.sapien.arm import make_cell
from gvla2_plugins.sapien.urdf import find_file

WORKSPACE = Box(np.array([0.05, -0.45, 0.0]), np.array([0.6, 0.45, 0.6]))


def planar(folder, lengths=(0.3, 0.2)) -> tuple[DhArm, Kinematics]:
    """Two links in a plane, a third joint that turns the hand down; told by other numbers than the Piper's."""
    arm = DhArm(
        name="planar",
        a=(0.0, lengths[0], lengths[1]),
        alpha=(0.0, 0.0, -np.pi / 2),
        theta=(0.0, 0.3, 0.0),
        d=(0.1, 0.0, 0.05),
        low=np.full(3, -2.0),
        high=np.full(3, 2.0),
        speed=np.ones(3),
        max_width=0.06,
        tcp_offset=0.1,
        solids={"link1": (Primitive("sphere", (0.05, 0.05, 0.05), (1, 1, 1)),)},
        resting_pairs=(),
    )
    (folder / "planar.urdf").write_text(arm.urdf())
    fingers = tuple(Finger(f"{name}_joint", 0.0, 0.03) for name in FINGERS)
    kinematics = Kinematics(
        folder / "planar.urdf",
        world_from_base=np.eye(4),
        tcp_frame=TCP_FRAME,
        frame_from_tcp=np.eye(4),
        fingers=fingers,
    )
    return arm, kinematics


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 2**31))
def test_the_urdf_has_the_poses_of_the_numbers(tmp_path_factory, seed):
    arm, kinematics = planar(tmp_path_factory.mktemp("arm"))
    joints = np.random.default_rng(seed).uniform(arm.low, arm.high)
    tcp = arm.link_poses(joints, 0.0)[FINGERS[0]]
    np.testing.assert_allclose(kinematics.forward(joints), tcp, atol=1e-9)


def test_a_planar_arm_is_where_school_geometry_says(tmp_path):
    arm, _ = planar(tmp_path)
    poses = arm.link_poses(np.array([0.4, 0.1, 0.0]), 0.02)
    elbow = 0.3 * np.array([np.cos(0.4), np.sin(0.4)])
    wrist = elbow + 0.2 * np.array([np.cos(0.8), np.sin(0.8)])  # 0.3 of theta is built in
    np.testing.assert_allclose(poses["link2"][:3, 3], [*elbow, 0.1], atol=1e-12)
    np.testing.assert_allclose(poses["link3"][:2, 3], wrist + 0.05 * np.array([-np.sin(0.8), np.cos(0.8)]))
    apart = poses[FINGERS[0]][:3, 3] - poses[FINGERS[1]][:3, 3]
    assert np.linalg.norm(apart) == pytest.approx(0.02)


def test_the_fingers_move_as_one_and_resting_pairs_are_named():
    description = piper_description()
    assert '<mimic joint="finger_left_joint" />' in description.urdf()
    assert '<disable_collisions link1="link5" link2="link6" reason="Adjacent" />' in description.srdf()
    with pytest.raises(RobotError, match="home joints"):
        make_arm(np.eye(4), WORKSPACE, limit_margin=1.0)


def test_the_pipers_model_has_its_limits_and_speeds():
    arm = make_arm(np.eye(4), WORKSPACE)
    assert isinstance(arm, ArmModel)
    assert isinstance(arm.hand, Hand)
    low, high = arm.limits
    np.testing.assert_allclose((low, high), (LOW + 0.02, HIGH - 0.02))
    np.testing.assert_allclose(arm.velocity_limits, FULL_SPEED)
    assert sum(f.opened for f in finger_joints()) == pytest.approx(MAX_WIDTH)


def test_the_block_under_the_simulated_base_is_in_the_way():
    folded_down = np.array([0.0, 2.9, -0.4, 0.0, 0.0, 0.0])  # over the edge of the base, before the block
    for arm, free in ((make_arm(np.eye(4), WORKSPACE), True), (make_cell(SapienPiperConfig()).arm, False)):
        assert (arm.clearance(folded_down, 1.0, Scene((), -2.0, WORKSPACE)).distance > 0) == free


def test_the_flange_is_tcp_offset_behind_the_fingertips():
    description = piper_description()
    poses = description.link_poses(np.array(HOME), 0.0)
    np.testing.assert_allclose(
        poses[FINGERS[0]][:3, 3] - poses["link6"][:3, 3], TCP_OFFSET * poses["link6"][:3, 2], atol=1e-12
    )


@pytest.mark.parametrize("kind", ["urdf", "srdf"])
def test_the_simulated_arm_is_the_same_one(kind):
    """`plugins/sapien/piper.*` are written from :mod:`gvla2_plugins.piper.arm`: write them anew when that changes."""
    description = piper_description(stand=SapienPiperConfig().base_position[2])
    written = find_file(getattr(SapienPiperConfig(), kind), f"robot.{kind}").read_text()
    assert written == (description.urdf() if kind == "urdf" else description.srdf())
