from __future__ import annotations

import numpy as np
import pytest

from gvla2.errors import ConfigurationError
from gvla2.geometry.camera import Camera
from gvla2.geometry.gaussians import SH_C0, Gaussians
from gvla2.testing.reconstruction import check_renderer
from gvla2_plugins.numba_renderer import NumbaRendererConfig, gvla2_renderers

CAMERA = Camera.from_fov(0.5, np.eye(4), 33, 33)


def renderer(**options: float):
    [component] = gvla2_renderers()
    assert component.name == "numba"
    return component.build(NumbaRendererConfig(name="numba", **options))


def test_conformance() -> None:
    check_renderer(renderer())


def gaussians(centres, scales, rgb, opacity=0.8, rotations=None) -> Gaussians:
    n = len(centres)
    return Gaussians(
        centres,
        np.log(np.broadcast_to(scales, (n, 3))),
        np.tile([1.0, 0, 0, 0], (n, 1)) if rotations is None else rotations,
        np.broadcast_to(np.log(opacity / (1 - np.asarray(opacity))), (n,)),
        (np.broadcast_to(rgb, (n, 3)) - 0.5) / SH_C0,
    )


def test_one_gaussian_on_the_axis_is_the_projected_ellipse() -> None:
    scales, depth = np.array([0.02, 0.05, 0.03]), 2.0
    image, alpha = renderer().render(gaussians([[0, 0, depth]], scales, (1, 0, 0)), CAMERA)
    focal = CAMERA.K[0, 0]
    variance = (focal * scales[:2] / depth) ** 2 + 0.3
    offset = CAMERA.pixel_centres() - 16.5
    expected = 0.8 * np.exp(-0.5 * (offset**2 / variance).sum(-1))
    assert np.allclose(alpha, np.where(expected >= 1 / 255, expected, 0), atol=1e-6)
    assert np.allclose(image[..., 0], 1, atol=1e-6)  # red over white
    assert np.allclose(image[..., 1], 1 - alpha, atol=1e-6)


def test_the_nearer_one_covers_whatever_the_order() -> None:
    centres, rgb = np.array([[0, 0, 1.0], [0, 0, 2.0]]), np.array([[1.0, 0, 0], [0, 0, 1.0]])
    opacity = np.array([0.6, 0.9])
    one = renderer().render(gaussians(centres, 5.0, rgb, opacity), CAMERA, (0, 0, 0))
    two = renderer().render(gaussians(centres[::-1], 5.0, rgb[::-1], opacity[::-1]), CAMERA, (0, 0, 0))
    assert np.array_equal(one[0], two[0])
    assert np.allclose(one[0][16, 16], [0.6, 0, 0.4 * 0.9], atol=1e-3)
    assert one[1][16, 16] == pytest.approx(1 - 0.4 * 0.1, abs=1e-3)


def test_options_reach_the_rasteriser() -> None:
    scene = gaussians([[0, 0, 1.0]], 1.0, (0, 0, 0), 0.9)
    assert renderer(near=1.5).render(scene, CAMERA)[1].max() == 0
    with pytest.raises(ConfigurationError, match="low_pass"):
        renderer(low_pass=-1.0)
