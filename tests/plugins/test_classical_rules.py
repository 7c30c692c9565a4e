"""Rules of the classical perceiver, each on what it was made for: sides that nothing shows, thin boards, tilted tables."""

import numpy as np
import pytest

from gvla2_plugins.classical.solids import box_distance, fit_solid


def test_a_side_that_nothing_shows_stays_where_the_seen_points_end():
    """A box against another: noise may not push the hidden side through the neighbour."""
    side, limits = 0.06, ((-10, -10, -10, 0.001, 0.001, 0.02, -0.04), (10, 10, 10, 3, 3, 0.037, -0.02))
    for seed in range(12):
        rng = np.random.default_rng(seed)
        faces = []
        for axis, sign in ((2, 1), (0, 1), (1, 1), (1, -1)):
            face = rng.uniform(-0.5, 0.5, (100, 3))
            face[:, axis] = 0.5 * sign
            faces.append(side * face)
        seen = np.concatenate(faces) + rng.normal(0, 3e-4, (400, 3))
        around = rng.uniform(-0.7, 0.7, (4000, 3)) * side
        free = around[(np.abs(around) > 0.5 * side + 0.001).any(axis=1) & (around[:, 0] > -0.5 * side)]
        start = [0.001, 0.0, 0.01, 0.059, 0.0605, 0.0305, -0.03]
        fit = fit_solid(box_distance, start, seen, free, hold=(-1,), limits=limits)
        assert fit.parameters[3] == pytest.approx(side, abs=0.003)
