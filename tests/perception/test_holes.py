import numpy as np
import pytest

from gvla2.perception.frames import filled

ROWS, COLUMNS = np.mgrid[0:60, 0:60].astype(float)
SLOPE = 1.0 + 0.002 * ROWS - 0.001 * COLUMNS
GRAY = np.full((60, 60, 3), 90, np.uint8)


@pytest.fixture
def thinned():
    """A slope of which seven of ten pixels lack."""
    lost = np.random.default_rng(0).random(SLOPE.shape) < 0.7
    return np.where(lost, np.nan, SLOPE)


def test_what_a_dark_slope_lost_is_told_from_the_rest(thinned):
    whole = filled(thinned, GRAY)
    assert np.isfinite(whole).mean() > 0.93
    assert np.nanmax(np.abs(whole - SLOPE)) < 0.004
    known = np.isfinite(thinned)
    assert (whole[known] == thinned[known]).all()


def test_nothing_is_told_across_colours_or_steps_or_outside(thinned):
    painted = GRAY.copy()
    painted[:, 30:] = (200, 30, 30)
    depth = np.where(COLUMNS < 30, SLOPE, np.nan)
    assert np.isnan(filled(depth, painted)[:, 30:]).all()
    stairs = np.where(COLUMNS < 29, 1.0, 1.3)
    stairs[:, 29:31] = np.nan
    assert np.isnan(filled(stairs, GRAY)[:, 29:31]).all()
    within = COLUMNS < 10
    assert (np.isfinite(filled(thinned, GRAY, within)) == np.isfinite(thinned))[~within].all()


def test_a_wide_hole_and_an_empty_picture_stay():
    hole = SLOPE.copy()
    hole[20:40, 20:40] = np.nan
    assert np.isnan(filled(hole, GRAY)[24:36, 24:36]).all()
    assert np.isnan(filled(np.full_like(SLOPE, np.nan), GRAY)).all()
    assert (filled(SLOPE, GRAY) == SLOPE).all()
