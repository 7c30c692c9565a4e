from dataclasses import replace

import numpy as np
import pytest

from gvla2.errors import PerceptionError
from gvla2.geometry.transform import rigid
from gvla2.geometry.views import Views
from gvla2.perception.frames import filled, frames_of, raised
from gvla2.planning.scene import Box


def test_the_table_is_found_and_what_stands_on_it_is_above(world, two):
    frames, table, notes = frames_of(two.observation.views, world.WORKSPACE)
    assert table.height_at(0.2, 0.0) == pytest.approx(world.TABLE, abs=5e-4)
    assert not notes
    for frame, truth in zip(frames, two.truth, strict=True):
        up = raised(frame, table, world.WORKSPACE)
        assert (up & (truth > 0)).sum() > 0.9 * (truth > 0).sum()
        assert not (up & (truth <= 0)).sum() > 3


def test_a_camera_that_is_out_by_millimetres_is_set_right(world, two):
    views = list(two.observation.views)
    camera = views[1].camera
    off = rigid(
        [[1, 0, 0], [0, np.cos(0.005), -np.sin(0.005)], [0, np.sin(0.005), np.cos(0.005)]], (0, 0, 0.003)
    )
    views[1] = replace(views[1], camera=replace(camera, world_from_camera=off @ camera.world_from_camera))
    frames, table, _ = frames_of(Views(tuple(views)), world.WORKSPACE)
    bare = frames[1].height[(two.truth[1] == 0) & (np.abs(frames[1].points[..., 0] - 0.25) < 0.3)]
    assert abs(np.median(bare)) < 5e-4
    assert table.height_at(0.2, 0.0) == pytest.approx(world.TABLE, abs=2e-3)


def test_a_camera_without_depth_is_left_out_and_named(world, two):
    views = list(two.observation.views)
    views[0] = replace(views[0], depth=np.full_like(views[0].depth, np.nan))
    views[2] = replace(views[2], image=np.zeros_like(views[2].image))
    frames, _, notes = frames_of(Views(tuple(views)), world.WORKSPACE)
    assert [f.view.name for f in frames] == ["camera_1", "camera_3"]
    assert "camera_0" in notes[0]
    assert "black" in notes[1]


@pytest.mark.parametrize(
    ("broken", "said"),
    [
        ("blind", "No view can be used"),
        ("away", "hundreds"),
        ("millimetres", "depth in metres"),
        ("tilted", "tilted by 30 degrees"),
        ("empty", "low must be below high"),
    ],
)
def test_what_cannot_be_perceived_is_said(world, two, broken, said):
    views, workspace = two.observation.views, world.WORKSPACE
    if broken == "blind":
        views = Views(tuple(replace(v, depth=None) for v in views))
    elif broken == "away":
        workspace = Box(workspace.low + 5, workspace.high + 5)
    elif broken == "millimetres":
        views = Views(tuple(replace(v, depth=1000.0 * v.depth) for v in views))
    elif broken == "tilted":
        c, s = np.cos(np.pi / 6), np.sin(np.pi / 6)
        middle = 0.5 * (workspace.low + workspace.high) * [1, 1, 0] + [0, 0, world.TABLE]
        turn = np.array([[1, 0, 0], [0, c, -s], [0, s, c]])
        tilt = rigid(turn, middle - turn @ middle)
        views = Views(
            tuple(
                replace(v, camera=replace(v.camera, world_from_camera=tilt @ v.camera.world_from_camera))
                for v in views
            )
        )
    else:
        workspace = Box(workspace.high, workspace.low)
    with pytest.raises(PerceptionError, match=said):
        frames_of(views, workspace)


ROWS, COLUMNS = np.mgrid[0:60, 0:60].astype(float)
SLOPE = 1.0 + 0.002 * ROWS - 0.001 * COLUMNS
GRAY = np.full((60, 60, 3), 90, np.uint8)


@pytest.fixture
def thinned():
    """A slope without seven of ten pixels."""
    lost = np.random.default_rng(0).random(SLOPE.shape) < 0.7
    return np.where(lost, np.nan, SLOPE)


def test_what_a_dark_slope_lost_is_filled_from_the_rest(thinned):
    whole = filled(thinned, GRAY)
    assert np.isfinite(whole).mean() > 0.93
    assert np.nanmax(np.abs(whole - SLOPE)) < 0.004
    known = np.isfinite(thinned)
    assert (whole[known] == thinned[known]).all()


def test_nothing_is_filled_across_colours_or_steps_or_outside(thinned):
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
