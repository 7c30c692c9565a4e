"""The hull, the fusion strategies and the renderer of plugin ``geofuse``."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from gvla2.errors import ConfigurationError, GeometryError
from gvla2.geometry.camera import Camera
from gvla2.geometry.gaussians import SH_C0, Gaussians
from gvla2.testing import inputs
from gvla2_plugins.geofuse import HullConfig, NumbaRendererConfig, gvla2_reconstructors, gvla2_renderers
from gvla2_plugins.geofuse.fusions import Blend, Residual

coordinates = arrays(np.float64, (7, 3), elements=st.floats(-10, 10))
supports = arrays(np.float64, (7,), elements=st.floats(0, 1))
CAMERA = Camera.from_fov(0.5, np.eye(4), 33, 33)


@given(coordinates, coordinates, supports, supports)
def test_formulas(a, b, s_a, s_b):
    np.testing.assert_allclose(Blend(0.25).fuse(a, b, s_a, s_b), 0.75 * a + 0.25 * b, atol=1e-12)
    expected = a + 0.5 * (s_a * s_b)[:, None] * (b - a)
    np.testing.assert_allclose(Residual(0.5).fuse(a, b, s_a, s_b), expected, atol=1e-12)
    np.testing.assert_allclose(Blend(1.0).fuse(a, b, s_a, s_b), b, atol=1e-12)
    np.testing.assert_array_equal(Residual(0.5).fuse(a, a, s_a, s_b), a)


@pytest.mark.parametrize("alpha", [-0.1, 1.1, float("nan")])
def test_a_share_outside_its_range_is_refused(alpha):
    for strategy in (Blend, Residual):
        with pytest.raises(ConfigurationError, match="alpha"):
            strategy(alpha)


def test_sources_that_do_not_match_are_refused():
    with pytest.raises(GeometryError, match="Fusion takes"):
        Residual(0.5).fuse(np.zeros((3, 3)), np.zeros((4, 3)), np.zeros(3), np.zeros(4))


def hull(**options):
    return gvla2_reconstructors()[0].build(HullConfig(**options))


def test_a_cube_on_the_table_from_three_cameras():
    made = hull(resolution=48, gaussians=2000).reconstruct(inputs.views(masked=inputs.RED))
    assert made.status == "ok"
    assert 1500 < len(made.gaussians) < 2500
    # Three cameras from above do not see the underside: the hull may be larger, never smaller.
    size = np.ptp(made.mesh.bounds, axis=0)
    assert (size > 0.9 * inputs.RED.side).all()
    assert (size < 2.6 * inputs.RED.side).all()
    np.testing.assert_allclose(np.median(made.gaussians.rgb, axis=0), inputs.RED.rgb, atol=0.2)


def test_views_without_masks_are_an_error():
    with pytest.raises(GeometryError, match="No view shows the object"):
        hull().reconstruct(inputs.views())


@pytest.mark.parametrize("options", [{"resolution": 4}, {"gaussians": 0}])
def test_options_of_the_hull_that_cannot_be(options):
    with pytest.raises(ConfigurationError, match=next(iter(options))):
        hull(**options)


def renderer(**options: float):
    [component] = gvla2_renderers()
    return component.build(NumbaRendererConfig(name="numba", **options))


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
