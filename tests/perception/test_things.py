import numpy as np
import pytest

from gvla2.perception.objects import coarse_shape, numbered, object_of


def box_points(size, yaw, at, rng, count=3000):
    points = rng.uniform(-0.5, 0.5, (count, 3))
    axis = rng.integers(0, 3, count)
    points[np.arange(count), axis] = np.sign(points[np.arange(count), axis]) * 0.5
    c, s = np.cos(yaw), np.sin(yaw)
    return (points * size) @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]).T + at


def test_a_box_is_measured_whatever_its_turn():
    points = box_points([0.12, 0.06, 0.05], 0.7, [0.3, 0.1, 0.525], np.random.default_rng(0))
    obj = object_of(points, np.full((len(points), 3), [0.9, 0.1, 0.1]), 0.5, 1.0)
    assert sorted(obj.extents) == pytest.approx([0.05, 0.06, 0.12], abs=0.003)
    assert obj.centre == pytest.approx([0.3, 0.1, 0.525], abs=0.003)
    assert (obj.colour, obj.shape) == ("red", "box")
    assert obj.label == "red box"


@pytest.mark.parametrize(("height", "shape"), [(0.1, "cylinder"), (0.02, "disc")])
def test_round_objects_are_reported(height, shape):
    angles = np.linspace(0, 2 * np.pi, 400)
    ring = np.stack([0.04 * np.cos(angles), 0.04 * np.sin(angles)], axis=1)
    points = np.concatenate([np.column_stack([ring, np.full(400, z)]) for z in (0.0, height)])
    assert coarse_shape(points, np.array([0.08, 0.08, height]), np.zeros(2)) == shape


def test_numbers_follow_places_not_the_order_found():
    rng = np.random.default_rng(1)
    made = [
        object_of(box_points([0.05] * 3, 0, [x, 0, 0.025], rng), np.ones((3000, 3)), 0.0, 1.0)
        for x in (0.4, 0.2)
    ]
    assert [round(float(o.centre[0]), 1) for o in numbered(made)] == [0.2, 0.4]
