"""Recorded frames in place of a camera: what is read, what is refused, and a whole run that is fed with them."""

import json

import numpy as np
import pytest

from gvla2.cli import main
from gvla2.errors import ConfigurationError, RobotError
from gvla2.geometry.camera import Camera
from gvla2.geometry.transform import rigid
from gvla2.geometry.view_folders import write_plain
from gvla2.geometry.views import View, Views
from gvla2.testing.robot import check_camera
from gvla2_plugins.replay_camera import ReplayConfig
from gvla2_plugins.replay_camera.camera import ReplayCamera
from tests.plugins.synthetic_table import Scenery

POSE = rigid([[0, 0, 1], [-1, 0, 0], [0, -1, 0]], (0.1, 0.2, 0.3))
K = np.array([[60.0, 0.0, 6.0], [0.0, 60.0, 4.0], [0.0, 0.0, 1.0]])


def frame(folder, number, names=("front",), metres=None, **more):
    """Write the frame of this number: noise of 12 by 8 pixels, by default 0.5 m plus 0.1 m a number away."""
    rng = np.random.default_rng(number)
    image = rng.integers(0, 255, (8, 12, 3), dtype=np.uint8)
    depth = np.full((8, 12), 0.5 + 0.1 * number if metres is None else metres, np.float32)
    views = (View(Camera(K, POSE, 12, 8, name), image, depth, **more) for name in names)
    write_plain(folder, Views(tuple(views)))
    return image


@pytest.fixture
def folder(tmp_path):
    for number in range(3):
        frame(tmp_path / f"{number:03d}", number)
    return tmp_path


def replay(path):
    return ReplayCamera(ReplayConfig(path=str(path)))


def test_it_keeps_the_contract_of_cameras(folder):
    check_camera(replay(folder))


def test_frames_come_in_the_order_of_their_numbers_and_stay_at_the_last(folder):
    for number in (9, 10):  # the alphabet has "10" before "9"
        frame(folder / str(number), number)
    (folder / "1a").mkdir()
    (folder / "7").write_bytes(b"no frame")
    camera = replay(folder)
    shown = [camera.observe().views[0].depth[0, 0] for _ in range(6)]
    assert shown == pytest.approx([0.5, 0.6, 0.7, 1.4, 1.5, 1.5])


def test_a_frame_has_the_pictures_the_pose_and_the_lens_of_its_folder_and_no_mask_of_an_object(tmp_path):
    image = frame(tmp_path, 0, names=("left", "right"), mask=np.zeros((8, 12), np.float32))
    views = replay(tmp_path).observe().views
    assert [view.name for view in views] == ["left", "right"]
    for view in views:
        assert np.array_equal(view.image, image)
        assert np.allclose(view.camera.world_from_camera, POSE)
        assert np.allclose(view.camera.K, K)
        assert view.depth.dtype == np.float32
        assert view.mask is None


def test_a_closed_recording_shows_nothing(folder):
    camera = replay(folder)
    camera.close()
    with pytest.raises(RobotError, match="is closed"):
        camera.observe()


SPOILT = {
    "no frames": (lambda f: [p.rename(f / f"frame {p.name}") for p in f.glob("0*")], "is not a recording"),
    "no cameras": (lambda f: (f / "001/cameras.json").unlink(), "Cannot read views from .*001"),
    "no depth": (lambda f: (f / "001/depth/0.npy").unlink(), "001: view 'front' has no depth"),
    "no picture": (lambda f: (f / "001/images/0.png").write_bytes(b"GIF99"), "Cannot read .*001"),
    "too far": (lambda f: frame(f / "002", 2, metres=600.0), "002: .* farther than 600 m"),
    "other cameras": (
        lambda f: frame(f / "002", 2, ("front", "wrist")),
        "000 has front, .*002 has front, wrist",
    ),
}


@pytest.mark.parametrize("case", SPOILT)
def test_a_spoilt_recording_is_refused_before_anything_is_shown(folder, case):
    spoil, expected = SPOILT[case]
    spoil(folder)
    with pytest.raises(RobotError, match=expected):
        replay(folder)


def test_a_path_is_needed_and_must_be_there(tmp_path):
    with pytest.raises(ConfigurationError, match=r"camera\.path=FOLDER"):
        replay("")
    with pytest.raises(ConfigurationError, match="nothing at"):
        replay(tmp_path / "gone")


def ran(folder, *overrides):
    command = ["run", "robot=piper", "robot.bus=none", "camera=replay", "memory=none", "quiet=true"]
    command += ["planner.lift_height=0.05", "instruction='lift the red cube'", f"hydra.run.dir={folder}"]
    return main([*command, *overrides])


@pytest.mark.extras
def test_a_run_of_the_piper_sees_by_recorded_frames_and_leaves_some_that_can_be_replayed(tmp_path, capfd):
    pytest.importorskip("can", reason="pip install 'gvla2[piper]'")
    write_plain(tmp_path / "recorded", Views(tuple(Scenery(160).observe().views)))
    for recording, folder in (("recorded", "run"), ("run", "again")):
        ran(tmp_path / folder, f"camera.path={tmp_path / recording}")
        result = json.loads((tmp_path / folder / "result.json").read_text())
        assert "Dry run: all 4 waypoints can be reached" in result["failure"]["message"]
        assert (tmp_path / folder / "index.html").is_file()


def test_a_run_without_a_recording_says_so_before_the_arm_is_asked_for(tmp_path, capfd):
    assert ran(tmp_path / "run", f"camera.path={tmp_path / 'gone'}") != 0
    assert "there is nothing at" in "".join(capfd.readouterr())
