"""What there is to find: bodies, parts, piles, and nothing that nobody sees."""

import numpy as np

from gvla2.evaluation.perception.truth import true_things
from gvla2.geometry.transform import rigid
from gvla2.robot.task import Body, Primitive


def things_of(world):
    return {thing.name: thing for thing in true_things(world, world.observation, world.layout)}


def test_masks_are_the_pixels_of_all_views(world, body):
    lab = world(body("near", 0.2), body("far", -0.2))
    found = things_of(lab)
    assert found.keys() == {"near", "far"}
    assert found["near"].kind == "cube"
    for index, name in enumerate(("near", "far")):
        assert found[name].whole.sum() == sum((ids == index).sum() for ids in lab.ids) > 100


def test_pixels_without_depth_do_not_count(world, body):
    lab = world(body("near", 0.2))
    before = int(things_of(lab)["near"].whole.sum())
    rows, columns = np.nonzero(lab.ids[0] == 0)
    lab.observation.views[0].depth[rows[:30], columns[:30]] = np.nan
    assert things_of(lab)["near"].whole.sum() == before - 30


def test_a_part_is_a_thing_and_belongs_to_its_whole(world):
    solids = (
        Primitive("box", (0.1, 0.1, 0.1), (1, 0, 0)),
        Primitive("box", (0.05, 0.05, 0.1), (1, 0, 0), rigid(translation=(0, 0, 0.1))),
    )
    pose = rigid(translation=(0, 0, 0.05))
    lab = world(Body("knife", solids, pose, label="red knife", parts=(("handle", (1,)),)))
    found = things_of(lab)
    handle, knife = found["knife/handle"], found["knife"]
    assert handle.part
    assert not knife.part
    assert (handle.label, handle.kind) == ("handle", "handle")
    assert not (handle.whole & knife.bare).any()
    np.testing.assert_array_equal(knife.whole, handle.whole | knife.bare)


def test_touching_things_of_one_label_are_one_pile(world, body):
    lab = world(body("a", 0.0), body("b", 0.1005), body("c", 0.3), body("d", -0.101, label="blue cube"))
    found = things_of(lab)
    assert found.keys() == {"a+1", "c", "d"}
    pile = found["a+1"]
    assert (pile.count, pile.label, pile.kind) == (2, "red pile", "pile of cubes")
    np.testing.assert_allclose(pile.box.extents, (0.2005, 0.1, 0.1))
    np.testing.assert_allclose(pile.box.centre, (0.05025, 0, 0.05))


def test_what_is_hidden_is_not_asked_for(world, body):
    hidden = body("inside", 0.0, size=(0.05, 0.05, 0.05), label="blue cube")
    assert things_of(world(body("outside", 0.0), hidden)).keys() == {"outside"}
