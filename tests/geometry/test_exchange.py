"""What several components get is read-only to each of them."""

from dataclasses import replace

import numpy as np
import pytest

from gvla2.geometry.exchange import read_only
from gvla2.geometry.views import Observation, View, Views
from gvla2.testing import inputs


def writable(size: int = 8) -> Observation:
    camera = inputs.cameras(size)[0]
    image, depth = np.zeros((size, size, 3), np.uint8), np.ones((size, size), np.float32)
    return Observation(Views((View(camera, image, depth),)), np.eye(4), np.zeros(6), 1.0, 0.08)


def test_arrays_are_seen_and_not_changed_and_their_maker_still_writes():
    given = writable()
    seen = read_only(given)
    for array in (
        seen.views[0].image, seen.views[0].depth, seen.views[0].camera.K, seen.world_from_tcp, seen.joints,
    ):  # fmt: skip
        with pytest.raises(ValueError, match="read-only"):
            array[...] = 1
    given.views[0].image[...] = 7
    assert (seen.views[0].image == 7).all()


def test_a_box_that_moves_by_a_centre_does_not_exist():
    obj = read_only(inputs.scene()).objects[0]
    before = obj.world_from_object.copy()
    goal = obj.centre
    goal[2] += 0.3
    assert np.array_equal(obj.world_from_object, before)
    with pytest.raises(ValueError, match="read-only"):
        obj.world_from_object[2, 3] += 0.3
    mine = replace(obj, points=obj.points.copy())
    mine.points[...] = 0.0
    assert not (obj.points == 0.0).all()
