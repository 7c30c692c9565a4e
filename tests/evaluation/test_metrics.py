import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gvla2.errors import GeometryError
from gvla2.evaluation.metrics import (
    Truth,
    cd_official,
    cd_surface,
    chamfer,
    psnr,
    ssim,
    surface_points,
    unit_box,
)
from gvla2.geometry.mesh import TriangleMesh

SQUARE = TriangleMesh(
    np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]), np.array([[0, 1, 2], [0, 2, 3]], dtype=np.int64)
)


def test_chamfer_of_known_points():
    a, b = np.array([[0.0, 0, 0]]), np.array([[0.0, 0, 3], [0, 4, 0]])
    assert chamfer(a, b) == pytest.approx(1000 * (3 + 3.5) / 2)
    assert chamfer(b, b) == 0


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 1000), st.floats(0.01, 0.3))
def test_chamfer_is_symmetric_and_sees_a_shift(seed, shift):
    points = np.random.default_rng(seed).random((50, 3))
    moved = points + np.array([0, 0, 10 * shift])
    assert chamfer(points, moved) == pytest.approx(chamfer(moved, points))
    assert chamfer(points, moved) > 0


def test_surface_distance_sees_scale_that_the_official_one_hides():
    truth = Truth.of(SQUARE, samples=20_000)
    larger = SQUARE.with_vertices(1.1 * SQUARE.vertices + [0, 0, 0.2])
    surface, which = surface_points(larger, None, 20_000)
    assert which == "mesh"
    assert cd_surface(surface, truth) == pytest.approx(200, rel=0.1)
    assert cd_official(larger.vertices, truth) == pytest.approx(0, abs=1e-9)
    same, _ = surface_points(SQUARE, None, 20_000)
    assert cd_surface(same, truth) < 6, "sampling noise only"


def test_what_stands_for_a_surface():
    centres = np.zeros((3, 3))
    assert surface_points(None, centres)[1] == "centres"
    assert len(surface_points(None, centres)[0]) == 3
    with pytest.raises(GeometryError, match="neither"):
        surface_points(None, None)


def test_unit_box():
    boxed = unit_box(np.array([[1.0, 2, 3], [3, 3, 3]]))
    np.testing.assert_allclose(boxed, [[-0.5, -0.25, 0], [0.5, 0.25, 0]])
    with pytest.raises(GeometryError, match="coincide"):
        unit_box(np.ones((4, 3)))


def test_psnr():
    image = np.full((8, 8, 3), 0.5)
    assert psnr(image, image + 0.1) == pytest.approx(20)
    assert psnr(image, image) == 100


def test_ssim_is_the_uniform_window_on_every_channel():
    rng = np.random.default_rng(0)
    a = rng.random((20, 24, 3))
    b = np.clip(a + rng.normal(0, 0.1, a.shape), 0, 1)
    assert ssim(a, a) == pytest.approx(1)
    assert ssim(b, a) == pytest.approx(_ssim_by_hand(a, b), abs=1e-4)


def _ssim_by_hand(a: np.ndarray, b: np.ndarray) -> float:
    """The formula of Wang et al. over every whole 7 x 7 window, unbiased variances."""
    values = []
    for channel in range(3):
        for i in range(a.shape[0] - 6):
            for j in range(a.shape[1] - 6):
                x, y = (image[i : i + 7, j : j + 7, channel].ravel() for image in (a, b))
                cov = np.cov(x, y)
                top = (2 * x.mean() * y.mean() + 1e-4) * (2 * cov[0, 1] + 9e-4)
                values.append(top / ((x.mean() ** 2 + y.mean() ** 2 + 1e-4) * (cov[0, 0] + cov[1, 1] + 9e-4)))
    return float(np.mean(values))
