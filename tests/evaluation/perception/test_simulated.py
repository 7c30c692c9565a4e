"""The simulator's masks: each pixel's point lies on the body that it is said to show."""

import numpy as np
import pytest

from gvla2.evaluation.perception.truth import Segmented, true_things
from gvla2.geometry.transform import invert_rigid, transform_points
from gvla2.plugins.registry import Registry


@pytest.mark.parametrize("task", ["put_knife", "open_drawer"])
def test_pixels_lie_on_what_they_show(registry: Registry, task):
    root = {"robot": {"name": "sapien_panda", "image_size": 128}, "camera": "none", "task": task}
    built = registry.build_all(root, ("robot", "task"))
    robot = built["robot"]
    assert isinstance(robot, Segmented)
    instance = robot.reset(built["task"], 5)
    observation = robot.observe()
    names, images = robot.true_masks(observation)
    boxes = {thing.id: thing for thing in robot.true_scene().objects}
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
    kinds = {thing.name: thing for thing in true_things(robot, observation, instance.layout)}
    for name in parts & kinds.keys():
        whole = kinds[name.partition("/")[0]]
        assert (kinds[name].whole <= whole.whole).all()
    robot.close()


def test_a_knife_in_its_block_is_its_handle(registry: Registry):
    root = {"robot": {"name": "sapien_panda", "image_size": 128}, "camera": "none", "task": "put_knife"}
    built = registry.build_all(root, ("robot", "task"))
    robot = built["robot"]
    instance = robot.reset(built["task"], 5)
    things = {t.name: t for t in true_things(robot, robot.observe(), instance.layout)}
    assert "knife" in things
    assert "knife/handle" not in things
    assert things["knife"].seen.min() < 0.8 < things["board"].seen.min(), "the blade is out of sight"
    robot.close()
