"""Regions of space, and hollow objects made of solid pieces."""

import numpy as np
import pytest
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from gvla2.geometry.transform import rigid
from gvla2.robot.solids import Volume, cup, extent, square_ring, tray
from gvla2.robot.task import Body, Primitive

RED = (1.0, 0.0, 0.0)
coordinates = st.tuples(*[st.floats(-0.3, 0.3)] * 3)
turns = st.tuples(*[st.floats(-3, 3)] * 3)


def posed(turn, xyz):
    return rigid(Rotation.from_rotvec(turn).as_matrix(), xyz)


def body(*solids):
    return Body("object", solids, np.eye(4))


def test_the_corner_of_a_box_is_not_in_the_round_volume_that_fills_it():
    box = Volume(np.eye(4), (0.2, 0.2, 0.1))
    round_one = Volume(np.eye(4), (0.2, 0.2, 0.1), round=True)
    corner = np.array([0.09, 0.09, 0.0])
    assert box.holds(corner)
    assert not round_one.holds(corner)
    speck = body(Primitive("box", (0.01, 0.01, 0.01), RED))
    assert box.meets(speck, rigid(translation=corner))
    assert not round_one.meets(speck, rigid(translation=corner))


@pytest.mark.parametrize("turn", np.linspace(0, np.pi, 7))
def test_a_cup_is_hollow_and_has_its_size(turn):
    made = cup(0.093, 0.147, 0.004, RED)
    obj = body(*made)
    inside = Volume(posed((0, 0, turn), (0, 0, 0.08)), (0.058, 0.058, 0.13))
    assert not inside.meets(obj, np.eye(4))  # room for a finger
    low, high = extent(made)
    np.testing.assert_allclose(low[2], 0.0, atol=1e-12)
    np.testing.assert_allclose(high[2], 0.147, atol=1e-12)
    np.testing.assert_allclose(high[:2] - low[:2], 0.093, rtol=0.03)
    assert Volume(rigid(translation=(0, 0, 0.002)), (0.01, 0.01, 0.002)).meets(obj, np.eye(4))


def test_trays_and_rings_have_walls_all_round():
    for made, height in (
        (tray((0.3, 0.2, 0.05), 0.01, RED), 0.05),
        (square_ring((0.05, 0.05, 0.01), 0.01, RED), 0.01),
    ):
        low, high = extent(made)
        assert high[2] - low[2] == pytest.approx(height)
        obj = body(*made)
        for x, y in ((1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (-1, -1)):
            spot = np.array([x, y, 0]) * (high - 0.004) + (0, 0, 0.8 * height)
            assert Volume(rigid(translation=spot), (0.001,) * 3).meets(obj, np.eye(4)), (x, y)
        middle = Volume(rigid(translation=(0, 0, 0.8 * height)), (0.02, 0.02, 0.001))
        assert not middle.meets(obj, np.eye(4))
