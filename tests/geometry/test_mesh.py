from __future__ import annotations

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from gvla2.errors import GeometryError
from gvla2.geometry.mesh import TriangleMesh

SQUARE = np.array([[0.0, 0, 0], [2, 0, 0], [2, 1, 0], [0, 1, 0]])
FACES = np.array([[0, 1, 2], [0, 2, 3]])


def test_normals_areas_and_bounds() -> None:
    mesh = TriangleMesh(SQUARE, np.vstack([FACES, [[0, 0, 1]]]))
    assert mesh.areas.tolist() == [1, 1, 0]
    assert mesh.normals.tolist() == [[0, 0, 1], [0, 0, 1], [0, 0, 0]]
    assert mesh.bounds.tolist() == [[0, 0, 0], [2, 1, 0]]


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_samples_lie_on_their_faces(seed: int) -> None:
    rng = np.random.default_rng(seed)
    mesh = TriangleMesh(rng.normal(size=(12, 3)), rng.integers(0, 12, (9, 3)))
    points, faces = mesh.sample(50, rng)
    assert (mesh.areas[faces] > 0).all()
    corner = mesh.vertices[mesh.faces[faces, 0]]
    assert np.abs(np.einsum("ij,ij->i", points - corner, mesh.normals[faces])).max() < 1e-9
    weights = trimesh.triangles.points_to_barycentric(mesh.vertices[mesh.faces[faces]], points)
    assert weights.min() > -1e-6


def test_samples_are_spread_by_area() -> None:
    vertices = np.vstack([SQUARE, SQUARE * 0.5 + [10, 0, 0]])  # the second square has a quarter of the area
    mesh = TriangleMesh(vertices, np.vstack([FACES, FACES + 4]))
    points, faces = mesh.sample(20000, np.random.default_rng(0))
    assert (faces >= 2).mean() == pytest.approx(0.2, abs=0.01)
    inside = points[faces < 2]
    assert np.allclose(inside.mean(axis=0), [1, 0.5, 0], atol=0.02)
    again, _ = mesh.sample(20000, np.random.default_rng(0))
    assert np.array_equal(points, again)


@pytest.mark.parametrize(
    ("vertices", "faces", "colours", "words"),
    [
        (np.zeros((4, 2)), FACES, None, "vertices"),
        (SQUARE, np.zeros((1, 4), int), None, "triangulate"),
        (np.where(SQUARE == 2, np.nan, SQUARE), FACES, None, "2 of 4 vertices"),
        (SQUARE, FACES + 1, None, "outside 0..3"),
        (SQUARE, FACES, np.zeros((3, 3)), "colours"),
        (SQUARE, FACES, np.full((4, 3), 255.0), "colours"),
    ],
)
def test_malformed_meshes_are_refused(vertices, faces, colours, words: str) -> None:
    with pytest.raises(GeometryError, match=words):
        TriangleMesh(vertices, faces, colours)
