"""The objects to find: bodies, parts and piles in sight; and the simulator's own masks."""

import numpy as np

from gvla2.evaluation.perception_scoring import Segmented, true_objects
from gvla2.geometry.transform import invert_rigid, rigid, transform_points
from gvla2.plugins.registry import Registry
from gvla2.robot.task import Body, Primitive


def objects_of(world):
    return {obj.name: obj for obj in true_objects(world, world.observation, world.layout)}


def test_masks_are_the_pixels_of_all_views(world, body):
    lab = world(body("near", 0.2), body("far", -0.2))
    found = objects_of(lab)
    assert found.keys() == {"near", "far"}
    for index, name in enumerate(("near", "far")):
        assert found[name].mask.sum() == sum((ids == index).sum() for ids in lab.ids) > 100


def test_pixels_without_depth_do_not_count(world, body):
    lab = world(body("near", 0.2))
    before = int(objects_of(lab)["near"].mask.sum())
    rows, columns = np.nonzero(lab.ids[0] == 0)
    lab.observation.views[0].depth[rows[:30], columns[:30]] = np.nan
    assert objects_of(lab)["near"].mask.sum() == before - 30


def test_a_part_is_an_object_and_belongs_to_its_whole(world):
    solids = (
        Primitive("box", (0.1, 0.1, 0.1), (1, 0, 0)),
        Primitive("box", (0.05, 0.05, 0.1), (1, 0, 0), rigid(translation=(0, 0, 0.1))),
    )
    pose = rigid(translation=(0, 0, 0.05))
    lab = world(Body("knife", solids, pose, label="red knife", parts=(("handle", (1,)),)))
    found = objects_of(lab)
    handle, knife = found["knife/handle"], found["knife"]
    assert handle.part
    assert not knife.part
    assert handle.label == "handle"
    assert 0 < handle.mask.sum() < knife.mask.sum()
    assert not (handle.mask & ~knife.mask).any()


def test_touching_objects_of_one_label_are_one_pile(world, body):
    lab = world(body("a", 0.0), body("b", 0.1005), body("c", 0.3), body("d", -0.101, label="blue cube"))
    found = objects_of(lab)
    assert found.keys() == {"a+1", "c", "d"}
    pile = found["a+1"]
    assert (pile.bodies, pile.label) == (2, "red cube")
    np.testing.assert_allclose(pile.box.extents, (0.2005, 0.1, 0.1))
    np.testing.assert_allclose(pile.box.centre, (0.05025, 0, 0.05))


def test_a_hidden_object_need_not_be_found(world, body):
    hidden = body("inside", 0.0, size=(0.05, 0.05, 0.05), label="blue cube")
    assert objects_of(world(body("outside", 0.0), hidden)).keys() == {"outside"}


def test_pixels_lie_on_the_object_they_show(registry: Registry):
    root = {"robot": {"name": "sapien_panda", "image_size": 128}, "camera": "none", "task": "put_knife"}
    built = registry.build_all(root, ("robot", "task"))
    robot = built["robot"]
    assert isinstance(robot, Segmented)
    instance = robot.reset(built["task"], 5)
    observation = robot.observe()
    names, images = robot.true_masks(observation)
    boxes = {obj.id: obj for obj in robot.true_scene().objects}
    assert set(names) <= set(boxes)
    parts = {f"{body.name}/{label}" for body in instance.layout.bodies for label, _ in body.parts}
    assert parts
    assert parts <= set(names)
    seen = set()
    for view, image in zip(observation.views, images, strict=True):
        assert image.shape == view.image.shape[:2]
        deep_inside = view.robot_mask & (image >= 0)
        assert deep_inside.mean() < 1e-3, "the robot hides what is behind it"
        points = view.points()
        for index, name in enumerate(names):
            on = points[image == index]
            if not len(on) or "/" in name or any(part.startswith(f"{name}/") for part in parts):
                continue
            seen.add(name)
            box = boxes[name]
            off = np.abs(transform_points(invert_rigid(box.world_from_object), on)) - 0.5 * box.extents
            assert off.max() < 2e-3
    assert seen
    objects = {obj.name: obj for obj in true_objects(robot, observation, instance.layout)}
    assert "knife" in objects
    assert "knife/handle" not in objects, "a knife in its block is its handle"
    assert objects["knife"].seen.min() < 0.8 < objects["board"].seen.min(), "the blade is out of sight"
    robot.close()
