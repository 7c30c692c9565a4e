from dataclasses import replace

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from gvla2.errors import GeometryError
from gvla2.geometry.transform import rigid, transform_points
from gvla2.geometry.views import Views
from gvla2.reconstruction.support import object_centre
from gvla2_plugins.axes.compensations import AxisOptions, compensate

PLANTED = np.array([1.04, 0.96, 1.03]), np.array([0.010, -0.008, 0.012])


@pytest.fixture(scope="module")
def points(jug) -> np.ndarray:
    return np.asarray(trimesh.sample.sample_surface(jug, 60_000, seed=0)[0])


@pytest.fixture(scope="module")
def views(jug, masked_views) -> Views:
    return masked_views(jug, size=256)


def drifted(points: np.ndarray, scale, shift) -> np.ndarray:
    centre = object_centre(points)
    return centre + (points - centre) * scale + shift


def displacement(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.linalg.norm(a - b, axis=1).mean())


def test_recovers_a_planted_drift(points, views):
    wrong = drifted(points, *PLANTED)
    fit = compensate(wrong, views, object_centre(wrong))
    assert fit.accepted
    assert fit.iou_after > fit.iou_before + 0.03
    assert fit.iterations <= 10
    assert displacement(wrong, points) > 0.02
    assert displacement(fit.apply(wrong), points) < 1.5e-3
    np.testing.assert_allclose(fit.scale * PLANTED[0], 1, atol=5e-3)


@settings(max_examples=6, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_any_drift_within_bounds_is_undone(points, views, seed):
    rng = np.random.default_rng(seed)
    wrong = drifted(points, rng.uniform(0.95, 1.05, 3), rng.uniform(-0.02, 0.02, 3))
    fit = compensate(wrong, views, object_centre(wrong))
    left = displacement(fit.apply(wrong), points)
    assert left < max(2.5e-3, 0.15 * displacement(wrong, points))


def test_identity_in_identity_out(points, views):
    fit = compensate(points, views, object_centre(points))
    assert not fit.accepted
    assert "fits already" in fit.reason
    np.testing.assert_array_equal(fit.apply(points), points)
    assert fit.scale.tolist() == [1, 1, 1]


def test_a_rigid_motion_of_the_scene_moves_the_answer_along(points, views):
    motion = rigid(Rotation.from_rotvec([0.3, -0.8, 0.5]).as_matrix(), (0.4, -1.2, 2.0))
    there = Views(
        tuple(
            replace(v, camera=replace(v.camera, world_from_camera=motion @ v.camera.world_from_camera))
            for v in views
        )
    )
    wrong = drifted(points, *PLANTED)
    centre = object_centre(wrong)
    fit = compensate(wrong, views, centre)
    moved = compensate(
        transform_points(motion, wrong),
        there,
        transform_points(motion, centre),
        AxisOptions(axes=motion[:3, :3]),
    )
    np.testing.assert_allclose(moved.scale, fit.scale, atol=2e-4)
    np.testing.assert_allclose(moved.shift, fit.shift, atol=1e-4)
    expected = transform_points(motion, fit.apply(wrong))
    np.testing.assert_allclose(moved.apply(transform_points(motion, wrong)), expected, atol=3e-4)


def test_stays_within_bounds(points, views):
    wrong = drifted(points, [1.08, 1.08, 1.08], [0, 0, 0])
    fit = compensate(
        wrong, views, object_centre(wrong), AxisOptions(scale_bounds=(0.97, 1.03), shift_bound=0.004)
    )
    assert fit.accepted
    assert fit.scale.min() >= 0.97
    np.testing.assert_allclose(fit.scale, 0.97, atol=1e-6)
    side = np.ptp(wrong, axis=0).max()
    assert np.abs(fit.shift).max() <= 0.004 * side


def test_paper_mode_keeps_the_released_bounds_and_rewards_shrinking(points, views):
    fit = compensate(points, views, object_centre(points), AxisOptions(mode="paper", points=5000))
    assert fit.accepted  # the true shape is shrunk all the same: why this is not the default
    assert fit.scale.min() >= 0.98
    assert fit.scale.mean() < 0.999


def test_one_view_leaves_the_depth_alone(points, views):
    wrong = drifted(points, 1.04, 0.0)
    fit = compensate(wrong, Views((views[0],)), object_centre(wrong))
    assert np.isfinite(fit.scale).all()
    assert np.abs(fit.scale - 1).max() <= 0.1 + 1e-9
    assert fit.iou_after >= fit.iou_before or not fit.accepted


def test_falls_back_with_a_reason(points, views):
    centre = object_centre(points)
    empty = Views(tuple(replace(v, mask=np.zeros_like(v.mask)) for v in views))
    full = Views(tuple(replace(v, mask=np.ones_like(v.mask)) for v in views))
    assert "empty" in compensate(points, empty, centre).reason
    assert "contour" in compensate(points, full, centre).reason
    assert "contour" in compensate(points + 3.0, views, centre + 3.0).reason
    assert "10 finite points" in compensate(points[:10], views, centre).reason
    for answer in (compensate(points, empty, centre), compensate(points[:10], views, centre)):
        assert not answer.accepted
        np.testing.assert_array_equal(answer.apply(points), points)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (AxisOptions(scale_bounds=(1.01, 1.1)), "enclose 1"),
        (AxisOptions(shift_bound=-0.1), "shift_bound"),
        (AxisOptions(axes=np.ones((3, 3))), "orthonormal"),
        (AxisOptions(points=-5), "points"),
        (AxisOptions(mode="papr"), "Available: default, paper"),
    ],
)
def test_errors(points, views, options, words):
    with pytest.raises(GeometryError, match=words):
        compensate(points, views, np.zeros(3), options)
