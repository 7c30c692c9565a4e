"""The ablation's drift, and its noises of the prior by name."""

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from gvla2.evaluation.ablation import DRIFTS, NOISES, Drift, DriftSize
from gvla2.evaluation.protocol import protocol_cameras
from gvla2.geometry.gaussians import Gaussians
from gvla2.geometry.mesh import TriangleMesh
from gvla2.geometry.raycast import RayCaster, Surface
from gvla2.geometry.views import View, Views
from gvla2.reconstruction.contracts import Reconstruction
from gvla2_plugins.depth_prior import DepthPriorConfig, LearnedNoise
from gvla2_plugins.depth_prior.prior import DepthPrior


def covariances(gaussians) -> np.ndarray:
    """(N, 3, 3) square metres, in the frame of the centres."""
    axes = Rotation.from_quat(gaussians.rotations, scalar_first=True).as_matrix() * gaussians.scales[:, None]
    return axes @ axes.transpose(0, 2, 1)


@pytest.fixture(scope="module")
def shape() -> trimesh.Trimesh:
    """A cup: hollow, so that silhouettes alone leave much to gain."""
    profile = np.array([[0, -0.4], [0.35, -0.4], [0.35, 0.4], [0.3, 0.4], [0.3, -0.33], [0, -0.33]])
    return trimesh.creation.revolve(profile, sections=48)


@pytest.fixture(scope="module")
def views(shape) -> Views:
    cameras = list(protocol_cameras("cup", 112)[:5])
    shots = RayCaster([Surface(shape.vertices, shape.faces, np.array([0.7, 0.4, 0.2]), 0)]).cast(cameras, {})
    pairs = zip(cameras, shots, strict=True)
    return Views(tuple(View(c, s.image, s.depth, (s.ids >= 0).astype(np.float32)) for c, s in pairs))


@pytest.mark.parametrize("name", NOISES)
def test_every_noise_is_a_repeatable_setting_of_the_depth_prior(views, name):
    options = dict(NOISES[name])
    config = DepthPriorConfig(**{**options, "learned": LearnedNoise(**options.get("learned", {}))})
    found, again = (DepthPrior(config).predict(views).depth for _ in range(2))
    np.testing.assert_array_equal(found, again)
    ratio = found / np.stack([v.depth for v in views])
    if name == "exact":
        assert np.nanmax(np.abs(ratio - 1)) == 0
    else:
        assert np.nanstd(ratio) > 5e-4
    if name.startswith("low"):
        whole = DepthPriorConfig(**{**vars(config), "erode": 0})
        ratio = DepthPrior(whole).predict(views).depth / np.stack([v.depth for v in views])
        assert 100 * np.nanstd(ratio) == pytest.approx(float(name.removeprefix("low")), rel=0.6)


def cloud(count: int = 40) -> Reconstruction:
    rng = np.random.default_rng(0)
    centres = rng.uniform(-0.5, 0.5, (count, 3))
    sizes, turns = rng.normal(-4, 0.1, (count, 3)), rng.normal(size=(count, 4))
    gaussians = Gaussians(centres, sizes, turns, rng.normal(size=count), rng.normal(size=(count, 3)))
    faces = np.arange(count - count % 3).reshape(-1, 3)
    return Reconstruction(gaussians, TriangleMesh(centres, faces))


def test_a_drift_is_known_repeatable_and_within_its_bounds():
    size = DRIFTS["planted"]
    one, again = (Drift.drawn(size, "mug", 3) for _ in range(2))
    np.testing.assert_array_equal(one.scale, again.scale)
    np.testing.assert_array_equal(one.shift, again.shift)
    assert not np.allclose(one.shift, Drift.drawn(size, "mug", 4).shift)
    assert not np.allclose(one.shift, Drift.drawn(size, "bowl", 3).shift)
    assert np.abs(one.shift).max() <= size.shift
    assert np.abs(np.log(one.scale)).max() <= np.log((1 + size.axes) * (1 + size.scale)) + 0.01
    turn = np.degrees(np.arccos(np.clip((np.trace(one.rotation) - 1) / 2, -1, 1)))
    assert turn <= size.degrees + 1e-6


def test_gaussians_and_mesh_drift_together_and_gaussians_turn():
    g0 = cloud()
    moved = Drift.drawn(DRIFTS["planted"], "mug", 0).applied(g0)
    np.testing.assert_allclose(moved.gaussians.centres, moved.mesh.vertices, atol=1e-6)
    assert np.linalg.norm(moved.mesh.vertices - g0.mesh.vertices, axis=1).mean() > 1e-3
    drift = Drift.drawn(DriftSize(degrees=30), "mug", 1)
    expected = drift.rotation @ covariances(g0.gaussians) @ drift.rotation.T
    np.testing.assert_allclose(covariances(drift.applied(g0).gaussians), expected, rtol=1e-3, atol=1e-8)
    nothing = Reconstruction(None, None)
    assert drift.applied(nothing) is nothing
