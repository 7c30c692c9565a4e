from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gvla2.errors import ConfigurationError
from gvla2.geometry.camera import Camera
from gvla2.geometry.gaussians import Gaussians
from gvla2.geometry.transform import look_along
from gvla2.testing.reconstruction import check_renderer
from gvla2_plugins import reference_renderer
from gvla2_plugins.numba_renderer import NumbaRendererConfig, gvla2_renderers


def renderer(**options: float):
    [component] = gvla2_renderers()
    assert component.name == "numba"
    return component.build(NumbaRendererConfig(name="numba", **options))


def test_conformance() -> None:
    check_renderer(renderer())


@settings(max_examples=8, deadline=None)
@given(st.integers(0, 2**32 - 1), st.sampled_from([None, 9, 24, 45]))
def test_it_paints_what_the_reference_renderer_paints(seed: int, harmonics: int | None) -> None:
    rng = np.random.default_rng(seed)
    n = 300
    scene = Gaussians(
        rng.normal(scale=0.3, size=(n, 3)),
        np.log(rng.uniform(0.003, 0.08, (n, 3))),
        rng.normal(size=(n, 4)),
        rng.uniform(-3, 5, n),
        rng.normal(size=(n, 3)),
        None if harmonics is None else rng.normal(scale=0.2, size=(n, harmonics)),
    )
    camera = Camera.from_fov(0.6, look_along([0.3, -1.2, 0.5], [-0.3, 1.2, -0.5]), 70, 45)
    [component] = reference_renderer.gvla2_renderers()
    reference = component.build(reference_renderer.ReferenceRendererConfig(name="reference"))
    background = (0.1, 0.5, 0.9)
    wanted = reference.render(scene, camera, background)
    image, alpha = renderer(stop=0.0).render(scene, camera, background)
    # A pixel on the edge of an ellipse may be counted by one and not by the other: 1/255 of a colour up to 4.
    assert np.abs(alpha - wanted[1]).max() < 5e-3
    assert np.abs(image - wanted[0]).max() < 2e-2
    assert np.abs(image - wanted[0]).mean() < 2e-5


def test_options_reach_the_rasteriser() -> None:
    scene = Gaussians([[0, 0, 1.0]], [[0.0, 0, 0]], [[1.0, 0, 0, 0]], [9.0], [[0.0, 0, 0]])
    camera = Camera.from_fov(0.5, np.eye(4), 9, 9)
    assert renderer(max_alpha=0.7).render(scene, camera)[1].max() == pytest.approx(0.7)
    assert renderer(near=1.5).render(scene, camera)[1].max() == 0
    with pytest.raises(ConfigurationError, match="min_alpha"):
        renderer(min_alpha=0.0)
