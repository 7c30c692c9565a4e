"""Scenes that are right, wrong in one way, and empty."""

import numpy as np
import pytest

from gvla2.evaluation.perception_scoring import (
    extent_errors,
    judged_label,
    object_masks,
    score,
    true_objects,
)
from gvla2.geometry.transform import rigid


def scored(lab, scene):
    return score(true_objects(lab, lab.observation, lab.layout), scene, lab.observation)


@pytest.mark.parametrize("every", [1, 3, 10])
def test_the_truth_scores_best_however_few_points_are_kept(world, body, perceived, scene_of, every):
    one, other = body("near", 0.2), body("far", -0.2, label="blue cube")
    lab = world(one, other)
    seen = [perceived(b, lab.points(b.name, every=every), id=f"o{k}") for k, b in enumerate((other, one))]
    result = scored(lab, scene_of(*seen))
    assert [obj.true.name for obj in result.objects] == ["near", "far"]
    assert [obj.index for obj in result.objects] == [1, 0]
    for obj in result.objects:
        assert obj.iou > (0.98 if every == 1 else 0.85)
        assert obj.label
        assert obj.centre_mm == pytest.approx(0, abs=1e-6)
        assert obj.extent_mm == pytest.approx(0, abs=1e-6)
    assert not result.false


def test_errors_are_measured(world, body, perceived, scene_of):
    one = body("near", 0.2)
    lab = world(one)
    off = rigid(translation=(0.203, 0.004, 0.05))
    obj = perceived(one, lab.points("near"), world_from_object=off, extents=np.array([0.1, 0.09, 0.107]))
    (result,) = scored(lab, scene_of(obj)).objects
    assert result.centre_mm == pytest.approx(5)
    assert result.extents_mm == pytest.approx((0, -10, 7))
    assert result.extent_mm == pytest.approx(10)


def test_level_axes_may_come_in_any_order(body, perceived):
    true = perceived(body("plank", 0.0, size=(0.3, 0.1, 0.02)))
    turn = rigid([[0, 1, 0], [-1, 0, 0], [0, 0, 1]], true.centre)
    seen = perceived(body("plank", 0.0), world_from_object=turn, extents=np.array([0.1, 0.31, 0.02]))
    np.testing.assert_allclose(extent_errors(true, seen), (0.01, 0, 0), atol=1e-12)


def test_a_miss_and_a_phantom(world, body, perceived, scene_of):
    lab = world(body("near", 0.2))
    ghost = perceived(body("ghost", -0.3), np.array([[-0.3, 0.01 * k, 0.0] for k in range(9)]))
    result = scored(lab, scene_of(ghost))
    assert not result.objects[0].found
    assert result.objects[0].centre_mm is None
    assert result.false == ((0, ""),)
    empty = scored(lab, scene_of())
    assert (empty.false, empty.objects[0].index) == ((), -1)


def test_an_object_in_two_pieces_is_found_once_and_has_a_piece_too_many(world, body, perceived, scene_of):
    one = body("near", 0.2)
    lab = world(one)
    points = lab.points("near")
    low = points[:, 1] < 0.02
    halves = [perceived(one, points[low], id="large"), perceived(one, points[~low], id="small")]
    result = scored(lab, scene_of(*halves))
    assert result.objects[0].index == 0
    assert result.false == ((1, "near"),)
    part = [halves[0], perceived(one, points[~low], id="small", parent="large")]
    shown = scored(lab, scene_of(*part))
    assert not shown.false, "a part of the right object is no error"
    assert shown.objects[0].iou > 0.98 > result.objects[0].iou


@pytest.mark.parametrize("cut", [True, False])
def test_how_finely_a_pile_is_cut_is_no_error(world, body, perceived, scene_of, cut):
    bodies = [body(name, 0.1005 * k - 0.1) for k, name in enumerate("abc")]
    lab = world(*bodies)
    if cut:
        scene = scene_of(*(perceived(b, lab.points(b.name)) for b in bodies))
    else:
        scene = scene_of(perceived(bodies[0], lab.points("a", "b", "c"), label="red tower"))
    result = scored(lab, scene)
    (pile,) = result.objects
    assert pile.iou > 0.97
    assert not result.false
    assert pile.label, "heap, tower or row: only the colour counts"
    if cut:
        assert pile.extent_mm == pytest.approx(0, abs=1e-6)


def test_masks_keep_holes_and_stay_inside(world, body, perceived):
    one = body("near", 0.2)
    lab = world(one)
    (mask,) = object_masks(lab.observation, [perceived(one, lab.points("near"))])
    depths = [view.depth for view in lab.observation.views]
    true = np.concatenate([ids[np.isfinite(z)] == 0 for ids, z in zip(lab.ids, depths, strict=True)])
    np.testing.assert_array_equal(mask[true], True)
    assert (mask & ~true).sum() <= 6, "nothing but a corner is closed over"
    assert object_masks(lab.observation, []).shape == (0, len(true))


@pytest.mark.parametrize(
    ("true", "perceived", "judged"),
    [
        ("red cube", "red cube", (True, True)),
        ("red cube", "maroon cube", (False, False)),
        ("rose cup", "pink cup", (True, True)),
        ("yellow mustard bottle", "yellow bottle", (True, True)),
        ("gray umbrella stand", "gray umbrella", (False, True)),
        ("box lid", "teal lid", (True, None)),
        ("handle", "", (False, None)),
        ("", "red cube", (None, None)),
    ],
)
def test_a_label_is_right_by_its_colour_and_its_head_noun(true, perceived, judged):
    assert judged_label(true, perceived) == judged
