"""The simulator's own masks, and the objects that they show."""

import numpy as np

from gvla2.evaluation.perception_scoring import Segmented, true_objects
from gvla2.geometry.transform import invert_rigid, transform_points
from gvla2.plugins.registry import Registry


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
    assert objects["board"].in_sight
    assert not objects["knife"].in_sight, "its blade is in the block"
    robot.close()
