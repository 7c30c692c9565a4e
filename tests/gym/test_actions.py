"""Actions to poses and back."""

from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from gvla2.errors import RobotError
from gvla2.geometry.transform import check_rigid, rigid
from gvla2.gym.actions import WaypointActions
from gvla2.planning.scene import Box

WORKSPACE = Box(np.array([-0.3, -0.6, 0.75]), np.array([0.8, 0.6, 1.75]))
ACTIONS = WaypointActions(SimpleNamespace(arm=SimpleNamespace(workspace=WORKSPACE)), 0.2)
BOUNDS = ACTIONS.space.low, ACTIONS.space.high
DOWN = np.array([0.0, 0.0, -1.0])
share = st.floats(0.0, 1.0)


@given(st.tuples(*[st.floats(float(low), float(high)) for low, high in zip(*BOUNDS, strict=True)]))
def test_every_action_is_a_pose_in_the_workspace(numbers):
    pose, gripper = ACTIONS.pose(numbers)
    check_rigid(pose, tolerance=1e-9)
    assert WORKSPACE.contains(pose[:3, 3], -1e-9)
    assert 0 <= gripper <= 1


@given(st.tuples(share, share, share), st.integers(0, 2**32 - 1), share)
def test_a_pose_comes_back(shares, seed, gripper):
    box = WORKSPACE
    turn = Rotation.random(random_state=np.random.RandomState(seed)).as_matrix()
    pose = rigid(turn, box.low + np.array(shares) * (box.high - box.low))
    action = ACTIONS.action(pose, gripper)
    assert action.dtype == np.float32
    again, opening = ACTIONS.pose(action)
    np.testing.assert_allclose(again, pose, atol=2e-6)
    assert opening == pytest.approx(gripper, abs=1e-7)


def test_what_the_numbers_mean():
    pose, gripper = ACTIONS.pose([0, 0, -1, 0, 0, 0, 1])
    np.testing.assert_allclose(pose[:3, 3], (0.25, 0.0, 0.75))
    np.testing.assert_allclose(pose[:3, :3], np.diag([1.0, -1.0, -1.0]))
    assert gripper == 1.0
    quarter, _ = ACTIONS.pose([0, 0, -1, 0, 0, 0.5, 1])
    np.testing.assert_allclose(quarter[:3, 2], DOWN, atol=1e-12)
    np.testing.assert_allclose(quarter[:3, 0], (0.0, 1.0, 0.0), atol=1e-12)  # from forward to the left
    tilted, _ = ACTIONS.pose([0, 0, -1, 0, -0.5, 0, 1])
    np.testing.assert_allclose(tilted[:3, 2], (1.0, 0.0, 0.0), atol=1e-12)  # forward


@pytest.mark.parametrize("bad", [[0] * 6, [0, 0, 0, 0, 0, np.nan, 0], [[0] * 7], [np.inf] * 7])
def test_an_action_of_another_shape_or_not_finite_is_refused(bad):
    with pytest.raises(RobotError, match="7 finite numbers"):
        ACTIONS.pose(bad)


def test_a_pose_outside_the_workspace_has_no_action():
    with pytest.raises(RobotError, match="outside the workspace"):
        ACTIONS.action(rigid(translation=(2.0, 0.0, 1.0)), 1.0)
