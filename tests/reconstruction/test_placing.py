"""Gaussians taken to a new surface."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gvla2.reconstruction.carving import carve
from gvla2.reconstruction.inset import outward_normals
from gvla2.reconstruction.surfels import place


@pytest.fixture(scope="module")
def views(masked_views, jug):
    return masked_views(jug, size=96)


@pytest.fixture(scope="module")
def g0(views):
    made = carve(views, resolution=48).to_reconstruction(4_000)
    rng = np.random.default_rng(0)
    count = len(made.gaussians)
    gaussians = replace(
        made.gaussians,
        opacity_logits=rng.uniform(1, 4, count).astype(np.float32),
    )
    return replace(made, gaussians=gaussians, mesh=replace(made.mesh, colours=None))


def placed(g0, factor=1.0):
    smaller = g0.mesh.with_vertices(factor * g0.mesh.vertices)
    return smaller, place(g0.gaussians, g0.mesh, smaller, outward_normals(smaller))


def test_they_lie_on_the_new_surface_with_attributes_of_the_old(g0):
    mesh, made = placed(g0, 0.9)
    assert abs(len(made) / len(g0.gaussians) - 1) < 0.1
    nearest = np.linalg.norm(made.centres[:200, None] - mesh.vertices[None].astype(np.float32), axis=2).min(
        axis=1
    )
    assert nearest.max() < 0.05
    for name in ("opacity_logits", "sh_dc"):
        old = {row.tobytes() for row in getattr(g0.gaussians, name)}
        assert all(row.tobytes() in old for row in getattr(made, name))


def test_flat_ones_lie_flat(g0):
    mesh, made = placed(g0)
    thin = np.argmin(made.log_scales, axis=1)
    turned = Rotation.from_quat(made.rotations, scalar_first=True).as_matrix()
    axis = turned[np.arange(len(made)), :, thin]
    gaps = np.linalg.norm(made.centres[:, None] - mesh.vertices[None, ::5].astype(np.float32), axis=2)
    normals = outward_normals(mesh)[::5][gaps.argmin(axis=1)]
    assert np.median(np.abs((axis * normals).sum(axis=1))) > 0.9
