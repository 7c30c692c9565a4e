import io

import numpy as np
import pytest
from PIL import Image

from gvla2.errors import ConfigurationError
from gvla2.planning.pictures import PictureOptions, encoded
from gvla2.testing import inputs


@pytest.fixture(scope="module")
def view():
    return inputs.observation(160).views[0]


def decoded(png):
    return np.asarray(Image.open(io.BytesIO(png)).convert("RGB")).astype(int)


def test_a_picture_keeps_its_shares_when_it_shrinks(view):
    small = decoded(encoded(view, 80))
    assert small.shape == (80, 80, 3)
    red = [
        np.argwhere(a[..., 0] - a[..., 2] > 100).mean(axis=0) / len(a)
        for a in (small, view.image.astype(int))
    ]
    np.testing.assert_allclose(red[0], red[1], atol=0.01)


def test_a_small_picture_is_sent_as_it_is(view):
    np.testing.assert_array_equal(decoded(encoded(view, 1024)), view.image)


def test_a_grid_draws_on_the_copy_alone(view):
    before = view.image.copy()
    drawn = decoded(encoded(view, 1024, grid=True, scale=1000))
    np.testing.assert_array_equal(view.image, before)
    changed = (drawn != before).any(axis=-1)
    assert changed[:, 16].mean() > 0.9, "a line stands at a tenth"
    assert 0.02 < changed.mean() < 0.3


@pytest.mark.parametrize("longest", [0, 63, 5000, -1])
def test_sizes_that_no_model_can_use_are_refused(longest):
    with pytest.raises(ConfigurationError, match="longest is"):
        PictureOptions(longest=longest)
