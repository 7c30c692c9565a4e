"""One volume: what depth carves, what it leaves, and what nobody saw."""

from __future__ import annotations

from copy import deepcopy

import numpy as np
import pytest
import trimesh
from scipy.ndimage import binary_dilation
from scipy.spatial import cKDTree

from gvla2.geometry.mesh import TriangleMesh
from gvla2.reconstruction.branch import fuse_evidence
from gvla2.reconstruction.carving import surface_of
from gvla2.reconstruction.contracts import GeometryEstimate
from gvla2.reconstruction.depth_evidence import gather
from gvla2.reconstruction.view_set import ViewSet
from gvla2.reconstruction.volume import fuse_volume
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
    _, heeding = fuse_evidence(estimate, seen, None)
    assert len(heeding.needed) < 0.5 * len(plain.needed)
    assert distance(surface_of(heeding.field), bar) < 0.9 * distance(plain_mesh, bar)
