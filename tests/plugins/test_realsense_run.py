"""A whole episode that sees through librealsense."""

from dataclasses import replace

import numpy as np
import pytest

from gvla2.cli import main
from gvla2.commands.run import build_components
from gvla2.episode.loop import EpisodeRequest, run_episode
from gvla2.robot.calibration import Calibration
from gvla2_plugins.piper import PiperConfig
from gvla2_plugins.piper.backend import Piper
from gvla2_plugins.realsense import RealsenseConfig
from gvla2_plugins.realsense.camera import RealsenseCamera
from tests.plugins.software_camera import Optics, SoftwareCamera
from tests.plugins.synthetic_table import Scenery


@pytest.fixture
def hand_eye(tmp_path):
    """The hand-eye file of a camera that looks at a made-up table, and the view that it has."""
    view = Scenery(240).observe().views[0]
    path = tmp_path / "hand_eye.json"
    Calibration(view.camera, "f0123", 0.001).save(path)
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


def test_an_episode_of_the_piper_sees_through_librealsense(table, compose_run, registry):
    config = compose_run(
        "robot=sapien_panda", "robot.image_size=16", "memory=none", "planner.lift_height=0.05"
    )
    robot = Piper(PiperConfig(bus="none"), table[1])
    components = replace(build_components(config, registry), task=None, robot=robot)
    record = run_episode(components, EpisodeRequest(0, "push the green cube to the red cube"))
    assert "Dry run: all" in record.failure.message
    cubes = {obj.label for obj in record.scene.objects}
    assert {"red cube", "green cube"} <= cubes


def test_a_run_without_its_camera_ends_before_the_arm_is_asked_for(hand_eye, tmp_path, capfd):
    code = main(
        [
            "run",
            "robot=piper",
            "robot.bus=socketcan",
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
