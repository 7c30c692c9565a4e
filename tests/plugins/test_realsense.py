"""The RealSense camera, by the real librealsense and a device of software: frames, refusals, trouble in mid-run."""

import time
from dataclasses import replace

import numpy as np
import pytest

from gvla2.errors import RobotError
from gvla2.geometry.transform import rigid
from gvla2.robot.calibration import Calibration, pinhole
from gvla2.testing.robot import check_camera
from gvla2_plugins.realsense import RealsenseConfig
from gvla2_plugins.realsense.camera import RealsenseCamera, load
from tests.plugins.software_camera import Optics, SoftwareCamera

POSE = rigid([[0, 0, 1], [-1, 0, 0], [0, -1, 0]], (0.1, 0.2, 0.3))


@pytest.fixture
def rs():
    return load()


@pytest.fixture
def device():
    """``device(**options)`` makes a camera of software that sends, until the test is over."""
    made = []

    def make(**options):
        made.append(SoftwareCamera(**{"fps": 60, **options}))
        made[-1].depth[:] = 500
        return made[-1].start()

    yield make
    for camera in made:
        camera.stop()


@pytest.fixture
def calibrate(tmp_path):
    """``calibrate(optics)`` writes the hand-eye file of a camera and returns its path."""

    def make(optics=None, transform=POSE, serial="f0123", mount="eye_to_hand", K=None):
        o = optics or Optics(64, 48, 60.0)
        fx, fy, cx, cy = K or (o.f, o.f, o.width / 2, o.height / 2)
        path = tmp_path / "hand_eye.json"
        lens = pinhole(fx, fy, cx, cy, o.width, o.height, transform)
        Calibration(lens, serial, 0.001, mount=mount).save(path)
        return path

    return make


@pytest.fixture
def opened(calibrate):
    """``opened(software, **options)`` is the camera component on that device, calibrated for it."""
    made = []

    def make(software, path=None, **options):
        config = RealsenseConfig(
            **{
                "calibration": str(path or calibrate(software.colour)),
                "fps": 60,
                "warm_up": 2,
                "timeout": 2.0,
            }
            | options
        )
        made.append(RealsenseCamera(config, software.device))
        return made[-1]

    yield make
    for camera in made:
        camera.close()


def test_it_keeps_the_contract_of_cameras(device, opened):
    check_camera(opened(device()))


def test_colour_pose_and_intrinsics_are_the_streams(device, opened):
    software = device()
    software.image[:] = (200, 100, 50)
    frames = opened(software).observe()
    (view,) = frames.views
    assert view.name == "realsense-f0123"
    assert (view.image == (200, 100, 50)).all()
    assert np.allclose(view.camera.world_from_camera, POSE)
    # librealsense has the middle of 64x48 pixels at (31.5, 23.5), counted from the first pixel's centre.
    assert np.allclose(view.camera.K, [[60, 0, 32], [0, 60, 24], [0, 0, 1]])
    assert abs(frames.timestamps[0] - time.time()) < 1.0


def test_depth_is_metres_in_the_colour_pictures_pixels(device, opened):
    """A step seen by a coarser sensor, 5 cm aside and 2 cm behind, lies where the colour camera sees it."""
    software = device(
        colour=Optics(128, 96, 120.0),
        eye=Optics(64, 48, 60.0),
        unit=0.00025,
        colour_from_depth=(0.05, 0.0, 0.02),
    )
    software.depth[:] = 4000  # 1 m
    software.depth[:, 32:] = 2000  # 0.5 m from x = 0 on
    depth = opened(software).observe().views[0].depth
    row = depth[48]
    edge = 64 + 120 * (0.05 - 0.5 / 120) / 0.52  # the near part begins half a coarse pixel before its centre
    near = np.flatnonzero(np.abs(row - 0.52) < 1e-4)
    assert near[0] == pytest.approx(edge, abs=1.5)
    assert row[near[0] + 5 :][np.isfinite(row[near[0] + 5 :])] == pytest.approx(0.52, abs=1e-4)
    left = row[: near[0] - 2]
    assert left[np.isfinite(left)] == pytest.approx(1.02, abs=1e-4)
    assert np.isnan(row[:5]).all()  # the depth sensor sees nothing there


def test_depth_is_along_the_colour_cameras_axis_when_the_sensor_looks_aside(device, opened):
    """A wall square to the depth sensor is a slanted plane to a colour camera that is turned by 0.1 rad."""
    software = device(tilt=0.1, colour_from_depth=(0.0, 0.0, -0.01))
    software.depth[:] = 1000
    seen = opened(software).observe().views[0]
    points = seen.points() - POSE[:3, 3]
    local = points @ POSE[:3, :3]  # in the colour camera
    normal = np.array([np.sin(0.1), 0.0, np.cos(0.1)])
    distances = (local - (0.0, 0.0, -0.01)) @ normal
    assert np.isfinite(distances).mean() > 0.8
    assert np.nanmax(np.abs(distances - 1.0)) < 1e-5


def test_frames_are_taken_after_the_call(device, opened):
    software = device()
    camera = opened(software)
    for step in range(8):
        software.depth[:] = 600 + step
        began = time.time()
        frames = camera.observe()
        assert np.nanmax(frames.views[0].depth) == pytest.approx(0.6 + 0.001 * step)
        assert frames.timestamps[0] >= began


def test_a_camera_on_the_hand_moves_with_it(device, opened, calibrate):
    camera = opened(device(), calibrate(mount="eye_in_hand"))
    hand = rigid(translation=(0.0, 0.0, 1.0))
    assert np.allclose(camera.observe(hand).views[0].camera.world_from_camera, hand @ POSE)
    with pytest.raises(RobotError, match="on the hand"):
        camera.observe()


@pytest.mark.parametrize("model", ["brown_conrady", "inverse_brown_conrady"])
def test_a_bending_lens_is_made_straight(device, opened, rs, model):
    """Each pixel of the bent picture shows the column and row that its ray has in a pinhole's picture."""
    optics = Optics(64, 48, 40.0, model, (0.2, -0.05, 0.002, -0.002, 0.01))
    software = device(colour=optics, eye=replace(optics, model="none"))
    given = optics.intrinsics(rs)
    for v in range(48):
        for u in range(64):
            x, y, _ = rs.rs2_deproject_pixel_to_point(given, [u, v], 1.0)
            software.image[v, u, :2] = np.clip(100 + 2 * np.array([40 * x, 40 * y]), 0, 255)
    camera = opened(software)
    image = camera.observe().views[0].image.astype(float)
    seen = image[4:-4, 4:-4, :2]
    v, u = np.mgrid[4:44, 4:60]
    straight = 100 + 2 * np.stack([u - 31.5, v - 23.5], -1)
    assert np.abs(seen - straight).max() <= 2.0  # one pixel
    bent = software.image[4:-4, 4:-4, :2].astype(float)
    assert np.abs(bent - straight).max() > 4.0
    depth = camera.observe().views[0].depth[10:-10, 10:-10]
    assert np.nanmin(depth) == pytest.approx(0.5)
    assert np.nanmax(depth) == pytest.approx(0.5)


NOTHING = "gave no new pair of colour and depth within 0.4 s"
TROUBLE = {
    "silent": ({"sends": ()}, NOTHING),
    "blind": ({"sends": ("colour",)}, NOTHING),
    "frozen": ({"counting": False}, NOTHING),
    "of mixed sizes": ({"other_size": True}, NOTHING),
    "unplugged": ({"sends": (), "plugged": False}, NOTHING + ". It was unplugged"),
}


@pytest.mark.parametrize("case", TROUBLE)
def test_trouble_in_mid_run_is_named_and_passes(device, opened, case):
    changes, expected = TROUBLE[case]
    software = device()
    camera = opened(software, timeout=0.4)
    camera.observe()
    before = {name: getattr(software, name) for name in changes}
    vars(software).update(changes)
    time.sleep(0.05)  # a picture may be on its way
    with pytest.raises(RobotError, match=expected):
        camera.observe()
    vars(software).update(before)
    assert camera.observe().views
    camera.close()
    with pytest.raises(RobotError, match="is closed"):
        camera.observe()


UNFIT = {
    "another camera": ({"serial": "f9999"}, "for camera 'f9999', but the camera in use is 'f0123'"),
    "another size": ({"optics": Optics(80, 60, 60.0)}, r"no colour of 80x60 at 60 a second; it has 64x48@60"),
    "another focal length": ({"optics": Optics(64, 48, 70.0)}, "60.0.* for .*70.0"),
    "another axis": ({"K": (60.0, 60.0, 40.0, 24.0)}, "32.0.* for .*40.0"),
}


@pytest.mark.parametrize("case", UNFIT)
def test_a_calibration_that_does_not_fit_is_refused(device, opened, calibrate, case):
    options, expected = UNFIT[case]
    with pytest.raises(RobotError, match=expected):
        opened(device(), calibrate(**options))


def test_a_device_without_depth_or_that_cannot_be_aligned(device, opened, rs, calibrate):
    with pytest.raises(RobotError, match="can't be started"):
        opened(device(colour_from_depth=None))
    lone = rs.software_device()
    lone.register_info(rs.camera_info.name, "Webcam")
    config = RealsenseConfig(calibration=str(calibrate(serial="")))
    with pytest.raises(RobotError, match="no colour of 64x48 at 30 a second; it has none"):
        RealsenseCamera(config, lone)
