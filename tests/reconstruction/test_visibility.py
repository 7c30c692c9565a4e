import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gvla2.errors import GeometryError
from gvla2.geometry.camera import Camera
from gvla2.geometry.transform import look_along
from gvla2.reconstruction.visibility import depth_of_points, visible_points


def sphere(count: int, seed: int = 0) -> np.ndarray:
    points = np.random.default_rng(seed).normal(size=(count, 3))
    return points / np.linalg.norm(points, axis=1, keepdims=True)


def camera_at(position, size: int = 64) -> Camera:
    position = np.asarray(position, dtype=float)
    return Camera.from_fov(0.8, look_along(position, -position), size, size)


@given(st.integers(0, 1000))
@settings(max_examples=10, deadline=None)
def test_a_sphere_shows_the_half_that_faces_the_camera(seed):
    direction = sphere(1, seed)[0]
    points, camera = sphere(20_000), camera_at(4 * direction, 256)
    seen = visible_points(points, camera, spacing=0.05, tolerance=0.15)
    # From distance 4 the horizon lies at cosine 1/4; on the slope before it a splat hides its neighbours.
    cosine = points @ direction
    assert seen[cosine > 0.5].all()
    assert seen[cosine < 0.1].mean() < 0.003


def test_depth_is_that_of_the_nearest_point():
    camera = camera_at([0.0, -4.0, 0.0])
    buffer = depth_of_points(sphere(50_000), camera, spacing=0.03)
    assert buffer[32, 32] == pytest.approx(3.0, abs=0.01)
    assert np.isinf(buffer[0, 0])


def test_a_point_covers_more_pixels_when_points_are_few():
    camera = camera_at([0.0, -4.0, 0.0])
    areas = [np.isfinite(depth_of_points(np.zeros((1, 3)), camera, w)).sum() for w in (0.0, 0.2, 0.5)]
    assert areas[0] == 1
    assert areas == sorted(areas)
    assert areas[2] > 9


def test_points_behind_outside_or_not_finite_are_not_seen():
    camera = camera_at([0.0, -4.0, 0.0])
    points = np.array([[0.0, 0, 0], [0, -8, 0], [50, 0, 0], [np.nan, 0, 0], [0, np.inf, 0]])
    assert visible_points(points, camera, 0.01, 0.01).tolist() == [True, False, False, False, False]


def test_malformed_points_are_refused():
    camera = camera_at([0.0, -4.0, 0.0])
    with pytest.raises(GeometryError, match=r"\(N, 3\)"):
        depth_of_points(np.zeros(3), camera, 0.1)
    with pytest.raises(GeometryError, match="spacing"):
        depth_of_points(np.zeros((1, 3)), camera, np.nan)
