"""Nothing wrong is sent to an arm."""

from dataclasses import replace

import numpy as np
import pytest

from gvla2.errors import RobotError
from gvla2.planning.trajectory import Orientation, Trajectory, Waypoint
from gvla2.robot.executor import check_samples, check_trajectory

GOOD = Waypoint((0.3, 0.0, 0.9), 1.0, "approach")
LIMITS = (np.full(3, -1.0), np.full(3, 1.0))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"xyz": (0.3, float("nan"), 0.9)}, "not finite"),
        ({"gripper": 1.2}, "gripper"),
        ({"speed": 0.0}, "speed"),
        ({"tolerance": -0.1}, "tolerance"),
        ({"carries": "ghost"}, "ghost"),
        ({"orientation": Orientation("axis", (0.0, 0.0, 0.0))}, "vector"),
        ({"orientation": Orientation("grasp", (0.0, 0.0, -1.0), (0.0, 0.0, 1.0))}, "orientation"),
    ],
)
def test_bad_waypoints_are_named(scene_of, block, change, message):
    trajectory = Trajectory((GOOD, replace(GOOD, stage="second", **change)))
    with pytest.raises(RobotError, match=message):
        check_trajectory(trajectory, scene_of(block()), np.eye(4))


def check(samples, measured=(0.0, 0.0, 0.0)):
    check_samples(np.array(samples, dtype=float), 0.1, np.array(measured), LIMITS, np.full(3, 2.0))


@pytest.mark.parametrize(
    ("samples", "measured", "message"),
    [
        ([[0, 0, np.nan]], (0, 0, 0), "finite"),
        ([[0, 0, 0]], (0, np.inf, 0), "finite"),
        ([[0, 0, 0], [0, 0.1, 0], [0, 0.2, 1.1]], (0, 0, 0), "Joint 3"),
        ([[0, 0, 0], [0, 0.5, 0]], (0, 0, 0), "Joint 2 would jump"),
        ([[0.1, 0, 0]], (0, 0, 0), "starts"),
        ([[0, 0]], (0, 0, 0), r"\(T, 3\)"),
    ],
)
def test_bad_samples_are_refused(samples, measured, message):
    with pytest.raises(RobotError, match=message):
        check(samples, measured)
