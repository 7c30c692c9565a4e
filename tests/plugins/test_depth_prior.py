from dataclasses import replace

import numpy as np
import pytest

from gvla2.errors import ConfigurationError
from gvla2.geometry.camera import Camera
from gvla2.geometry.transform import look_along
from gvla2.geometry.views import View, Views
from gvla2_plugins.depth_prior import DepthPriorConfig, gvla2_geometry_priors


def build(**options):
    (component,) = gvla2_geometry_priors()
    return component.build(DepthPriorConfig(**options))


def view(depth, mask=None, name="one") -> View:
    height, width = np.shape(depth)
    camera = Camera.from_fov(0.8, look_along([0.0, -2.0, 0.0], [0.0, 1.0, 0.0]), width, height, name)
    image = np.zeros((height, width, 3), np.uint8)
    mask = None if mask is None else np.asarray(mask, np.float32)
    return View(camera, image, np.asarray(depth, np.float32), mask)


def square() -> np.ndarray:
    depth = np.full((20, 24), np.nan)
    depth[5:15, 6:18] = 2.0
    return depth


def test_it_hands_on_the_measured_depth():
    found = build(erode=0).predict(Views((view(square()),)))
    np.testing.assert_array_equal(found.depth[0], square().astype(np.float32))
    np.testing.assert_array_equal(found.confidence[0], np.isfinite(square()).astype(np.float32))
    assert found.world_from_camera is None


def test_flying_pixels_of_the_border_go_and_steady_ones_stay():
    depth = square()
    depth[5, 6:18] = 3.0  # mixed with what lies behind
    found = build().predict(Views((view(depth),))).depth[0]
    assert np.isnan(found[5]).all()
    assert np.isfinite(found[6:15, 6:18]).all()


def test_only_what_the_mask_shows_counts():
    mask = np.zeros((20, 24))
    mask[:10] = 1
    found = build(erode=0).predict(Views((view(square(), mask),)))
    assert not np.isfinite(found.depth[0, 10:]).any()
    assert np.isfinite(found.depth[0, 5:10, 6:18]).all()


def test_views_without_depth_are_unknown_and_none_at_all_is_no_prior():
    seen = view(square())
    blind = replace(view(square(), name="two"), depth=None)
    found = build(erode=0).predict(Views((seen, blind)))
    assert np.isfinite(found.depth[0]).any()
    assert not np.isfinite(found.depth[1]).any()
    assert not found.confidence[1].any()
    assert build().predict(Views((blind,))) is None
    assert build().predict(Views((view(np.zeros((5, 5))),))) is None


@pytest.mark.parametrize(
    ("options", "words"),
    [({"erode": -1}, "erode"), ({"noise": "none"}, "available"), ({"sensor_sigma": -1.0}, "sensor_sigma")],
)
def test_bad_options_are_refused(options, words):
    with pytest.raises(ConfigurationError, match=words):
        build(**options)
