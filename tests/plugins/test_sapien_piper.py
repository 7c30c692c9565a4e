"""The simulated Piper: its cell, its hand, its eyes, and the tabletop tasks laid out within its reach."""

import numpy as np
import pytest

from gvla2_plugins.sapien import SapienPiperConfig, gvla2_robots
from gvla2_plugins.tabletop import gvla2_tasks

TABLE_HEIGHT = SapienPiperConfig().table_height

TASKS = {c.name: c for c in gvla2_tasks()}


@pytest.fixture(scope="module")
def piper():
    robot = gvla2_robots()[1].build(SapienPiperConfig(image_size=96))
    yield robot
    robot.close()


def test_the_arm_starts_at_home_and_its_model_agrees_with_the_simulated_one(piper):
    piper.reset(None, 0)
    seen = piper.observe()
    np.testing.assert_allclose(seen.joints, piper.arm.home, atol=1e-4)
    assert seen.gripper_width == pytest.approx(0.07, abs=1e-4)
    simulated = piper._world.link_poses(["tcp"])["tcp"]
    np.testing.assert_allclose(simulated, piper.arm.forward(piper._world.joints), atol=1e-5)
    assert piper._world.touching_links() == set()


@pytest.mark.parametrize("name", ["open_drawer", "sort_object"])
def test_tabletop_tasks_are_laid_out_within_its_reach(piper, name):
    component = TASKS[name]
    instance = piper.reset(component.build(component.config()), 1)
    verdict = piper.success_check()
    assert not verdict.relaxed
    assert not verdict.strict
    for body in instance.layout.bodies:
        assert np.linalg.norm(piper.true_state().pose(body.name)[:3, 3] - body.world_from_body[:3, 3]) < 2e-3
