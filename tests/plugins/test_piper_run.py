"""Whole episodes with the Piper on its virtual bus: dry, armed, with a camera that goes; and the log replayed."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from gvla2.commands.run import build_components
from gvla2.episode.loop import EpisodeRequest, SilentListener, run_episode
from gvla2.errors import ConfigurationError, RobotError
from gvla2.geometry.transform import rigid
from gvla2.planning.scene import Scene, SceneObject
from gvla2.planning.trajectory import Orientation, Trajectory, Waypoint
from gvla2.record.recorder import RunRecorder
from gvla2.robot.backend import CameraFrames
from gvla2_plugins.piper import PiperConfig, SceneryConfig
from gvla2_plugins.piper.arm import HOME
from gvla2_plugins.piper.backend import Piper
from gvla2_plugins.piper.scenery import Scenery
from gvla2_plugins.piper.virtual_arm import VirtualArm
from gvla2_plugins.piper.virtual_arm import main as virtual_arm_main
from tests.plugins.piper_trials import read_log

DOWN = Orientation("grasp", (0.0, 0.0, -1.0), (0.0, 1.0, 0.0))


SWIFT = {"speed": 0.2, "tool_speed": 0.25, "acceleration": 4.0}


class Listener(SilentListener):
    def __init__(self):
        self.frames = 0

    def frame(self, image):
        assert image.dtype == np.uint8
        self.frames += 1


@pytest.fixture
def piper(tmp_path):
    made = []

    def make(camera=None, **options):
        config = PiperConfig(**{"bus": "virtual", "log": str(tmp_path / "log.jsonl"), **options})
        made.append(Piper(config, camera or Scenery(SceneryConfig(image_size=160))))
        return made[-1]

    yield make
    for robot in made:
        robot.close()


@pytest.fixture
def parts(compose_run, registry):
    """Everything of a run but its robot, which each test brings."""
    config = compose_run("robot=sapien_panda", "memory=none", "planner.lift_height=0.05")
    config.robot.image_size = 16
    return replace(build_components(config, registry), task=None)


def test_a_dry_run_plans_checks_shows_and_sends_nothing(piper, parts, tmp_path):
    robot, listener = piper(), Listener()
    record = run_episode(replace(parts, robot=robot), EpisodeRequest(0, "lift the red cube"), listener)
    assert record.checks.passed
    assert record.failure.kind == "not_started"
    assert "Dry run: all 4 waypoints can be reached" in record.failure.message
    assert "Nothing was executed" in record.verdict.reasons[0]
    assert listener.frames > 5
    assert len(record.report.joint_path) > 20
    assert not robot.session.virtual.heard
    assert not (tmp_path / "log.jsonl").exists()
    recorder = RunRecorder(tmp_path / "run", "")
    recorder.frame(np.zeros((64, 64, 3), np.uint8))
    assert "The motion as planned: nothing moved" in recorder.finish(record).read_text()


def test_planning_works_without_any_arm(piper, parts):
    robot = piper(bus="none")
    record = run_episode(replace(parts, robot=robot), EpisodeRequest(0, "lift the blue cube"))
    assert "Dry run: all" in record.failure.message
    assert np.allclose(record.observation.joints, HOME)


def test_an_armed_episode_moves_the_arm(piper, parts):
    robot = piper(armed=True, **SWIFT)
    request = EpisodeRequest(0, "push the green cube to the red cube")
    record = run_episode(replace(parts, robot=robot), request)
    assert record.report.completed
    assert max(w.error for w in record.report.waypoints) < 2e-3
    assert record.after is not None
    # The made-up cube can't move: executed is not succeeded.
    assert record.verdict.outcome == "verified_fail"
    assert not robot.session.loop.stopped


def test_the_gripper_finds_an_object_and_every_command_is_logged(piper, tmp_path, monkeypatch):
    monkeypatch.setattr(
        "gvla2_plugins.piper.session.VirtualArm", partial(VirtualArm, joints=HOME)
    )  # it is near
    robot = piper(armed=True, **SWIFT)
    robot.reset(None, 0)
    robot.session.virtual.object_width = 0.03
    cube = SceneObject(
        "cube", "cube", "box", "", rigid(translation=(0.22, 0.0, 0.05)), np.full(3, 0.03), np.zeros((1, 3))
    )
    grasp = Waypoint((0.22, 0.0, 0.08), 0.0, "close", DOWN, allowed_contacts=frozenset({"cube"}))
    lift = replace(grasp, xyz=(0.22, 0.02, 0.09), stage="lift", carries="cube")
    report = robot.execute(Trajectory((grasp, lift)), Scene((cube,), 0.0, robot.arm.workspace))
    assert report.completed
    assert [w.held for w in report.waypoints] == [True, True]
    assert report.waypoints[1].gripper_width == pytest.approx(0.03, abs=1e-4)
    robot.close()
    assert "armed" in {e.get("event") for e in read_log(tmp_path / "log.jsonl")}


class Unplugged:
    """Sees twice, then somebody trips over the cable."""

    def __init__(self, times):
        self.inner, self.left = Scenery(SceneryConfig(image_size=160)), times

    def observe(self, base_from_tcp=None):
        if not self.left:
            raise RobotError("The camera 'f0123' was unplugged.")
        self.left -= 1
        return self.inner.observe(base_from_tcp)

    def close(self):
        self.left = 0


def test_a_camera_unplugged_in_mid_run_ends_the_episode_with_the_arm_held(piper, parts):
    robot = piper(camera=Unplugged(0), armed=True)
    record = run_episode(replace(parts, robot=robot), EpisodeRequest(0, "lift the red cube"))
    assert (record.failure.stage, record.failure.kind) == ("observe", "error")
    assert "unplugged" in record.failure.message
    assert not robot.session.loop.moving
    assert robot.session.virtual.enabled


def test_without_a_camera_perception_says_that_it_sees_nothing(piper, parts):
    class Blind:
        def observe(self, base_from_tcp=None):
            return CameraFrames((), ())

        def close(self):
            pass

    robot = piper(camera=Blind(), bus="none")
    record = run_episode(replace(parts, robot=robot), EpisodeRequest(0, "lift the red cube"))
    assert (record.failure.stage, record.failure.kind) == ("perceive", "perception")


def test_a_task_without_words_is_refused(piper, parts, compose_run, registry):
    with pytest.raises(ConfigurationError, match="say what to do"):
        piper(bus="none").reset(object(), 0)


def test_views_are_placed_in_the_world_and_the_arm_is_masked(piper):
    robot = piper(bus="none", base_position=[0.1, 0.0, 0.5], base_yaw=1.0, table_height=0.5)
    seen = robot.observe()
    plain = Scenery(SceneryConfig(image_size=160)).observe().views[0].camera.world_from_camera
    base = rigid([[np.cos(1.0), -np.sin(1.0), 0], [np.sin(1.0), np.cos(1.0), 0], [0, 0, 1]], (0.1, 0.0, 0.5))
    assert np.allclose(seen.views[0].camera.world_from_camera, base @ plain)
    assert 0.01 < seen.views[0].robot_mask.mean() < 0.5
    tool = (np.linalg.inv(base) @ seen.world_from_tcp)[:3, 3]
    assert tool[0] == pytest.approx(0.2924, abs=1e-3)


def test_a_camera_frame_needs_a_timestamp_a_view():
    with pytest.raises(RobotError, match="0 views and 1 timestamps"):
        CameraFrames((), (1.0,))


def test_the_virtual_arm_says_where_it_is(capsys, monkeypatch):
    monkeypatch.setattr("gvla2_plugins.piper.virtual_arm.be_urgent", lambda: None)  # pytest stays as it is

    def enough():
        raise KeyboardInterrupt

    assert virtual_arm_main(["--bus", "virtual", "--channel", "said"], wait=enough) == 0
    assert "A virtual Piper is on virtual 'said'" in capsys.readouterr().out
