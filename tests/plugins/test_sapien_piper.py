"""The simulated Piper: its cell, its hand, its eyes, and the tabletop tasks laid out within its reach."""

from dataclasses import replace

import numpy as np
import pytest

from gvla2.errors import ConfigurationError
from gvla2.geometry.transform import rigid
from gvla2.planning.scene import Scene
from gvla2.planning.trajectory import Orientation, Trajectory, Waypoint
from gvla2.robot.task import Body, Layout, Primitive, TaskInstance
from gvla2.testing.component import check_component
from gvla2_plugins.sapien import SapienPiperConfig, gvla2_robots
from gvla2_plugins.tabletop import gvla2_tasks

TABLE_HEIGHT = SapienPiperConfig().table_height

TASKS = {c.name: c for c in gvla2_tasks()}


@pytest.fixture(scope="module")
def piper():
    robot = gvla2_robots()[1].build(SapienPiperConfig(image_size=96))
    yield robot
    robot.close()


def test_the_component_is_sound():
    check_component(gvla2_robots()[1])
    assert gvla2_robots()[1].name == "sapien_piper"


def test_the_arm_starts_at_home_and_its_model_agrees_with_the_simulated_one(piper):
    piper.reset(None, 0)
    seen = piper.observe()
    np.testing.assert_allclose(seen.joints, piper.arm.home, atol=1e-4)
    assert seen.gripper_width == pytest.approx(0.07, abs=1e-4)
    simulated = piper._world.link_poses(["tcp"])["tcp"]
    np.testing.assert_allclose(simulated, piper.arm.forward(piper._world.joints), atol=1e-5)
    assert piper._world.touching_links() == set()


def test_the_block_under_the_base_is_the_robots_own(piper):
    piper.reset(None, 0)
    for view in piper.observe().views:
        points = view.points()[~view.robot_mask]
        np.testing.assert_allclose(points[np.isfinite(points[:, 2]), 2], TABLE_HEIGHT, atol=1e-3)
    assert any(view.robot_mask.mean() > 0.02 for view in piper.observe().views)


class Block:
    """A cube on the table; nothing is asked."""

    instructions = ("",) * 4

    def sample(self, rng, site, instruction=None):
        solid = Primitive("box", (0.04, 0.04, 0.04), (1.0, 0.0, 0.0))
        cube = Body("block", (solid,), rigid(translation=(0.32, 0.08, TABLE_HEIGHT + 0.02)))
        return TaskInstance(Layout((cube,)), "", {"relaxed": lambda w: False, "strict": lambda w: False})


def test_a_cube_is_grasped_by_friction_and_lifted(piper):
    piper.reset(Block(), 0)
    place, up = np.array([0.32, 0.08, TABLE_HEIGHT + 0.02]), np.array([0.0, 0.0, 0.12])
    down = Orientation("grasp", (0.0, 0.0, -1.0), (0.0, 1.0, 0.0))
    near = frozenset({"block", "table"})
    steps = (
        Waypoint(tuple(place + up), 1.0, "approach", down),
        Waypoint(tuple(place), 1.0, "grasp", down, motion="linear", allowed_contacts=near),
        Waypoint(tuple(place), 0.0, "close", down, motion="linear", allowed_contacts=near),
        Waypoint(tuple(place + up), 0.0, "lift", down, motion="linear", allowed_contacts=near),
    )
    report = piper.execute(Trajectory(steps), Scene((), TABLE_HEIGHT, piper.arm.workspace))
    assert report.abort is None
    assert set(report.waypoints[2].contacts) == {"finger_left", "finger_right"}
    assert piper.observe().gripper_width == pytest.approx(0.04, abs=0.002)
    assert piper.true_state().pose("block")[2, 3] == pytest.approx(place[2] + up[2], abs=0.006)
    assert piper.true_state().held("block")


@pytest.mark.parametrize("name", ["move_spray_bottle", "open_drawer", "open_jar", "sort_object"])
def test_tabletop_tasks_are_laid_out_within_its_reach(piper, name):
    component = TASKS[name]
    instance = piper.reset(component.build(component.config()), 1)
    verdict = piper.success_check()
    assert not verdict.relaxed
    assert not verdict.strict
    for body in instance.layout.bodies:
        assert np.linalg.norm(piper.true_state().pose(body.name)[:3, 3] - body.world_from_body[:3, 3]) < 2e-3


def test_a_jars_lid_fits_the_smaller_hand(piper):
    component, lids = TASKS["open_jar"], []
    for span in (0.08, piper.arm.hand.max_width):
        site = replace(piper._site(), span=span, reachable=lambda point: True)
        layout = component.build(component.config()).sample(np.random.default_rng(0), site).layout
        lids.append(layout["lid_0"].solids[0].size[0])
    assert lids == pytest.approx([0.074, 0.064])


def test_a_task_that_does_not_fit_says_so(piper):
    component = TASKS["sort_object"]
    small = replace(piper._site(), size=(0.2, 0.2))
    with pytest.raises(ConfigurationError, match="does not fit on the table within the arm's reach"):
        component.build(component.config()).sample(np.random.default_rng(0), small)
