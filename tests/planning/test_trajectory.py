from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from gvla2.geometry.transform import rigid
from gvla2.planning.trajectory import Guard, Orientation, Trajectory, Waypoint, grasp_rotation

angles = st.floats(-3.0, 3.0)


@given(angles, angles, angles)
def test_a_grasp_points_along_its_approach_and_closes_across_it(a, b, c):
    approach = Rotation.from_euler("xyz", [a, b, c]).apply([0.0, 0.0, 2.0])
    closing = Rotation.from_euler("xyz", [a, b, c]).apply([0.3, 1.0, 0.8])
    R = grasp_rotation(approach, closing)
    np.testing.assert_allclose(R.T @ R, np.eye(3), atol=1e-9)
    assert np.linalg.det(R) == pytest.approx(1.0)
    np.testing.assert_allclose(R[:, 2], approach / np.linalg.norm(approach), atol=1e-9)
    assert R[:, 1] @ closing > 0
    with pytest.raises(ValueError, match="parallel"):
        grasp_rotation(approach, -approach)


def test_policies_follow_from_the_rotation_before():
    start = grasp_rotation(np.array([0.0, 0.0, -1.0]), np.array([0.6, 0.8, 0.0]))
    waypoints = (
        Waypoint((0.0, 0.0, 0.5), 1.0, "a"),
        Waypoint((0.0, 0.0, 0.5), 1.0, "b", Orientation("axis", (1.0, 0.0, 0.0))),
    )
    held, axis = (p[:3, :3] for p in Trajectory(waypoints).poses(rigid(start)))
    np.testing.assert_allclose(held, start)
    np.testing.assert_allclose(axis[:, 2], [1.0, 0.0, 0.0], atol=1e-6)
    assert Rotation.from_matrix(axis @ start.T).magnitude() == pytest.approx(0.5 * np.pi, abs=1e-6), (
        "the least turn"
    )


def test_the_paper_view_and_json_keep_every_number():
    turned = Orientation("grasp", (0.0, 1.0, 0.0), (np.float32(0.25), 0.0, 0.0))
    contacts = frozenset({"b", "a"})
    full = Waypoint(
        (0.1, 0.2, 0.3), 0.5, "press", turned, allowed_contacts=contacts, guard=Guard(12.0), dwell=1.5
    )
    trajectory = Trajectory((full, Waypoint((0.0, 0.0, 1.0), 1.0, "retreat")))
    np.testing.assert_allclose(trajectory.xyzg()[0], [0.1, 0.2, 0.3, 0.5])
    written = trajectory.to_json()
    assert written[0]["allowed_contacts"] == ["a", "b"]
    assert written[0]["guard"] == {"force": 12.0, "stall": 0.0}
    assert (written[0]["orientation"]["closing"], written[0]["dwell"]) == ([0.25, 0.0, 0.0], 1.5)
    assert written[1]["guard"] is None
