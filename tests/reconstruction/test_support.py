from dataclasses import replace

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.ndimage import map_coordinates

from gvla2.errors import GeometryError
from gvla2.geometry.camera import Camera
from gvla2.geometry.views import View, Views
from gvla2.reconstruction.support import mask_support, object_centre, soft_hull


@pytest.fixture(scope="module")
def views(jug, masked_views) -> Views:
    sharp = masked_views(jug, size=64)
    rng = np.random.default_rng(0)
    # Soft masks: bilinear sampling shows everywhere.
    return Views(tuple(replace(v, mask=rng.uniform(0, 1, v.mask.shape).astype(np.float32)) for v in sharp))


def one_view(mask: np.ndarray, pose: np.ndarray | None = None) -> Views:
    """A camera at the origin that looks along z, focal length 10 px."""
    height, width = mask.shape
    K = np.array([[10.0, 0, width / 2], [0, 10.0, height / 2], [0, 0, 1]])
    camera = Camera(K, np.eye(4) if pose is None else pose, width, height, "only")
    return Views((View(camera, np.zeros((height, width, 3), np.uint8), mask=mask.astype(np.float32)),))


def reference(points: np.ndarray, views: Views) -> np.ndarray:
    """The paper's s(p) with scipy's bilinear sampling."""
    total, seen = np.zeros(len(points)), np.zeros(len(points))
    for view in views:
        uv, _ = view.camera.project(points)
        inside = view.camera.inside(uv)
        rows_columns = (uv[inside] - 0.5).T[::-1]
        total[inside] += map_coordinates(view.mask.astype(float), rows_columns, order=1, mode="nearest")
        seen += inside
    return total / np.maximum(seen, 1)


def test_equals_the_papers_formula(views):
    points = np.random.default_rng(1).uniform(-1.5, 1.5, (3000, 3))
    got = mask_support(points, views)
    assert got.shape == (3000,)
    np.testing.assert_allclose(got, reference(points, views), atol=1e-6)
    assert 0.1 < got.mean() < 0.9


def test_samples_at_pixel_centres():
    mask = np.zeros((8, 8))
    mask[3, 5] = 1.0
    # Pixel (column 5, row 3) has its centre at (5.5, 3.5): x = 1.5 / 10, y = -0.5 / 10 at depth 1.
    at = np.array([[0.15, -0.05, 1.0], [0.20, -0.05, 1.0], [0.25, -0.05, 1.0]])
    np.testing.assert_allclose(mask_support(at, one_view(mask)), [1.0, 0.5, 0.0], atol=1e-6)


def test_points_behind_outside_and_not_finite_have_none():
    points = np.array([[0, 0, -1.0], [5.0, 0, 1.0], [np.nan, 0, 1.0], [np.inf, 0, 1.0], [0, 0, 1.0]])
    assert mask_support(points, one_view(np.ones((8, 8)))).tolist() == [0, 0, 0, 0, 1]


def test_surface_of_the_true_shape_is_supported(masked_views):
    ball = trimesh.creation.icosphere(subdivisions=4, radius=0.4)
    views = masked_views(ball)
    assert mask_support(0.95 * ball.vertices, views).min() == 1.0
    assert mask_support(1.5 * ball.vertices, views).mean() < 0.8


def test_errors_name_the_view_and_the_fault(views):
    bare = Views((views[0], replace(views[1], mask=None)))
    with pytest.raises(GeometryError, match="'view1' has no mask"):
        mask_support(np.zeros((1, 3)), bare)
    with pytest.raises(GeometryError, match=r"'view0'.*\[0, 1\]"):
        mask_support(np.zeros((1, 3)), Views((replace(views[0], mask=views[0].mask * 255),)))
    with pytest.raises(GeometryError, match="'view0'"):
        mask_support(np.zeros((1, 3)), Views((replace(views[0], mask=views[0].mask * np.nan),)))
    with pytest.raises(GeometryError, match=r"\(N, 3\)"):
        mask_support(np.zeros((3, 2)), views)


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
        ({"support": np.ones(3)}, "support must be"),
        ({"support": np.full(4, 1.5)}, r"\[0, 1\]"),
        ({"support": np.full(4, np.nan)}, r"\[0, 1\]"),
        ({"eta": 0.0}, "eta"),
        ({"lambda_max": 1.5}, "lambda_max"),
        ({"centre": [0, 0]}, "centre"),
    ],
)
def test_what_cannot_be_shrunk(arguments, words):
    with pytest.raises(GeometryError, match=words):
        soft_hull(**{"points": np.ones((4, 3)), "support": np.ones(4), **arguments})
