from dataclasses import replace

import numpy as np
import pytest
import trimesh

from gvla2.geometry.views import Views
from gvla2.reconstruction.silhouette import silhouettes, symmetric_iou
from gvla2_plugins.axes.residuals import mask_contour


@pytest.fixture(scope="module")
def views(jug, masked_views) -> Views:
    return masked_views(jug, size=256)


def surface(mesh: trimesh.Trimesh, count: int) -> np.ndarray:
    return np.asarray(trimesh.sample.sample_surface(mesh, count, seed=0)[0])


def test_a_mesh_draws_exactly_what_rays_hit(jug, views):
    assert symmetric_iou(jug.vertices, views, faces=jug.faces) > 0.9995


@pytest.mark.parametrize(("count", "least"), [(5_000, 0.96), (20_000, 0.985), (300_000, 0.995)])
def test_points_of_any_density_fill_the_same_silhouette(jug, views, count, least):
    points = surface(jug, count)
    assert symmetric_iou(points, views) > least
    masks = [view.mask > 0.5 for view in views]
    drawn = silhouettes(points, views)
    assert all((d & m).sum() > 0.98 * d.sum() for d, m in zip(drawn, masks, strict=True))


def test_a_hole_stays_a_hole(masked_views):
    ring = trimesh.creation.torus(major_radius=0.4, minor_radius=0.08)
    views = masked_views(ring, size=128)
    open_views = [v for v in views if abs(v.camera.world_from_camera[2, 2]) > 0.7]
    assert open_views
    middle = [v.camera.project(np.zeros((1, 3)))[0][0].astype(int) for v in open_views]
    drawn = silhouettes(surface(ring, 10_000), Views(tuple(open_views)))
    assert not any(mask[v, u] for mask, (u, v) in zip(drawn, middle, strict=True))


def test_points_that_are_not_finite_or_behind_are_not_drawn(jug, views):
    points = surface(jug, 5000)
    dirt = np.vstack([points, [[np.nan, 0, 0], [np.inf, 0, 0], 3 * views[0].camera.position]])
    first = Views((views[0],))
    assert symmetric_iou(dirt, first) == pytest.approx(symmetric_iou(points, first))


def test_empty_masks_are_left_out_or_an_error(jug, views):
    empty = replace(views[0], mask=np.zeros_like(views[0].mask))
    points = surface(jug, 5000)
    partly = symmetric_iou(points, Views((empty, *views.views[1:])))
    assert partly == pytest.approx(symmetric_iou(points, Views(views.views[1:])))
    assert np.isnan(symmetric_iou(points, Views((empty,))))


def test_contour_of_a_disc_lies_on_it_with_normals_outwards():
    size, centre, radius = 96, np.array([47.3, 50.1]), 30.0
    j, i = np.meshgrid(np.arange(size) + 0.5, np.arange(size) + 0.5)
    mask = (np.hypot(j - centre[0], i - centre[1]) <= radius).astype(np.float32)
    for count in (10_000, 100):
        contour = mask_contour(mask, count)
        offset = contour.uv - centre
        assert abs((np.linalg.norm(offset, axis=1) - radius).mean()) < 0.05
        cosine = (offset * contour.normal).sum(axis=1) / np.linalg.norm(offset, axis=1)
        assert cosine.min() > 0.99
        assert contour.length.sum() == pytest.approx(2 * np.pi * radius, rel=0.02)
    assert 90 <= len(contour.uv) <= 100
