import numpy as np
import pytest

from gvla2.errors import ConfigurationError, GeometryError
from gvla2.testing import inputs
from gvla2_plugins.hull import HullConfig, gvla2_reconstructors


def _hull(**options):
    (component,) = gvla2_reconstructors()
    assert component.name == "hull"
    return component.build(HullConfig(**options))


def test_a_cube_on_the_table_from_three_cameras():
    made = _hull(resolution=48, gaussians=2000).reconstruct(inputs.views(masked=inputs.RED))
    assert made.status == "ok"
    assert 1500 < len(made.gaussians) < 2500
    # Three cameras from above do not see the underside: the hull may be larger, never smaller.
    size = np.ptp(made.mesh.bounds, axis=0)
    assert (size > 0.9 * inputs.RED.side).all()
    assert (size < 2.6 * inputs.RED.side).all()
    np.testing.assert_allclose(np.median(made.gaussians.rgb, axis=0), inputs.RED.rgb, atol=0.2)


def test_views_without_masks_are_an_error():
    with pytest.raises(GeometryError, match="No view shows the object"):
        _hull().reconstruct(inputs.views())


@pytest.mark.parametrize("options", [{"resolution": 4}, {"gaussians": 0}])
def test_options_that_cannot_be(options):
    with pytest.raises(ConfigurationError, match=next(iter(options))):
        _hull(**options)
