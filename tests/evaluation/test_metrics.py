import numpy as np
import pytest
from scipy.spatial import cKDTree

from gvla2.errors import GeometryError
from gvla2.evaluation.metrics import chamfer, psnr, surface_points, unit_box
from gvla2.geometry.mesh import TriangleMesh

SQUARE = TriangleMesh(
    np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]), np.array([[0, 1, 2], [0, 2, 3]], dtype=np.int64)
)


def test_chamfer_of_known_points():
    a, b = np.array([[0.0, 0, 0]]), np.array([[0.0, 0, 3], [0, 4, 0]])
    assert chamfer(a, cKDTree(b)) == pytest.approx(1000 * (3 + 3.5) / 2)
    assert chamfer(b, cKDTree(b)) == 0


def test_surface_distance_sees_scale_that_the_official_one_hides():
    truth = cKDTree(SQUARE.sample(20_000, np.random.default_rng(0))[0])
    larger = SQUARE.with_vertices(1.1 * SQUARE.vertices + [0, 0, 0.2])
    surface, which = surface_points(larger, None, 20_000)
    assert which == "mesh"
    assert chamfer(surface, truth) == pytest.approx(200, rel=0.1)
    assert chamfer(unit_box(larger.vertices), cKDTree(unit_box(SQUARE.vertices))) == pytest.approx(
        0, abs=1e-9
    )
    same, _ = surface_points(SQUARE, None, 20_000)
    assert chamfer(same, truth) < 6, "sampling noise only"


def test_what_stands_for_a_surface():
    centres = np.zeros((3, 3))
    assert surface_points(None, centres)[1] == "centres"
    assert len(surface_points(None, centres)[0]) == 3
    with pytest.raises(GeometryError, match="neither"):
        surface_points(None, None)


def test_psnr():
    image = np.full((8, 8, 3), 0.5)
    assert psnr(image, image + 0.1) == pytest.approx(20)
    assert psnr(image, image) == 100
