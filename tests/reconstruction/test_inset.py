"""Gaussians lie inside what they paint, and by how much the masks tell."""

from __future__ import annotations

import numpy as np
import pytest

from gvla2.reconstruction.carving import carve
from gvla2.reconstruction.inset import (
    alpha_iou,
    inset,
    largest,
    pixel_sizes,
)
from gvla2.reconstruction.rasteriser import Rasteriser


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
