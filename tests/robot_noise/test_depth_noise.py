import numpy as np
import pytest

from gvla2.errors import ConfigurationError
from gvla2.geometry.camera import Camera
from gvla2.geometry.views import Observation, View, Views
from gvla2.robot.depth_noise import DepthNoise, apply_noise

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


def test_no_noise_changes_nothing():
    before = observed(flat(1.0))
    after = apply_noise(before, DepthNoise(), np.random.default_rng(0))
    np.testing.assert_array_equal(after.views[0].depth, before.views[0].depth)


def test_gaussian_noise_has_its_deviation_and_keeps_nan():
    before = observed(flat(1.2))
    after = apply_noise(before, GAUSSIAN, np.random.default_rng(0)).views[0]
    error = after.depth[10:] - np.float32(1.2)
    assert after.depth.dtype == np.float32
    assert np.isnan(after.depth[:10]).all()
    assert error.std() == pytest.approx(0.002, rel=0.03)
    assert abs(error.mean()) < 5e-5


@pytest.mark.parametrize(("distance", "deviation"), [(1.0, 0.0025), (9.0, 0.0153)])
def test_l515_noise_grows_with_distance_and_loses_pixels(distance, deviation):
    after = apply_noise(observed(flat(distance)), L515, np.random.default_rng(1)).views[0]
    assert np.nanstd(after.depth[10:] - distance) == pytest.approx(deviation, rel=0.04)
    assert np.isnan(after.depth[10:]).mean() == pytest.approx(0.01, abs=0.003)


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


def test_a_depth_is_never_zero_or_negative():
    after = apply_noise(observed(flat(0.01)), DepthNoise(sigma_m=0.05), np.random.default_rng(0)).views[0]
    assert np.nanmin(after.depth) > 0


def test_colour_cameras_pass_through():
    before = observed(None)
    assert apply_noise(before, GAUSSIAN, np.random.default_rng(0)).views[0].depth is None


@pytest.mark.parametrize(
    "bad", [{"sigma_m": -1.0}, {"sigma_rel": -0.1}, {"dropout": 1.5}, {"sigma_m": np.nan}]
)
def test_values_out_of_range_are_refused(bad):
    with pytest.raises(ConfigurationError, match=r"dropout in \[0, 1\]"):
        DepthNoise(**bad)
