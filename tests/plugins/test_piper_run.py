"""Whole episodes with the Piper on its virtual bus: dry, armed, with a camera that goes; and the log replayed."""

from dataclasses import replace

import numpy as np
import pytest

from gvla2.commands.run import build_components
from gvla2.episode.loop import EpisodeRequest, run_episode
from gvla2.errors import RobotError
from gvla2.geometry.transform import rigid
from gvla2.planning.scene import Scene, SceneObject
from gvla2.planning.trajectory import Trajectory, Waypoint
from tests.plugins.piper_rig import DOWN, SWIFT, Rig
from tests.plugins.synthetic_table import Scenery


@pytest.fixture
def rig(tmp_path):
    made = []

    def make(camera=None, **options):
        made.append(Rig(tmp_path, camera=camera or Scenery(160), **options))
        return made[-1]

    yield make
    for one in made:
        one.close()


@pytest.fixture
def piper(rig):
    return lambda camera=None, **options: rig(camera, armed=False, **options).robot


@pytest.fixture
def parts(compose_run, registry):
    """Everything of a run but its robot, which each test brings."""
    config = compose_run("robot=sapien_panda", "memory=none", "planner.lift_height=0.05")
    config.robot.image_size = 16
    return replace(build_components(config, registry), task=None)


def test_a_dry_run_plans_checks_and_sends_nothing(rig, parts, tmp_path):
    one = rig(armed=False)
    record = run_episode(replace(parts, robot=one.robot), EpisodeRequest(0, "lift the red cube"))
    assert record.checks.passed
    assert record.failure.kind == "not_started"
    assert "Dry run: all 4 waypoints can be reached" in record.failure.message
    assert "Nothing was executed" in record.verdict.reasons[0]
    assert len(record.report.joint_path) > 20
    assert not one.sent()
    assert not (tmp_path / "log.jsonl").exists()


def test_an_armed_episode_moves_the_arm(rig, parts):
    robot = rig(**SWIFT).robot
    request = EpisodeRequest(0, "push the green cube to the red cube")
    record = run_episode(replace(parts, robot=robot), request)
    assert record.report.completed, record.failure
    assert max(w.error for w in record.report.waypoints) < 2e-3
    assert record.after is not None
    # The made-up cube can't move: executed is not succeeded.
    assert record.verdict.outcome == "verified_fail"
    assert not robot.session.loop.stopped


def test_the_gripper_finds_an_object(rig):
    one = rig(**SWIFT)
    robot = one.robot
    robot.reset(None, 0)
    one.arm.object_width = 0.03
    cube = SceneObject(
        "cube", "cube", "box", "", rigid(translation=(0.22, 0.0, 0.05)), np.full(3, 0.03), np.zeros((1, 3))
    )
    grasp = Waypoint((0.22, 0.0, 0.08), 0.0, "close", DOWN, allowed_contacts=frozenset({"cube"}))
    lift = replace(grasp, xyz=(0.22, 0.02, 0.09), stage="lift", carries="cube")
    report = robot.execute(Trajectory((grasp, lift)), Scene((cube,), 0.0, robot.arm.workspace))
    assert report.completed
    assert [w.held for w in report.waypoints] == [True, True]
    assert report.waypoints[1].gripper_width == pytest.approx(0.03, abs=1e-4)


class Unplugged:
    """Sees twice, then somebody trips over the cable."""

    def __init__(self, times):
        self.inner, self.left = Scenery(160), times

    def observe(self, base_from_tcp=None):
        if not self.left:
            raise RobotError("The camera 'f0123' was unplugged.")
        self.left -= 1
        return self.inner.observe(base_from_tcp)

    def close(self):
        self.left = 0


def test_a_camera_unplugged_in_mid_run_ends_the_episode_with_the_arm_held(rig, parts):
    one = rig(camera=Unplugged(0))
    robot = one.robot
    record = run_episode(replace(parts, robot=robot), EpisodeRequest(0, "lift the red cube"))
    assert (record.failure.stage, record.failure.kind) == ("observe", "error")
    assert "unplugged" in record.failure.message
    assert not robot.session.loop.moving
    assert one.arm.enabled


def test_views_are_placed_in_the_world_and_the_arm_is_masked(piper):
    robot = piper(bus="none", base_position=[0.1, 0.0, 0.5], base_yaw=1.0, table_height=0.5)
    seen = robot.observe()
    plain = Scenery(160).observe().views[0].camera.world_from_camera
    base = rigid([[np.cos(1.0), -np.sin(1.0), 0], [np.sin(1.0), np.cos(1.0), 0], [0, 0, 1]], (0.1, 0.0, 0.5))
    assert np.allclose(seen.views[0].camera.world_from_camera, base @ plain)
    assert 0.01 < seen.views[0].robot_mask.mean() < 0.5
    tool = (np.linalg.inv(base) @ seen.world_from_tcp)[:3, 3]
    assert tool[0] == pytest.approx(0.2924, abs=1e-3)
