"""Scenes that are right, wrong in one way, and empty."""

import numpy as np
import pytest

from gvla2.evaluation.perception_scoring import label_right, score, side_errors, true_objects
from gvla2.geometry.transform import rigid


def scored(lab, scene):
    return score(true_objects(lab, lab.observation, lab.layout), scene)


def test_the_truth_scores_best_and_errors_are_measured(world, body, perceived, scene_of):
    one, other = body("near", 0.2), body("far", -0.2, label="blue cube")
    lab = world(one, other)
    off = rigid(translation=(0.203, 0.004, 0.05))
    wrong = perceived(one, world_from_object=off, extents=np.array([0.1, 0.09, 0.107]), label="red ball")
    (near, far), false = scored(lab, scene_of(perceived(other), wrong))
    assert [(obj.true.name, obj.index, obj.named) for obj in (near, far)] == [
        ("near", 1, False), ("far", 0, True),
    ]  # fmt: skip
    assert (near.centre_mm, near.side_mm) == (pytest.approx(5), pytest.approx(10))
    assert (far.centre_mm, far.side_mm) == (pytest.approx(0), pytest.approx(0))
    assert not false


def test_level_axes_may_come_in_any_order(body, perceived):
    true = perceived(body("plank", 0.0, size=(0.3, 0.1, 0.02)))
    turn = rigid([[0, 1, 0], [-1, 0, 0], [0, 0, 1]], true.centre)
    seen = perceived(body("plank", 0.0), world_from_object=turn, extents=np.array([0.1, 0.31, 0.02]))
    np.testing.assert_allclose(side_errors(true, seen), (0.01, 0, 0), atol=1e-12)


def test_a_miss_and_a_phantom(world, body, perceived, scene_of):
    lab = world(body("near", 0.2))
    (missed,), false = scored(lab, scene_of(perceived(body("ghost", -0.3))))
    assert (missed.index, missed.centre_mm, false) == (-1, None, [0])
    (missed,), false = scored(lab, scene_of())
    assert (missed.index, false) == (-1, [])


def test_a_tower_seen_as_one_object_stands_for_its_bricks(world, body, perceived, scene_of):
    bodies = [body(name, 0.1005 * k - 0.1) for k, name in enumerate("abc")]
    lab = world(*bodies)
    whole = perceived(bodies[1], extents=np.array([0.301, 0.1, 0.1]), label="red tower")
    objects, false = scored(lab, scene_of(whole))
    assert all(obj.index >= 0 and obj.named is None and obj.side_mm is None for obj in objects)
    assert not false
    objects, false = scored(lab, scene_of(*map(perceived, bodies)))
    assert all(obj.named for obj in objects)
    assert objects[-1].side_mm == pytest.approx(0)
    assert objects[0].side_mm is None, "the bricks before it hide its side"
    assert not false


@pytest.mark.parametrize(
    ("true", "perceived", "right"),
    [
        ("red cube", "red cube", True),
        ("red cube", "maroon cube", False),
        ("rose cup", "pink cup", True),
        ("yellow mustard bottle", "yellow bottle", True),
        ("gray umbrella stand", "gray umbrella", False),
        ("box lid", "teal lid", True),
        ("handle", "", False),
        ("", "red cube", None),
    ],
)
def test_a_label_is_right_by_its_colour_and_its_head_noun(true, perceived, right):
    assert label_right(true, perceived) is right


def test_a_hidden_object_need_not_be_found(world, body):
    hidden = body("inside", 0.0, size=(0.05, 0.05, 0.05), label="blue cube")
    lab = world(body("outside", 0.0), hidden)
    assert [obj.name for obj in true_objects(lab, lab.observation, lab.layout)] == ["outside"]
