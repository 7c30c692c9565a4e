"""One volume: what depth carves, what it leaves, and what nobody saw."""

from __future__ import annotations

from copy import deepcopy
from types import SimpleNamespace

import numpy as np
import pytest
import trimesh
from scipy.ndimage import binary_dilation
from scipy.spatial import cKDTree

from gvla2.geometry.mesh import TriangleMesh
from gvla2.reconstruction.branch import agreed, fuse_prior
from gvla2.reconstruction.carving import surface_of
from gvla2.reconstruction.contracts import GeometryEstimate, Reconstruction
from gvla2.reconstruction.depth_evidence import gather
from gvla2.reconstruction.occupancy import Field
from gvla2.reconstruction.view_set import ViewSet
from gvla2.reconstruction.volume import fuse_volume, mesh_field
from gvla2_plugins.depth_prior import LearnedNoise
from gvla2_plugins.depth_prior.noise import learned


def bowl() -> trimesh.Trimesh:
    """A thick bowl: its hollow is in no silhouette."""
    angles = np.linspace(0, np.pi / 2, 16)
    outer = np.stack([0.5 * np.sin(angles), -0.5 * np.cos(angles)], axis=1)
    inner = np.stack([0.42 * np.sin(angles), -0.42 * np.cos(angles)], axis=1)[::-1]
    return trimesh.creation.revolve(np.concatenate([outer, inner]), sections=48)


def from_depth(views):
    depth = np.stack([view.depth for view in views])
    return GeometryEstimate(depth, np.isfinite(depth).astype(np.float32))


@pytest.fixture(scope="module")
def views(masked_views):
    return masked_views(bowl(), size=128, seed=2)


@pytest.fixture(scope="module")
def seen(views):
    return ViewSet(views)


@pytest.fixture(scope="module")
def right(seen, views):
    """What right depth tells; a test that changes it takes a copy."""
    return gather(from_depth(views), seen)


@pytest.fixture(scope="module")
def plain(seen, right):
    """The volume of right depth, and its surface."""
    return fused(seen, right)


def fused(seen, evidence, g0=None):
    post = fuse_volume(seen, evidence, g0)
    return post, surface_of(post.field)


def distance(mesh, truth):
    points = mesh.sample(4000, np.random.default_rng(0))[0]
    return float(cKDTree(truth.sample(40_000, seed=0)).query(points)[0].mean())


def test_a_hollow_that_no_silhouette_shows_is_carved(seen, plain):
    post, mesh = plain
    assert distance(mesh, bowl()) < 0.5 * distance(seen.hull_surface, bowl())
    assert (post.confidence > 0).any()


def test_a_solid_mask_pixel_keeps_something_on_its_ray(seen, views, right):
    evidence = deepcopy(right)
    # Every view believes that it looks straight through.
    evidence.depth[:] = 10.0
    post, _ = fused(seen, evidence)
    inside = post.field.points(np.argwhere(post.field.values > 0))
    for view in views:
        uv, _ = view.camera.project(inside)
        covered = np.zeros(view.mask.shape, dtype=bool)
        column, row = uv[view.camera.inside(uv)].astype(int).T
        covered[row, column] = True
        grown = binary_dilation(covered, iterations=3)
        assert grown[view.mask > 0.99].mean() > 0.98


def test_without_evidence_the_first_reconstruction_stays(seen, right):
    evidence = deepcopy(right)
    evidence.weight[:] = 0.0
    truth = bowl()
    post, mesh = fused(seen, evidence, TriangleMesh(np.asarray(truth.vertices), np.asarray(truth.faces)))
    assert (post.confidence == 0).all()
    assert distance(mesh, truth) < 0.5 * seen.hull.step


@pytest.mark.parametrize("turn", [1, -1])
def test_depth_inside_a_ball(turn):
    ball = trimesh.creation.icosphere(subdivisions=4, radius=0.5)
    grid = Field(np.zeros((40, 40, 40), dtype=np.float32), np.full(3, -0.7), 1.4 / 39)
    where = np.ones(grid.values.shape, dtype=bool)
    found = mesh_field(TriangleMesh(ball.vertices, ball.faces[:, ::turn]), grid, where)
    points = grid.points(np.argwhere(where))
    true = 0.5 - np.linalg.norm(points, axis=1).reshape(found.shape)
    assert ((found > 0) == (true > 0)).mean() > 0.999
    near = np.abs(true) < grid.step
    assert np.abs(found - true)[near].max() < 0.5 * grid.step


def test_masks_give_back_what_wrong_depth_cuts_off_a_thin_bar(masked_views):
    bar = trimesh.creation.box((0.9, 0.06, 0.06))
    views = masked_views(bar, size=128, seed=4)
    seen = ViewSet(views)
    clean = {"global_scale": 0.0, "pose_degrees": 0.0, "pose_shift": 0.0, "edge_blur": 0.0}
    noise = LearnedNoise(**clean, low_frequency=0.02)
    poses = np.stack([view.camera.world_from_camera for view in views])
    right = from_depth(views).depth.astype(np.float64)
    wrong, sure, moved = learned(right, poses, noise, np.random.default_rng(1))
    estimate = GeometryEstimate(wrong.astype(np.float32), sure.astype(np.float32), moved)
    plain, plain_mesh = fused(seen, gather(estimate, seen))
    _, heeding = agreed(estimate, seen, None)
    assert len(heeding.needed) < 0.5 * len(plain.needed)
    assert distance(surface_of(heeding.field), bar) < 0.9 * distance(plain_mesh, bar)


def test_right_depth_of_thin_walls_is_taken_as_it_is(seen, views, plain):
    evidence, posterior = agreed(from_depth(views), seen, None)
    assert (posterior.field.values > 0).sum() == pytest.approx((plain[0].field.values > 0).sum(), rel=0.01)
    assert (evidence.weight > 0).any()


def test_specks_that_no_mask_needs_are_left_out(seen, views):
    poses = np.stack([view.camera.world_from_camera for view in views])
    right = from_depth(views).depth.astype(np.float64)
    wrong, sure, moved = learned(right, poses, LearnedNoise(), np.random.default_rng(3))
    estimate = GeometryEstimate(wrong.astype(np.float32), sure.astype(np.float32), moved)
    with_specks = surface_of(agreed(estimate, seen, None)[1].field)
    prior = SimpleNamespace(predict=lambda _: estimate)
    thing, _ = fuse_prior(Reconstruction(None, None, "ok"), seen, prior)
    made, before = (
        trimesh.Trimesh(m.vertices, m.faces).split(only_watertight=False) for m in (thing.mesh, with_specks)
    )
    assert len(made) < 0.8 * len(before)
    assert max(p.area for p in made) == pytest.approx(max(p.area for p in before), rel=0.01)
