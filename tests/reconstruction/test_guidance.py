"""An open box whose visual hull is the closed one: the cavity is what a prior alone can show."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.ndimage import binary_erosion
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from gvla2.errors import GeometryError
from gvla2.geometry.camera import Camera
from gvla2.geometry.mesh import Mesh
from gvla2.geometry.raycast import RayCaster, Surface
from gvla2.geometry.transform import FloatArray, look_along, rigid
from gvla2.geometry.views import View, Views
from gvla2.reconstruction.contracts import GeometryEstimate
from gvla2.reconstruction.guidance import Guided, guide
from gvla2.reconstruction.sim3 import Sim3

SIZE = 96


def box(low, high) -> Mesh:
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)])
    vertices = np.asarray(low) + corners * (np.asarray(high) - np.asarray(low))
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return Mesh(vertices, np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))]))


def open_box(scale: float = 1.0) -> Mesh:
    """Four walls and a floor of 0.05, 0.6 x 0.6 x 0.3 outside."""
    parts = [
        box((-0.3, -0.3, -0.15), (0.3, 0.3, -0.1)),
        box((-0.3, -0.3, -0.1), (-0.25, 0.3, 0.15)),
        box((0.25, -0.3, -0.1), (0.3, 0.3, 0.15)),
        box((-0.25, -0.3, -0.1), (0.25, -0.25, 0.15)),
        box((-0.25, 0.25, -0.1), (0.25, 0.3, 0.15)),
    ]
    starts = np.cumsum([0] + [len(p.vertices) for p in parts[:-1]])
    faces = np.concatenate([p.faces + start for p, start in zip(parts, starts, strict=True)])
    return Mesh(scale * np.concatenate([p.vertices for p in parts]), faces)


def seen(mesh: Mesh, scale: float = 1.0) -> Views:
    positions = np.array(
        [[0.5, 0.3, 1.2], [-0.9, 0.6, 0.8], [-0.3, -1.0, 0.7], [1.1, -0.5, -0.4], [0.2, 0.2, 1.3]]
    )
    cameras = [
        Camera.from_fov(0.75, look_along(scale * p, -p), SIZE, SIZE, f"view {i}")
        for i, p in enumerate(positions)
    ]
    pictures = RayCaster([Surface(mesh.vertices, mesh.faces, np.array([0.6, 0.4, 0.2]), 0)]).cast(cameras, {})
    return Views(
        tuple(
            View(c, p.image, p.depth, (p.ids >= 0).astype(np.float32))
            for c, p in zip(cameras, pictures, strict=True)
        )
    )


@cache
def scene() -> tuple[Views, FloatArray, FloatArray]:
    """Views, points of the closed box (the hull), points of the true surface that some view can see."""
    hull, _ = box((-0.3, -0.3, -0.15), (0.3, 0.3, 0.15)).sample(8000, np.random.default_rng(0))
    views = seen(open_box())
    truth, _ = open_box().sample(20_000, np.random.default_rng(1))
    # Faces between the parts lie inside the material.
    visible = np.zeros(len(truth), dtype=bool)
    for view in views:
        uv, depth = view.camera.project(truth)
        column, row = (np.clip(uv, 0, SIZE - 1).astype(int)).T
        visible |= depth < view.depth[row, column] + 0.01
    return views, hull, truth[visible]


def depth_of(views: Views) -> FloatArray:
    return np.stack([view.depth for view in views]).astype(np.float64)


def estimate(depth, confidence=None, poses=None) -> GeometryEstimate:
    depth = np.asarray(depth, dtype=np.float32)
    sure = np.ones(depth.shape, np.float32) if confidence is None else np.asarray(confidence, np.float32)
    return GeometryEstimate(depth, sure, poses)


def distance(points: FloatArray, truth: FloatArray) -> float:
    """Symmetric mean distance."""
    there, _ = cKDTree(truth).query(points)
    back, _ = cKDTree(points).query(truth)
    return 0.5 * float(there.mean() + back.mean())


@cache
def exact() -> Guided:
    views, hull, _ = scene()
    return guide(hull, views, estimate(depth_of(views)))


def test_the_hull_sinks_into_the_cavity():
    _, hull, truth = scene()
    guided = exact()
    assert guided.report.status == "applied", guided.report.reason
    assert distance(guided.points, truth) < 0.6 * distance(hull, truth)
    lid = (hull[:, 2] > 0.149) & (np.abs(hull[:, :2]).max(axis=1) < 0.15)
    assert np.median(guided.points[lid, 2]) < -0.05
    assert guided.report.after["support"] >= guided.report.before["support"] - 0.02
    assert guided.points.shape == hull.shape
    assert guided.report.seconds > 0


def test_points_on_the_surface_stay():
    views, _, truth = scene()
    guided = guide(truth, views, estimate(depth_of(views)))
    moved = np.linalg.norm(guided.points - truth, axis=1)
    assert moved.mean() < 0.01  # a pixel of these pictures
    assert np.median(moved) < 0.004
    assert distance(guided.points, truth) < 0.005


def test_other_points_move_along():
    _, hull, truth = scene()
    guided = exact()
    np.testing.assert_array_equal(guided.move(hull), guided.points)
    mesh, _ = box((-0.3, -0.3, -0.15), (0.3, 0.3, 0.15)).sample(3000, np.random.default_rng(7))
    moved = guided.move(mesh)
    assert distance(moved, truth) < 0.7 * distance(mesh, truth)
    near, index = cKDTree(hull).query(mesh)
    close = near < 0.002
    gap = np.linalg.norm((moved - mesh)[close] - guided.displacement.offsets[index[close]], axis=1)
    assert np.median(gap) < 0.01


def test_a_prior_in_its_own_frame_and_scale_guides_as_the_metric_one():
    views, hull, _ = scene()
    own = Sim3(0.37, Rotation.from_euler("xyz", [0.3, -1, 2]).as_matrix(), np.array([4.0, 5, 6]))
    poses = own.apply_to_poses(np.stack([view.camera.world_from_camera for view in views]))
    guided = guide(hull, views, estimate(0.37 * depth_of(views), poses=poses))
    assert guided.report.status == "applied"
    assert "Sim(3)" in guided.report.reason
    assert distance(guided.points, exact().points) < 0.003


@pytest.mark.parametrize("factor", [0.85, 1.2])
def test_a_wrong_scale_is_found_by_the_views_agreement(factor):
    views, hull, truth = scene()
    guided = guide(hull, views, estimate(factor * depth_of(views)))
    assert guided.report.status == "applied", guided.report.reason
    assert "the scale in which its views agree" in guided.report.reason
    assert distance(guided.points, truth) < 0.65 * distance(hull, truth)


def test_one_view_without_a_baseline_takes_its_scale_from_the_object():
    views, hull, truth = scene()
    one = Views((views[4],))
    pose = rigid(translation=[1.0, 2.0, 3.0])[None]
    guided = guide(hull, one, estimate(5.0 * depth_of(one), poses=pose))
    assert guided.report.status in ("applied", "rejected")
    assert distance(guided.points, truth) < 1.01 * distance(hull, truth)


def bad_estimates() -> dict[str, tuple[str, GeometryEstimate]]:
    views, _, _ = scene()
    depth = depth_of(views)
    poses = np.stack([view.camera.world_from_camera for view in views])
    mirrored = poses @ np.diag([1.0, 1, -1, 1])
    thin = np.where(np.arange(SIZE)[None, None] % 8 == 0, depth, np.nan)
    noise = np.random.default_rng(0).normal(scale=0.1, size=depth.shape)
    return {
        "too few maps": ("wrong_view_count", estimate(depth[:3])),
        "another size": ("wrong_size", estimate(depth[:, ::2, ::2])),
        "confidence of another size": ("wrong_size", estimate(depth, np.ones((5, 3, 3)))),
        "not a number": ("no_depth", estimate(np.full_like(depth, np.nan))),
        "zeros": ("no_depth", estimate(np.zeros_like(depth))),
        "infinite": ("no_depth", estimate(np.full_like(depth, np.inf))),
        "no confidence": ("no_confidence", estimate(depth, np.zeros_like(depth))),
        "confidence not a number": ("no_confidence", estimate(depth, np.full_like(depth, np.nan))),
        "too little": ("too_little_depth", estimate(thin)),
        "mirrored cameras": ("bad_cameras", estimate(depth, poses=mirrored)),
        "too few cameras": ("bad_cameras", estimate(depth, poses=poses[:2])),
        "other cameras": ("cameras_disagree", estimate(depth, poses=poses[[1, 2, 3, 4, 0]])),
        "noise": ("too_rough", estimate(depth + noise)),
        "flat": ("inconsistent", estimate(np.where(np.isfinite(depth), 1.0, np.nan))),
    }


@pytest.mark.parametrize("name", list(bad_estimates()))
def test_an_unusable_prior_is_a_typed_fallback(name):
    views, hull, _ = scene()
    code, prior = bad_estimates()[name]
    guided = guide(hull, views, prior)
    assert guided.report.status == "fallback"
    assert guided.report.reason.startswith(code + ":"), guided.report.reason
    np.testing.assert_array_equal(guided.points, hull)
    np.testing.assert_array_equal(guided.move(hull[:5] + 0.01), hull[:5] + 0.01)


def test_another_objects_depth_does_no_harm():
    views, hull, _ = scene()
    small = seen(Mesh(open_box().vertices * 0.75 + [0.05, 0, 0], open_box().faces))
    guided = guide(hull, views, estimate(depth_of(small)))
    assert guided.report.status in ("fallback", "rejected"), guided.report.after
    np.testing.assert_array_equal(guided.points, hull)


@pytest.mark.parametrize("noise", [0.003, 0.01, 0.03])
def test_noise_never_makes_it_worse(noise):
    views, hull, truth = scene()
    off = np.random.default_rng(2).normal(scale=noise, size=(5, SIZE, SIZE))
    guided = guide(hull, views, estimate(depth_of(views) + off))
    assert distance(guided.points, truth) <= 1.01 * distance(hull, truth)


@pytest.mark.parametrize("background", [1.7, 3.0])
def test_flying_pixels_at_edges_are_outvoted(background):
    views, hull, truth = scene()
    depth = depth_of(views)
    known = np.isfinite(depth)
    rim = known & ~np.stack([binary_erosion(k, np.ones((3, 3))) for k in known])
    guided = guide(hull, views, estimate(np.where(rim, 0.5 * (depth + background), depth)))
    assert guided.report.status == "applied", guided.report.reason
    assert distance(guided.points, truth) < 0.6 * distance(hull, truth)


def test_size_and_pose_of_the_scene_do_not_matter():
    views, hull, _ = scene()
    motion = rigid(Rotation.from_euler("xyz", [0.7, 0.4, -1.1]).as_matrix(), [3.0, -2.0, 1.0])
    moved = Views(
        tuple(
            replace(v, camera=replace(v.camera, world_from_camera=motion @ v.camera.world_from_camera))
            for v in views
        )
    )
    there = guide(hull @ motion[:3, :3].T + motion[:3, 3], moved, estimate(depth_of(views)))
    assert there.report.status == "applied"
    gap = np.linalg.norm(exact().points @ motion[:3, :3].T + motion[:3, 3] - there.points, axis=1)
    assert np.quantile(gap, 0.98) < 1e-4

    small = seen(open_box(0.1), 0.1)
    tiny = guide(0.1 * hull, small, estimate(depth_of(small)))
    gap = np.linalg.norm(10 * tiny.points - exact().points, axis=1)
    assert np.quantile(gap, 0.95) < 2e-3


def test_nothing_to_do_is_said():
    views, hull, _ = scene()
    assert guide(hull, views, None).report.status == "skipped"
    assert guide(hull[:5], views, estimate(depth_of(views))).report.reason.startswith("too_few_points")
    same = np.zeros((20, 3))
    assert guide(same, views, estimate(depth_of(views))).report.reason.startswith("no_extent")


def test_malformed_input_is_refused():
    views, hull, _ = scene()
    with pytest.raises(GeometryError, match=r"\(N, 3\)"):
        guide(hull[:, :2], views, estimate(depth_of(views)))
    with pytest.raises(GeometryError, match="not finite"):
        guide(np.where(hull > 0.29, np.nan, hull), views, estimate(depth_of(views)))
    with pytest.raises(GeometryError, match="mask"):
        guide(hull, Views(tuple(replace(v, mask=None) for v in views)), estimate(depth_of(views)))
