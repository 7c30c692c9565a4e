"""Recorded frames in place of a camera: what is read, what is refused, and a whole run that is fed with them."""

import json

import numpy as np
import pytest
from PIL import Image

from gvla2.cli import main
from gvla2.errors import ConfigurationError, RobotError
from gvla2.geometry.transform import rigid
from gvla2.robot.calibration import Calibration, pinhole
from gvla2.testing.robot import check_camera
from gvla2_plugins.replay_camera import ReplayConfig
from gvla2_plugins.replay_camera.camera import ReplayCamera
from tests.plugins.synthetic_table import Scenery

SIZE = (12, 8)  # width, height
POSE = rigid([[0, 0, 1], [-1, 0, 0], [0, -1, 0]], (0.1, 0.2, 0.3))


def calibrated(folder, transform=POSE, size=SIZE, mount="eye_to_hand", K=None, **more):
    fx, fy, cx, cy = (60.0, 60.0, size[0] / 2, size[1] / 2) if K is None else K[(0, 1, 0, 1), (0, 1, 2, 2)]
    lens = pinhole(float(fx), float(fy), float(cx), float(cy), *size, transform)
    Calibration(lens, "f0123", 0.001, mount=mount).save(folder / "camera.json")
    if more:
        file = folder / "camera.json"
        file.write_text(json.dumps(json.loads(file.read_text()) | more))


def depth_of(number, size=SIZE):
    return np.full((size[1], size[0]), 0.5 + 0.1 * number, np.float32)


def frame(folder, number, size=SIZE, kind="npy"):
    rng = np.random.default_rng(number)
    colour = rng.integers(0, 255, (size[1], size[0], 3), dtype=np.uint8)
    Image.fromarray(colour).save(folder / f"{number:03d}.rgb.png")
    if kind == "npy":
        np.save(folder / f"{number:03d}.depth.npy", depth_of(number, size))
    else:
        units = np.round(1000 * depth_of(number, size)).astype(np.uint16)
        Image.fromarray(units).save(folder / f"{number:03d}.depth.png")
    return colour


@pytest.fixture
def folder(tmp_path):
    calibrated(tmp_path)
    for number in range(3):
        frame(tmp_path, number)
    return tmp_path


def replay(path, **options):
    return ReplayCamera(ReplayConfig(path=str(path), **options))


def depths(camera, times):
    return [round(float(camera.observe().views[0].depth[0, 0]), 3) for _ in range(times)]


def test_it_keeps_the_contract_of_cameras(folder):
    check_camera(replay(folder))


def test_frames_come_in_the_order_of_their_numbers_and_stay_at_the_last(folder):
    for number in (9, 10):  # the alphabet has "10" before "9"
        frame(folder, number)
        for kind in ("rgb.png", "depth.npy"):
            (folder / f"{number:03d}.{kind}").rename(folder / f"{number}.{kind}")
    for other in ("1a.rgb.png", "._000.rgb.png", "2nd camera.txt"):
        (folder / other).write_bytes(b"no frame")
    assert depths(replay(folder), 6) == pytest.approx([0.5, 0.6, 0.7, 1.4, 1.5, 1.5])


def test_a_frame_has_the_pictures_the_pose_and_the_lens_of_the_folder(folder):
    colour = frame(folder, 0)
    seen = replay(folder).observe().views[0]
    assert np.array_equal(seen.image, colour)
    assert np.allclose(seen.camera.world_from_camera, POSE)
    assert np.allclose(seen.camera.K, [[60, 0, 6], [0, 60, 4], [0, 0, 1]])
    assert seen.depth.dtype == np.float32
    assert seen.name == "replay"


def test_a_closed_recording_shows_nothing(folder):
    camera = replay(folder)
    camera.close()
    with pytest.raises(RobotError, match="is closed"):
        camera.observe()


def test_depth_in_units_and_what_was_not_measured(tmp_path):
    calibrated(tmp_path, depth_scale=0.0005)
    frame(tmp_path, 0, kind="png")
    units = np.full((8, 12), 3000, np.uint16)
    units[0, 0] = 0
    Image.fromarray(units).save(tmp_path / "000.depth.png")
    frame(tmp_path, 1)
    np.save(tmp_path / "001.depth.npy", units.astype(np.int32))
    metres = np.full((8, 12), 1.5, np.float64)
    metres[0, :3] = (-1.0, np.inf, np.nan)
    frame(tmp_path, 2)
    np.save(tmp_path / "002.depth.npy", metres)
    camera = replay(tmp_path)
    first, second, third = (camera.observe().views[0].depth for _ in range(3))
    for depth in (first, second, third):
        assert np.isnan(depth[0, 0])
        assert depth[5, 5] == pytest.approx(1.5)
    assert np.isnan(third).sum() == 3


def test_several_cameras_lie_side_by_side(tmp_path):
    for name in ("left", "right"):
        (tmp_path / name).mkdir()
        calibrated(tmp_path / name)
        frame(tmp_path / name, 0)
    assert [view.name for view in replay(tmp_path).observe().views] == ["left", "right"]
    frame(tmp_path / "left", 1)
    with pytest.raises(RobotError, match=r"left has 2, .*right has 1"):
        replay(tmp_path)


def test_a_camera_on_the_hand_moves_with_it(tmp_path):
    calibrated(tmp_path, mount="eye_in_hand")
    frame(tmp_path, 0)
    camera = replay(tmp_path)
    hand = rigid(translation=(0.0, 0.0, 1.0))
    assert np.allclose(camera.observe(hand).views[0].camera.world_from_camera, hand @ POSE)
    with pytest.raises(RobotError, match="on the hand"):
        camera.observe()


def rewritten(**changes):
    def spoil(folder):
        file = folder / "camera.json"
        file.write_text(json.dumps(json.loads(file.read_text()) | changes))

    return spoil


SPOILT = {
    "no frames": (lambda f: [p.unlink() for p in f.glob("0*")], "holds no frames"),
    "no depth": (lambda f: (f / "001.depth.npy").unlink(), "frame 001 needs 001.rgb.png and one of"),
    "no colour": (lambda f: (f / "001.rgb.png").unlink(), "frame 001 needs 001.rgb.png"),
    "mixed sizes": (lambda f: frame(f, 1, size=(10, 8)), "has 10x8 pixels"),
    "depth with channels": (
        lambda f: np.save(f / "002.depth.npy", np.ones((8, 12, 1), np.float32)),
        "depth map",
    ),
    "eight bits": (
        lambda f: (
            (f / "001.depth.npy").unlink(),
            Image.fromarray(np.ones((8, 12), np.uint8)).save(f / "001.depth.png"),
        ),
        "16 bits or more",
    ),
    "too far": (
        lambda f: np.save(f / "001.depth.npy", np.full((8, 12), 600.0, np.float32)),
        "001.depth.npy.*farther than 600 m",
    ),
    "no picture": (
        lambda f: (f / "001.rgb.png").write_bytes(b"GIF99"),
        "Cannot read the picture from .*001.rgb.png",
    ),
    "no calibration": (lambda f: (f / "camera.json").unlink(), "is not a recording"),
    "a scale of nothing": (rewritten(depth_scale=0), "depth_scale is 0"),
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


@pytest.fixture
def recorded(tmp_path):
    """Two cameras' pictures of a table with cubes, as a person would lay them down."""
    for view in Scenery(160).observe().views:
        folder = tmp_path / "recorded" / view.name
        folder.mkdir(parents=True)
        calibrated(folder, view.camera.world_from_camera, (160, 160), K=view.camera.K, depth_scale=0.0001)
        Image.fromarray(view.image).save(folder / "000.rgb.png")
        units = np.nan_to_num(np.round(view.depth / 0.0001)).astype(np.uint16)
        Image.fromarray(units).save(folder / "000.depth.png")
    return tmp_path / "recorded"


def ran(tmp_path, *overrides):
    folder = tmp_path / "run"
    code = main(
        [
            "run",
            "robot=piper",
            "camera=replay",
            "memory=none",
            "planner.lift_height=0.05",
            "instruction='lift the red cube'",
            "quiet=true",
            f"hydra.run.dir={folder}",
            *overrides,
        ]
    )
    return code, folder


@pytest.mark.extras
def test_a_run_of_the_piper_sees_by_recorded_frames(tmp_path, recorded, capfd):
    pytest.importorskip("can", reason="pip install 'gvla2[piper]'")
    _, folder = ran(tmp_path, "robot.bus=none", f"camera.path={recorded}")
    result = json.loads((folder / "result.json").read_text())
    assert "Dry run: all 4 waypoints can be reached" in result["failure"]["message"]
    assert (folder / "index.html").is_file()


def test_a_run_without_a_recording_says_so_before_the_arm_is_asked_for(tmp_path, capfd):
    code, _ = ran(tmp_path, "robot.bus=none", f"camera.path={tmp_path / 'gone'}")
    assert code != 0
    assert "there is nothing at" in "".join(capfd.readouterr())
