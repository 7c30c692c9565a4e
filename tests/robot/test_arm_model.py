"""The arm model: kinematics of the Panda, inverse kinematics, straight lines, other URDFs."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from gvla2.geometry.transform import rigid


def angle_between(a, b):
    return Rotation.from_matrix(a[:3, :3].T @ b[:3, :3]).magnitude()


def test_tool_frame_points_out_of_the_hand_and_along_the_fingers(arm):
    tool = arm.forward(arm.home)
    assert tool[2, 2] < -0.9
    links = [arm.kinematics.link_poses(arm.home, opening) for opening in (0.0, 1.0)]
    tips = [[poses[f"panda_{side}finger"][:3, 3] for side in ("left", "right")] for poses in links]
    travel = tips[1][0] - tips[0][0]
    np.testing.assert_allclose(travel, 0.04 * tool[:3, 1], atol=1e-6)
    middle = 0.5 * (tips[1][0] + tips[1][1])
    np.testing.assert_allclose(np.cross(tool[:3, 3] - middle, tool[:3, 2]), 0.0, atol=1e-6)


def test_inverse_reaches_what_forward_says(arm):
    low, high = arm.limits
    targets = [arm.forward(q) for q in np.random.default_rng(7).uniform(low, high, (150, arm.dof))]
    found = [(target, arm.inverse(target)) for target in targets]
    solved = [(target, s) for target, s in found if s is not None]
    assert len(solved) >= 0.95 * len(found)
    for target, solution in solved:
        reached = arm.forward(solution.joints)
        assert np.linalg.norm(reached[:3, 3] - target[:3, 3]) < 5e-4
        assert angle_between(reached, target) < 5e-3
        assert solution.limit_margin >= 0
        assert ((solution.joints >= low) & (solution.joints <= high)).all()
        margin = np.minimum(solution.joints - low, high - solution.joints).min()
        assert solution.limit_margin == pytest.approx(margin)


@pytest.mark.parametrize("place", [(3.0, 0.0, 1.0), (0.775, 0.655, 0.8), (-0.268, 0.0, 0.8)])
def test_out_of_reach_is_none(arm, down, place):
    assert arm.inverse(down(place)) is None


@given(st.floats(-0.12, 0.12), st.floats(-0.12, 0.12), st.floats(-0.1, 0.12), st.floats(-0.4, 0.4))
@settings(max_examples=15, deadline=None)
def test_a_line_is_straight(arm, x, y, z, turn):
    start = arm.inverse(rigid(Rotation.from_euler("x", np.pi).as_matrix(), (0.3, 0.0, 0.95))).joints
    begin = arm.forward(start)
    target = rigid(Rotation.from_rotvec([0, 0, turn]).as_matrix() @ begin[:3, :3], begin[:3, 3] + [x, y, z])
    path = arm.line(start, target, step=0.01)
    assert path is not None
    np.testing.assert_allclose(path[0], start, atol=1e-9)
    np.testing.assert_allclose(arm.forward(path[-1]), target, atol=1e-3)
    places = arm.tool_positions(np.array(path))
    way = np.array([x, y, z])
    if np.linalg.norm(way) > 1e-3:
        shares = (places - begin[:3, 3]) @ way / (way @ way)
        assert (np.diff(shares) > 0).all()
        np.testing.assert_allclose(places, begin[:3, 3] + shares[:, None] * way, atol=5e-4)
    assert np.abs(np.diff(path, axis=0)).max() < 0.2
    assert len(path) >= np.linalg.norm([x, y, z]) / 0.01
