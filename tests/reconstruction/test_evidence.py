"""A prior's depth with known errors: what is found, corrected and refused."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gvla2.errors import GeometryError
from gvla2.geometry.views import Views
from gvla2.reconstruction.contracts import GeometryEstimate
from gvla2.reconstruction.depth_evidence import (
    Aligned,
    gather,
    refute_by_caps,
)
from gvla2.reconstruction.view_set import ViewSet
from gvla2_plugins.depth_prior import LearnedNoise
from gvla2_plugins.depth_prior.noise import learned

CLEAN = {"global_scale": 0.0, "low_frequency": 0.0, "pose_degrees": 0.0, "pose_shift": 0.0, "edge_blur": 0.0}


@pytest.fixture(scope="module")
def views(masked_views, jug):
    return masked_views(jug, size=128, seed=3)


@pytest.fixture(scope="module")
def seen(views):
    return ViewSet(views)


def exact(views):
    return np.stack([view.depth for view in views]).astype(np.float64)


def estimate(views, seed=0, **parts):
    depth, poses = exact(views), np.stack([view.camera.world_from_camera for view in views])
    noise = LearnedNoise(**{**CLEAN, **parts})
    found, sure, moved = learned(depth, poses, noise, np.random.default_rng(seed))
    return GeometryEstimate(found.astype(np.float32), sure.astype(np.float32), moved)


def error(depth, views):
    """Root mean square of relative error, per cent."""
    gap = np.log(depth / exact(views))
    return 100 * float(np.sqrt(np.nanmean(np.clip(gap, -0.2, 0.2) ** 2)))


def test_exact_depth_stays_as_it_is(views, seen):
    found = gather(estimate(views), seen)
    assert error(found.depth, views) < 0.6
    assert np.nanmedian(found.std) < 0.006


@pytest.mark.parametrize(
    ("parts", "most"),
    [
        ({"view_scale": 0.1}, 0.6),
        ({"view_shift": 0.05}, 0.6),
        ({"slope": 0.1}, 1.3),
        ({"global_scale": 0.3, "pose_degrees": 1.0, "pose_shift": 0.01}, 0.6),
    ],
)
def test_stiff_errors_are_found_whatever_their_size(views, seen, parts, most):
    given = estimate(views, **parts)
    assert error(given.depth, views) > 1.5 * most
    assert error(gather(given, seen).depth, views) < most


def test_a_view_without_depth_is_left_out_and_the_rest_is_used(views, seen):
    given = estimate(views)
    given.depth[1] = np.nan
    found = gather(given, seen)
    assert not np.isfinite(found.depth[1]).any()
    assert error(found.depth, views) < 0.6
    assert found.summary.startswith(f"4 of 5 views used (no usable depth: {views[1].name}), depth right to ")


def test_a_single_depth_map_is_believed(views, seen):
    given = estimate(views)
    given.depth[1:] = np.nan
    found = gather(given, seen)
    assert error(found.depth[:1], Views(views.views[:1])) < 0.5
    assert found.summary.startswith("1 of 5 views used (no usable depth: ")
    assert found.summary.endswith("), how right its depth is cannot be judged from one.")
    assert "in metres" in gather(replace(given, depth=1000 * given.depth), seen).summary


def test_depth_in_another_unit_is_reported(views, seen):
    given = estimate(views)
    summary = gather(replace(given, depth=given.depth * 1000), seen).summary
    assert "is it in metres?" in summary
    assert 0.0009 < float(summary.split("times ")[1].split(":")[0]) < 0.0011
    assert "in metres" not in gather(given, seen).summary


def test_what_cannot_be_used_says_why(views, seen):
    given = estimate(views)
    for wrong, words in (
        (replace(given, depth=given.depth[:2]), "views, height, width"),
        (replace(given, depth=np.full_like(given.depth, np.nan)), "0% of the masks"),
        (replace(given, confidence=0 * given.confidence), "0% of the masks"),
    ):
        with pytest.raises(GeometryError, match=words):
            gather(wrong, seen)


def test_masks_refute_what_lies_behind_a_cap_and_doubt_its_view_alone():
    depth = np.full((2, 12, 12), 2.0)
    aligned = Aligned(depth, np.full(depth.shape, 0.002))
    caps = np.full(depth.shape, np.nan)
    caps[0, 5, 2:10] = 2.0 / 1.02  # two per cent before the surface: ten deviations
    caps[1, 5, 2:10] = 2.1  # behind it: nothing is wrong
    found, refuted = refute_by_caps(aligned, np.ones(depth.shape, dtype=bool), caps)
    assert refuted[0, 4:7, 1:11].all()
    assert refuted.sum() == 30
    assert found.std[0, 0, 0] == pytest.approx(np.hypot(0.002, np.log(1.02)))
    assert (found.std[1] == 0.002).all()
