"""The simulated Panda's world: reset, cameras, success check and what goes wrong, with real physics."""

import numpy as np
import pytest

from gvla2.errors import ConfigurationError, RobotError
from gvla2.geometry.transform import transform_points
from gvla2.planning.scene import Scene
from gvla2.planning.trajectory import Trajectory
from gvla2_plugins.sapien import SapienPandaConfig, gvla2_robots
from gvla2_plugins.sapien.driver import SapienDriver
from gvla2_plugins.tabletop import gvla2_tasks

TABLE_HEIGHT = SapienPandaConfig().table_height

TASKS = {c.name: c.build(c.config()) for c in gvla2_tasks()}


@pytest.fixture(scope="module")
def panda():
    component = gvla2_robots()[0]
    robot = component.build(SapienPandaConfig(image_size=128))
    yield robot
    robot.close()


def driver(panda) -> SapienDriver:
    return SapienDriver(panda._world, panda._config, panda.arm.hand.max_width)


@pytest.mark.parametrize("name", TASKS)
def test_bodies_rest_where_they_were_laid_and_nothing_is_done_yet(panda, name):
    for seed in (0, 1):
        instance = panda.reset(TASKS[name], seed)
        before = {b.name: panda._world.pose(b.name) for b in instance.layout.bodies}
        for body in instance.layout.bodies:
            np.testing.assert_allclose(before[body.name], body.world_from_body, atol=1e-3)
        verdict = panda.success_check()
        assert (verdict.relaxed, verdict.strict) == (False, False)
        for body in instance.layout.bodies:  # and a quarter of a second later still
            np.testing.assert_allclose(panda._world.pose(body.name), before[body.name], atol=2e-4)


# Cameras


def test_depth_is_that_of_the_cubes_tops(panda):
    instance = panda.reset(TASKS["pick_and_lift"], 3)
    views = panda.observe().views
    assert [v.name for v in views] == ["front", "left_shoulder", "right_shoulder", "wrist"]
    measured = 0
    for body in instance.layout.bodies:
        top = body.world_from_body[:3, 3] + (0, 0, 0.025)
        for view in views:
            uv, depth = view.camera.project(top)
            if not view.camera.inside(uv):
                continue
            u, v = (int(c) for c in uv)
            seen = view.points()[v, u]
            if view.robot_mask[v, u] or abs(view.depth[v, u] - depth) > 0.02:
                continue  # something stands before it
            assert seen[2] == pytest.approx(TABLE_HEIGHT + 0.05, abs=1e-3)
            colour = view.image[v, u] / 255
            hue = np.array(body.solids[0].rgb)
            assert np.abs(colour - hue * colour.max() / max(hue.max(), 1e-9)).max() < 0.1 or not hue.any()
            measured += 1
    assert measured >= 6


def test_the_robots_own_pixels_are_known_and_only_those(panda):
    instance = panda.reset(TASKS["pick_and_lift"], 3)
    seen = panda.observe()
    shares = {}
    for view in seen.views:
        points = view.points()
        assert not np.isnan(view.depth[view.robot_mask]).any()
        assert (points[view.robot_mask][:, 2] > TABLE_HEIGHT - 0.005).all()
        shares[view.name] = view.robot_mask.mean()
        for body in instance.layout.bodies:
            top = transform_points(np.linalg.inv(body.world_from_body), points)
            on_cube = (np.abs(top) < 0.0251).all(axis=-1)
            assert not (on_cube & view.robot_mask).any()
    assert 0.02 < shares["front"] < 0.3
    assert 0.1 < shares["left_shoulder"] < 0.6
    assert 0.001 < shares["wrist"] < 0.2  # the fingertips


# What goes wrong


def test_a_simulation_that_blows_up_is_noticed_and_the_next_one_is_clean(panda):
    panda.reset(TASKS["pick_and_lift"], 0)
    drive = driver(panda)
    panda._world._movers[0].set_linear_velocity((0.0, 0.0, 1000.0))
    result = drive.follow(np.tile(panda.arm.home, (100, 1)), 1 / 60, 1.0)
    assert result.diverged
    assert panda._world.time < 0.1  # broken off at once
    panda._world._robot.set_qpos(np.full(9, np.nan, dtype=np.float32))
    drive.hold()
    for look in (panda.observe, panda.success_check):
        with pytest.raises(RobotError, match="blown up"):
            look()
    panda.reset(TASKS["pick_and_lift"], 0)
    np.testing.assert_allclose(panda.observe().joints, panda.arm.home, atol=1e-4)
    assert not panda.success_check().relaxed


def test_nothing_works_before_reset_or_after_close():
    robot = gvla2_robots()[0].build(SapienPandaConfig())
    for _ in range(2):
        with pytest.raises(RobotError, match="reset"):
            robot.observe()
        with pytest.raises(RobotError, match="reset"):
            robot.execute(Trajectory(()), Scene((), TABLE_HEIGHT, robot.arm.workspace))
        assert robot.success_check() is None
        robot.close()
    robot.reset(None, 0)
    assert robot.observe().gripper > 0.9


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"cameras": ["front", "top"]}, "front, left_shoulder, right_shoulder, wrist"),
        ({"cameras": []}, "one or more"),
        ({"cameras": ["wrist", "wrist"]}, "different"),
        ({"image_size": 0}, "image_size is 0"),
        ({"physics_rate": -1}, "physics_rate is -1"),
    ],
)
def test_senseless_options_are_refused(options, message):
    with pytest.raises(ConfigurationError, match=message):
        gvla2_robots()[0].build(SapienPandaConfig(**options))
