"""The bench's noise by name, plain baselines beside the branch, and the curve of gain against noise."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from scipy.spatial import cKDTree

from gvla2.evaluation.comparison import make_tables
from gvla2.evaluation.noise_curve import noise_curve
from gvla2.evaluation.prior_noise import NOISES, PER_CENT
from gvla2.evaluation.protocol import protocol_cameras
from gvla2.evaluation.reports import RECONSTRUCTION
from gvla2.evaluation.results import Cell
from gvla2.evaluation.volume_baselines import aligned_tsdf, carved, dressed
from gvla2.geometry.raycast import RayCaster, Surface
from gvla2.geometry.views import View, Views
from gvla2.reconstruction.contracts import GeometryEstimate
from gvla2.reconstruction.rasteriser import Rasteriser
from gvla2.reconstruction.view_set import ViewSet
from gvla2_plugins.depth_prior import DepthPriorConfig
from gvla2_plugins.depth_prior.noise import LearnedNoise
from gvla2_plugins.depth_prior.prior import DepthPrior


@pytest.fixture(scope="module")
def shape() -> trimesh.Trimesh:
    """A cup: hollow, so that silhouettes alone leave much to gain."""
    profile = np.array([[0, -0.4], [0.35, -0.4], [0.35, 0.4], [0.3, 0.4], [0.3, -0.33], [0, -0.33]])
    return trimesh.creation.revolve(profile, sections=48)


@pytest.fixture(scope="module")
def views(shape) -> Views:
    cameras = list(protocol_cameras("cup", 112)[:5])
    shots = RayCaster([Surface(shape.vertices, shape.faces, np.array([0.7, 0.4, 0.2]), 0)]).cast(cameras, {})
    return Views(
        tuple(
            View(c, s.image, s.depth, (s.ids >= 0).astype(np.float32))
            for c, s in zip(cameras, shots, strict=True)
        )
    )


def off(mesh, shape):
    points = mesh.sample(3000, np.random.default_rng(0))[0]
    return float(cKDTree(shape.sample(30_000, seed=0)).query(points)[0].mean())


def estimate(views, scale=(1, 1, 1, 1, 1)):
    depth = np.stack([view.depth for view in views]) * np.array(scale, dtype=np.float32)[:, None, None]
    return GeometryEstimate(depth, np.isfinite(depth).astype(np.float32))


def test_both_baselines_use_exact_depth_well(views, shape):
    hull = off(ViewSet(views).hull_surface, shape)
    for make in (carved, aligned_tsdf):
        assert off(make(views, estimate(views)), shape) < 0.8 * hull


def test_a_scale_of_each_view_ruins_carving_and_not_the_aligned_tsdf(views, shape):
    wrong = estimate(views, (1.1, 0.92, 1.05, 0.95, 1.08))
    assert off(aligned_tsdf(views, wrong), shape) < off(carved(views, wrong), shape)


def test_a_bare_mesh_is_dressed_like_ours(views):
    thing = dressed(ViewSet(views).hull_surface, views, 2000, Rasteriser())
    assert abs(len(thing.gaussians) / 2000 - 1) < 0.15
    assert thing.mesh.colours is not None


@pytest.mark.parametrize("name", NOISES)
def test_every_noise_is_a_setting_of_the_depth_prior(views, name):
    options = dict(NOISES[name][1])
    parts = LearnedNoise(**options.pop("learned", {}))
    config = DepthPriorConfig(**options, learned=parts)
    found = DepthPrior(config).predict(views)
    again = DepthPrior(config).predict(views)
    np.testing.assert_array_equal(found.depth, again.depth)
    ratio = found.depth / np.stack([v.depth for v in views])
    if name == "exact":
        assert np.nanmax(np.abs(ratio - 1)) == 0
    else:
        assert np.nanstd(ratio) > 5e-4


def test_low_frequency_errors_have_the_size_of_their_name(views):
    for name in NOISES_OF_CURVE[1:]:
        options = dict(NOISES[name][1])
        config = DepthPriorConfig(noise="learned", learned=LearnedNoise(**options["learned"]), erode=0)
        ratio = DepthPrior(config).predict(views).depth / np.stack([v.depth for v in views])
        assert 100 * np.nanstd(ratio) == pytest.approx(PER_CENT[name], rel=0.6)


NOISES_OF_CURVE = tuple(PER_CENT)


def curve_cells(noises):
    for noise in noises:
        for number, name in enumerate("abc"):
            for row, factor in {
                "baseline": 1.0,
                "carving": 0.9,
                "ab_fusion": 0.4 + 0.1 * PER_CENT[noise],
            }.items():
                factors = {"object": name, "variant": row, "noise": noise, "seed": 0, "data": "ycb30"}
                yield Cell(
                    f"{noise}{name}{row}",
                    factors,
                    {"cd_surface": (20 + number) * factor},
                    {"status": "ok"},
                    1,
                )


def test_the_curve_is_a_picture_with_a_line_a_method():
    tables = make_tables(list(curve_cells(NOISES_OF_CURVE)), RECONSTRUCTION)
    drawn = noise_curve(tables)
    assert drawn.startswith("<svg")
    assert drawn.count("<circle") == 2 * len(NOISES_OF_CURVE)
    assert "-60 %" not in drawn
    assert "2 %" in drawn
    assert noise_curve(make_tables(list(curve_cells(NOISES_OF_CURVE[:2])), RECONSTRUCTION)) == ""
