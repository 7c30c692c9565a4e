import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from gvla2.errors import ConfigurationError, GeometryError
from gvla2.testing import check_component
from gvla2_plugins.fusions import gvla2_fusion_strategies
from gvla2_plugins.fusions.strategies import Blend, Residual

coordinates = arrays(np.float64, (7, 3), elements=st.floats(-10, 10))
supports = arrays(np.float64, (7,), elements=st.floats(0, 1))


@pytest.mark.parametrize("component", gvla2_fusion_strategies(), ids=lambda c: c.name)
def test_conformance(component):
    check_component(component, "fusion")


@given(coordinates, coordinates, supports, supports)
def test_formulas(a, b, s_a, s_b):
    np.testing.assert_allclose(Blend(0.25).fuse(a, b, s_a, s_b), 0.75 * a + 0.25 * b, atol=1e-12)
    expected = a + 0.5 * (s_a * s_b)[:, None] * (b - a)
    np.testing.assert_allclose(Residual(0.5).fuse(a, b, s_a, s_b), expected, atol=1e-12)
    np.testing.assert_allclose(Blend(1.0).fuse(a, b, s_a, s_b), b, atol=1e-12)


@given(coordinates, supports)
def test_two_equal_sources_are_left_alone(a, s):
    for strategy in (Blend(0.5), Residual(0.5)):
        np.testing.assert_array_equal(strategy.fuse(a, a, s, s), a)


@pytest.mark.parametrize("alpha", [-0.1, 1.1, float("nan")])
def test_a_share_outside_its_range_is_refused(alpha):
    for strategy in (Blend, Residual):
        with pytest.raises(ConfigurationError, match="alpha"):
            strategy(alpha)


def test_sources_that_do_not_match_are_refused():
    with pytest.raises(GeometryError, match="Fusion takes"):
        Residual(0.5).fuse(np.zeros((3, 3)), np.zeros((4, 3)), np.zeros(3), np.zeros(4))
