"""Time along a path: limits hold, ends are at rest."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gvla2.errors import RobotError
from gvla2.robot.timing import MotionLimits, time_path


def limits(dof, tool=1e3, velocity=1.5, acceleration=5.0):
    return MotionLimits(np.full(dof, velocity), np.full(dof, acceleration), tool)


@given(st.integers(0, 10_000), st.integers(2, 7), st.sampled_from([1 / 240, 1 / 60, 0.03]))
@settings(max_examples=40, deadline=None)
def test_limits_hold_on_any_polyline(seed, points, dt):
    path = np.random.default_rng(seed).uniform(-1.5, 1.5, (points, 4))
    samples = time_path(path, dt, limits(4))
    np.testing.assert_array_equal(samples[0], path[0])
    np.testing.assert_array_equal(samples[-1], path[-1])
    still = np.concatenate([samples[:1], samples, samples[-1:]])
    velocity = np.diff(still, axis=0) / dt
    assert np.abs(velocity).max() <= 1.5 * 1.01
    assert np.abs(np.diff(velocity, axis=0) / dt).max() <= 5.0 * 1.02
    # The samples stay by the polyline: corners are rounded by little.
    dense = np.concatenate([a + (b - a) * np.linspace(0, 1, 200)[:, None] for a, b in pairwise(path)])
    off = np.linalg.norm(samples[:, None] - dense[None], axis=2).min(axis=1)
    assert off.max() < 0.04


@pytest.mark.parametrize(
    ("path", "dt"),
    [([[0.0, np.nan]], 0.01), ([[0.0, 1.0]], 0.0), ([0.0, 1.0], 0.01), (np.zeros((0, 2)), 0.01)],
)
def test_bad_input_is_refused(path, dt):
    with pytest.raises(RobotError):
        time_path(np.array(path), dt, limits(2))
