import numpy as np

from gvla2_plugins.tabletop_objects.meshes import fallen
from tests.scanning import box


def poses(sides, count=300):
    mesh = box(*sides)
    rng = np.random.default_rng(0)
    turns = np.array([fallen(mesh.vertices, np.zeros(3), rng) for _ in range(count)])
    return np.abs(turns[:, 2]).round(3), turns


def test_a_box_lies_on_its_faces_and_mostly_on_the_large_ones():
    up, turns = poses((0.02, 0.1, 0.2))
    assert (up.max(axis=1) == 1).all()
    flat, edge, tall = (up == 1).mean(axis=0)
    assert flat > edge > tall
    np.testing.assert_allclose(np.linalg.det(turns), 1)


def test_all_faces_of_a_cube_are_as_likely():
    up, _ = poses((0.1, 0.1, 0.1))
    assert ((up == 1).mean(axis=0) > 0.24).all()


def test_it_rolls_off_a_face_that_its_weight_does_not_stand_on():
    wedge = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0], [3, 0, 1], [3, 1, 1.0]]) * 0.05
    rng = np.random.default_rng(1)
    centre = np.array([2.9, 0.5, 0.95]) * 0.05
    for _ in range(50):
        turned = (wedge - centre) @ fallen(wedge, centre, rng).T
        low = turned[:, 2] < turned[:, 2].min() + 1e-6
        assert low.sum() >= 3
        assert (turned[low, :2].min(axis=0) <= 1e-6).all()
        assert (turned[low, :2].max(axis=0) >= -1e-6).all()


def test_what_is_flat_lies_flat():
    sheet = np.array([[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0], [0.1, 0.1, 0]])
    turn = fallen(sheet, sheet.mean(axis=0), np.random.default_rng(0))
    assert np.ptp((sheet @ turn.T)[:, 2]) < 1e-9
