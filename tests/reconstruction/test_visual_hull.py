import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gvla2.errors import GeometryError
from gvla2.reconstruction.support import object_centre, released_centre, soft_hull


def strength(support, **options):
    """Lambda(p) of points at distance 1 from the centre."""
    out = np.tile([1.0, 0.0, 0.0], (len(support), 1))
    return 1 - soft_hull(out, support, np.zeros(3), **options)[:, 0]


def test_strength_is_the_papers_formula():
    s = np.linspace(0, 1, 11)
    expected = 0.008 * (1 / (1 + np.exp(-(0.45 - s) / 0.12))) ** 2
    np.testing.assert_allclose(strength(s), expected, atol=1e-15)
    assert strength([0.45]).item() == pytest.approx(0.008 / 4)


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**32 - 1), st.floats(0, 1), st.floats(0.01, 1), st.floats(0, 0.5))
def test_points_move_inwards_and_at_most_by_lambda_max(seed, tau, eta, lambda_max):
    rng = np.random.default_rng(seed)
    points, support = rng.normal(size=(50, 3)), rng.uniform(0, 1, 50)
    centre = rng.normal(size=3)
    moved = soft_hull(points, support, centre, tau, eta, lambda_max)
    old, new = np.linalg.norm(points - centre, axis=1), np.linalg.norm(moved - centre, axis=1)
    assert (new <= old * (1 + 1e-12)).all()
    assert (new >= old * (1 - lambda_max) * (1 - 1e-12)).all()
    np.testing.assert_allclose(np.cross(points - centre, moved - centre), 0, atol=1e-9)


def test_one_centre_for_uneven_samplings_of_one_object():
    dense, sparse = np.random.default_rng(0), np.array([[0.0, 0, 0], [1, 1, 1]])
    crowded = np.vstack([sparse, dense.uniform(0, 0.2, (500, 3))])
    np.testing.assert_allclose(object_centre(crowded), object_centre(sparse))


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"support": np.ones(3)}, "4 points but support of shape"),
        ({"support": np.full(4, 1.5)}, r"\[0, 1\]"),
        ({"support": np.full(4, np.nan)}, r"\[0, 1\]"),
        ({"eta": 0.0}, "eta"),
        ({"lambda_max": 1.5}, "lambda_max"),
        ({"centre": [0, 0]}, "centre"),
    ],
)
def test_errors(arguments, words):
    with pytest.raises(GeometryError, match=words):
        soft_hull(**{"points": np.ones((4, 3)), "support": np.ones(4), **arguments})


@pytest.mark.parametrize("lost", [np.nan, np.inf])
def test_points_that_are_not_finite_are_refused(lost):
    points = np.ones((4, 3))
    points[2, 1] = lost
    with pytest.raises(GeometryError, match="not finite"):
        object_centre(points)
    with pytest.raises(GeometryError, match="must be finite"):
        soft_hull(points, np.ones(4), [0, 0, 0])


def test_the_released_centre_is_the_mean_of_each_file():
    points = np.random.default_rng(0).uniform(size=(1000, 3)) ** 3
    single = points.astype(np.float32)
    np.testing.assert_array_equal(released_centre(points), np.mean(single, axis=0).astype(np.float64))
    assert np.abs(released_centre(points) - object_centre(points)).max() > 0.1
