"""Whole episodes that see through librealsense, and what a recording of it shows again."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from gvla2.cli import main
from gvla2.commands.run import build_components
from gvla2.episode.loop import EpisodeRequest, run_episode
from gvla2.robot.calibration import Calibration, Intrinsics
from gvla2_plugins.piper import PiperConfig, SceneryConfig
from gvla2_plugins.piper.backend import Piper
from gvla2_plugins.piper.feedback import WatchLimits
from gvla2_plugins.piper.scenery import Scenery
from gvla2_plugins.realsense import RealsenseConfig
from gvla2_plugins.realsense.camera import RealsenseCamera
from gvla2_plugins.realsense.record import main as record_main
from gvla2_plugins.replay_camera import ReplayConfig
from gvla2_plugins.replay_camera.camera import ReplayCamera
from tests.plugins.software_camera import Optics, SoftwareCamera


@pytest.fixture
def hand_eye(tmp_path):
    """The hand-eye file of a camera that looks at a made-up table, and the view that it has."""
    view = Scenery(SceneryConfig(image_size=240)).observe().views[0]
    focal = float(view.camera.K[0, 0])
    path = tmp_path / "hand_eye.json"
    size = Intrinsics(focal, focal, 120.0, 120.0, 240, 240)
    Calibration(view.camera.world_from_camera, size, "f0123", 12, 0.001).save(path)
    return path, view


@pytest.fixture
def software(hand_eye):
    """A device that sends that view through librealsense."""
    view = hand_eye[1]
    optics = Optics(240, 240, float(view.camera.K[0, 0]))
    camera = SoftwareCamera(colour=optics, eye=optics, unit=0.0001)
    camera.image[:] = view.image
    camera.depth[:] = np.nan_to_num(np.round(view.depth / 0.0001))
    yield camera.start()
    camera.stop()


@pytest.fixture
def table(software, hand_eye):
    """The device and the camera component that gets its pictures."""
    config = RealsenseConfig(calibration=str(hand_eye[0]), warm_up=2, timeout=1.0)
    camera = RealsenseCamera(config, software.device)
    yield software, camera
    camera.close()


@pytest.fixture
def episode(compose_run, registry, tmp_path, monkeypatch):
    """Run one episode of the Piper on its virtual bus; afterwards, the robot is still there to be looked at."""
    made = []
    # A busy machine may starve the virtual arm for a tenth of a second; test_piper_safety is about these limits.
    patient = partial(WatchLimits, stale=2.0, stale_status=2.0, heartbeat=2.0, lateness=2.0)
    monkeypatch.setattr("gvla2_plugins.piper.session.WatchLimits", patient)

    def run(camera, **options):
        config = compose_run("robot=sapien_panda", "memory=none", "planner.lift_height=0.05")
        config.robot.image_size = 16
        parts = build_components(config, registry)
        robot = Piper(PiperConfig(bus="virtual", log=str(tmp_path / "log.jsonl"), **options), camera)
        made.append(robot)
        request = EpisodeRequest(0, "push the green cube to the red cube")
        return run_episode(replace(parts, task=None, robot=robot), request), robot

    yield run
    for robot in made:
        robot.close()


def test_an_episode_of_the_piper_sees_through_librealsense(table, episode):
    record, _ = episode(table[1])
    assert record.checks.passed
    assert "Dry run: all" in record.failure.message
    cubes = {obj.label for obj in record.scene.objects}
    assert {"red cube", "green cube"} <= cubes


def test_unplugged_in_mid_run_the_arm_is_held(table, episode):
    software, camera = table
    observe = camera.observe

    def pulled(base_from_tcp=None):
        seen = observe(base_from_tcp)
        software.stop()
        software.plugged = False
        return seen

    camera.observe = pulled
    record, robot = episode(camera, armed=True, speed=0.2, tool_speed=0.5, acceleration=8.0)
    assert record.report.completed  # what was planned by the last good picture was carried out
    assert record.verdict.outcome == "uncertain"
    assert "'f0123' was unplugged" in record.notes[0]
    assert not robot.session.loop.moving
    assert robot.session.virtual.enabled


def test_a_recording_shows_again_what_the_camera_saw(software, hand_eye, tmp_path, capsys):
    folder = tmp_path / "recorded"
    asked = [str(hand_eye[0]), str(folder), "--frames", "2", "--every", "0.1"]
    assert record_main(asked, software.device) == 0
    assert "2 frames of camera 'f0123'" in capsys.readouterr().out
    live = RealsenseCamera(RealsenseConfig(calibration=str(hand_eye[0]), warm_up=0), software.device)
    (wanted,) = live.observe().views
    live.close()
    assert np.isfinite(wanted.depth).mean() > 0.5
    camera = ReplayCamera(ReplayConfig(path=str(folder), serial="f0123"))
    for _ in range(2):
        (seen,) = camera.observe().views
        assert np.array_equal(seen.image, wanted.image)
        assert np.array_equal(seen.depth, wanted.depth, equal_nan=True)
        assert np.array_equal(seen.camera.world_from_camera, wanted.camera.world_from_camera)
        assert np.array_equal(seen.camera.K, wanted.camera.K)
    assert record_main(asked, software.device) == 1
    assert "is not empty" in capsys.readouterr().err


def test_a_run_without_its_camera_ends_before_the_arm_is_asked_for(hand_eye, tmp_path, capfd):
    code = main(
        [
            "run",
            "robot=piper",
            "robot.bus=virtual",
            "robot.armed=true",
            f"robot.log={tmp_path / 'log.jsonl'}",
            "camera=realsense",
            f"camera.calibration={hand_eye[0]}",
            "camera.serial=no-such-serial",
            "memory=none",
            "instruction='lift the red cube'",
            f"hydra.run.dir={tmp_path / 'run'}",
        ]
    )
    assert code != 0
    assert "no-such-serial" in "".join(capfd.readouterr())
    assert not (tmp_path / "log.jsonl").exists()
