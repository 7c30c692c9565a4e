"""The oracle perceiver: the true scene, marked as such, and an error without a simulator."""

import numpy as np
import pytest

from gvla2 import ComponentConfig
from gvla2.errors import ConfigurationError
from gvla2_plugins.oracle import gvla2_perceivers
from gvla2_plugins.sapien import SapienPandaConfig, gvla2_robots
from gvla2_plugins.tabletop import gvla2_tasks


def oracle(robot):
    (component,) = gvla2_perceivers()
    assert component.needs == ("robot",)
    return component.build(ComponentConfig(), robot=robot)


def test_it_gives_the_true_scene_without_the_names_of_bodies():
    robot = gvla2_robots()[0].build(SapienPandaConfig(image_size=64))
    task = next(c for c in gvla2_tasks() if c.name == "open_jar")
    instance = robot.reset(task.build(task.config()), 2)
    scene = oracle(robot).perceive(robot.observe(), instance.instruction, robot.arm.workspace)
    assert scene.perceiver == "oracle"
    assert "do not use its results" in scene.notes[0]
    assert [o.id for o in scene.objects] == [f"o{i + 1}" for i in range(5)]
    names = {body.name for body in instance.layout.bodies}
    assert not names & {o.id for o in scene.objects}
    assert sum(o.parent != "" for o in scene.objects) == 2
    for obj in scene.objects:
        assert not obj.parent or scene[obj.parent].label.endswith("jar")
    true = sorted(body.world_from_body[0, 3] for body in instance.layout.bodies)
    np.testing.assert_allclose(sorted(o.centre[0] for o in scene.objects), true, atol=2e-3)
    robot.close()


def test_a_robot_without_truth_is_refused():
    with pytest.raises(ConfigurationError, match="perceiver=oracle needs a simulated robot"):
        oracle(object())
