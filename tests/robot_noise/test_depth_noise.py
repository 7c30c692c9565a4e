import numpy as np
import pytest

from gvla2.errors import ConfigurationError
from gvla2.geometry.camera import Camera
from gvla2.geometry.views import Observation, View, Views
from gvla2.robot.depth_noise import apply_noise
from gvla2.robot.options import DepthNoise

GAUSSIAN = DepthNoise("gaussian", sigma_m=0.002)
L515 = DepthNoise("l515", sigma_m=0.0009, sigma_rel=0.0016, dropout=0.01)


def observed(depth: np.ndarray | None) -> Observation:
    height, width = (200, 200) if depth is None else depth.shape
    camera = Camera.from_fov(0.7, np.eye(4), width, height)
    image = np.full((height, width, 3), 7, dtype=np.uint8)
    return Observation(Views((View(camera, image, depth),)), np.eye(4), np.zeros(7), 1.0, 0.08)


def flat(value: float) -> np.ndarray:
    depth = np.full((200, 200), value, dtype=np.float32)
    depth[:10] = np.nan
    return depth


def test_the_input_is_left_alone_and_the_same_seed_gives_the_same_noise():
    depth = flat(0.8)
    copy = depth.copy()
    before = observed(depth)
    one = apply_noise(before, DepthNoise(sigma_m=0.01, dropout=0.1), np.random.default_rng(3))
    two = apply_noise(before, DepthNoise(sigma_m=0.01, dropout=0.1), np.random.default_rng(3))
    np.testing.assert_array_equal(depth, copy)
    np.testing.assert_array_equal(one.views[0].depth, two.views[0].depth)
    assert not np.array_equal(one.views[0].depth, copy, equal_nan=True)
    assert one.joints is before.joints


@pytest.mark.parametrize(
    "bad", [{"sigma_m": -1.0}, {"sigma_rel": -0.1}, {"dropout": 1.5}, {"sigma_m": np.nan}]
)
def test_values_out_of_range_are_refused(bad):
    with pytest.raises(ConfigurationError, match=rf"depth_noise\.{next(iter(bad))} is "):
        DepthNoise(**bad)


def tilted(angle: float) -> Observation:
    """A plane before the camera whose normal is ``angle`` from the viewing direction."""
    before = observed(flat(1.0))
    camera = before.views[0].camera
    _, rays = camera.rays()
    depth = 1.0 / (1.0 + np.tan(angle) * rays[..., 0])
    view = View(camera, before.views[0].image, depth.astype(np.float32))
    return Observation(Views((view,)), np.eye(4), np.zeros(7), 1.0, 0.08)


def disturbed(before: Observation, seed: int = 0, look: int = 0, **parts) -> View:
    return apply_noise(before, DepthNoise("realistic", **parts), np.random.default_rng(look), seed).views[0]


def test_flying_pixels_lie_between_both_sides_of_a_step():
    depth = np.full((200, 200), 1.5, dtype=np.float32)
    depth[:, 100:] = 1.0
    after = disturbed(observed(depth), flying=0.5).depth
    changed = after != depth
    assert 150 < changed.sum() < 250
    assert set(np.nonzero(changed)[1]) == {99, 100}
    assert ((after[changed] > 1.0) & (after[changed] < 1.5)).all()


def test_grazing_and_dark_surfaces_have_holes():
    steep, straight = (np.isnan(disturbed(tilted(np.deg2rad(a)), grazing=1.0).depth).mean() for a in (82, 20))
    assert steep > 0.5
    assert straight == 0
    before = observed(np.full((200, 200), 1.0, dtype=np.float32))
    assert np.isnan(disturbed(before, dark=0.6).depth).mean() == pytest.approx(0.6, abs=0.03)  # grey 7 of 255
    before.views[0].image[:] = 200
    assert np.isfinite(disturbed(before, dark=1.0).depth).all()


def test_bias_grows_with_range_and_depth_comes_in_steps():
    near, far = (disturbed(observed(flat(z)), bias_rel=0.01).depth[-1, -1] / z for z in (0.5, 2.0))
    assert near == pytest.approx(far, rel=1e-5)
    assert 1e-4 < abs(near - 1) < 0.05
    stepped = disturbed(observed(flat(1.0)), sigma_m=0.002, quantum_m=0.001).depth[10:]
    np.testing.assert_allclose(stepped * 1000, np.rint(stepped * 1000), atol=1e-3)


def test_what_a_camera_has_always_wrong_stays_for_the_episode_and_differs_by_camera_and_seed():
    before = observed(flat(1.0))
    first, again = (disturbed(before, 3, look, exposure=0.1, offset_m=0.002, turn_deg=0.3) for look in (0, 1))
    other = disturbed(before, 4, exposure=0.1, offset_m=0.002, turn_deg=0.3)
    np.testing.assert_array_equal(first.camera.world_from_camera, again.camera.world_from_camera)
    assert not np.allclose(first.camera.world_from_camera, other.camera.world_from_camera)
    assert np.linalg.norm(first.camera.position - before.views[0].camera.position) == pytest.approx(0.002)
    turn = np.arccos((np.trace(first.camera.world_from_camera[:3, :3]) - 1) / 2)
    assert np.degrees(turn) == pytest.approx(0.3, rel=1e-3)


def test_colours_are_noisy_and_exposed_by_camera():
    before = observed(flat(1.0))
    before.views[0].image[:] = 120
    grains = disturbed(before, colour=0.02).image.astype(float)
    assert grains.std() == pytest.approx(255 * 0.02, rel=0.1)
    assert grains.mean() == pytest.approx(120, abs=0.5)
    assert abs(disturbed(before, 1, exposure=0.1).image.mean() - 120) > 1
