"""Gaussians lie inside what they paint, and by how much the masks tell."""

from __future__ import annotations

import numpy as np
import pytest

from gvla2.reconstruction.carving import carve
from gvla2.reconstruction.inset import (
    alpha_iou,
    fill_masks,
    inset,
    largest,
    outward_normals,
    pixel_sizes,
)
from gvla2.reconstruction.rasteriser import Rasteriser
from gvla2.reconstruction.silhouette import symmetric_iou


@pytest.fixture(scope="module")
def views(masked_views, jug):
    return masked_views(jug, size=96)


@pytest.fixture(scope="module")
def carved(views):
    return carve(views, resolution=48).to_reconstruction(4_000)


def test_what_is_painted_ends_where_the_masks_do(carved, views):
    placed, report = inset(carved, views, Rasteriser())
    assert report.status == "applied"
    before, after = report.before["alpha_iou"], report.after["alpha_iou"]
    assert after > before + 0.01
    assert after == pytest.approx(alpha_iou(placed.gaussians, largest(views), Rasteriser()))
    way = np.linalg.norm(placed.gaussians.centres - carved.gaussians.centres, axis=1)
    assert way.max() <= 2.01 * pixel_sizes(np.asarray(carved.gaussians.centres, float), views).max()


def test_nothing_but_the_centres_changes(carved, views):
    placed, _ = inset(carved, views, Rasteriser())
    np.testing.assert_array_equal(placed.mesh.vertices, carved.mesh.vertices)
    for name in ("log_scales", "rotations", "opacity_logits", "sh_dc"):
        np.testing.assert_array_equal(getattr(placed.gaussians, name), getattr(carved.gaussians, name))


@pytest.mark.parametrize("pixels", [-0.8, 0.8])
def test_a_mesh_of_wrong_thickness_meets_its_masks_again(carved, views, pixels):
    mesh = carved.mesh
    step = pixels * pixel_sizes(mesh.vertices, views)[:, None]
    wrong = mesh.with_vertices(mesh.vertices + step * outward_normals(mesh))
    mended = fill_masks(wrong, views)
    iou = [symmetric_iou(m.vertices, views, faces=m.faces) for m in (wrong, mended, mesh)]
    assert iou[1] > iou[0] + 0.5 * (iou[2] - iou[0])
