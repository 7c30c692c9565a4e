"""Hand-eye calibration: found back from noisy pairs, refused when it can't be, written and read."""

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gvla2.commands.calibrate import CalibrateConfig, job
from gvla2.errors import RobotError
from gvla2.geometry.transform import invert_rigid, look_along, rigid
from gvla2.plugins.registry import load_plugins
from gvla2.robot.calibration import Calibration, Intrinsics, Recording, solve

INTRINSICS = Intrinsics(600.0, 601.0, 320.5, 240.25, 640, 480)
BASE_FROM_CAMERA = look_along([0.8, -0.3, 0.6], [-0.6, 0.3, -0.5])
TCP_FROM_CAMERA = rigid(Rotation.from_euler("xyz", [0.1, -0.2, 1.5]).as_matrix(), [0.06, 0.0, -0.08])
CONSTANT = rigid(Rotation.from_euler("xyz", [0.3, 0.1, -0.4]).as_matrix(), [0.01, 0.02, 0.05])


def jitter(rng, pose, shift, turn):
    small = Rotation.from_rotvec(rng.normal(scale=turn, size=3)).as_matrix()
    return pose @ rigid(small, rng.normal(scale=shift, size=3))


def hands(rng, count, spread=0.6):
    turns = Rotation.from_rotvec(rng.uniform(-spread, spread, (count, 3))) * Rotation.from_euler("y", 2.4)
    places = rng.uniform([0.2, -0.2, 0.1], [0.45, 0.2, 0.35], (count, 3))
    return [rigid(turn.as_matrix(), place) for turn, place in zip(turns, places, strict=True)]


def recorded(rng, count=20, shift=1e-3, turn=2e-3, mount="eye_to_hand", spread=0.6):
    pairs = []
    for hand in hands(rng, count, spread):
        if mount == "eye_to_hand":
            seen = invert_rigid(BASE_FROM_CAMERA) @ hand @ CONSTANT
        else:
            seen = invert_rigid(hand @ TCP_FROM_CAMERA) @ CONSTANT
        pairs.append((jitter(rng, hand, 0.3 * shift, 0.3 * turn), jitter(rng, seen, shift, turn)))
    return Recording(*np.array(pairs).swapaxes(0, 1), INTRINSICS, "f0123", mount)


def off(found, true):
    turn = Rotation.from_matrix(found[:3, :3].T @ true[:3, :3]).magnitude()
    return 1e3 * np.linalg.norm(found[:3, 3] - true[:3, 3]), np.degrees(turn)


@pytest.mark.parametrize("mount", ["eye_to_hand", "eye_in_hand"])
@pytest.mark.parametrize("seed", range(2))
def test_noisy_pairs_give_the_transform_back(seed, mount):
    """1 mm and 0.1 degrees of noise on the target, 20 pairs: within 2 mm and 0.2 degrees."""
    found = solve(recorded(np.random.default_rng(seed), mount=mount))[0]
    true = BASE_FROM_CAMERA if mount == "eye_to_hand" else TCP_FROM_CAMERA
    millimetres, degrees = off(found, true)
    assert millimetres < 2.0
    assert degrees < 0.2


def test_too_few_and_too_similar_pairs_are_refused():
    rng = np.random.default_rng(0)
    with pytest.raises(RobotError, match="at least 8 pose pairs, got 5"):
        solve(recorded(rng, count=5))
    with pytest.raises(RobotError, match="turn it by 15 or more"):
        solve(recorded(rng, spread=0.03))


def made(**changes):
    fields = {"transform": BASE_FROM_CAMERA, "intrinsics": INTRINSICS, "serial": "f0123", "rmse": 0.001}
    return Calibration(**{**fields, **changes})


def test_a_calibration_survives_its_file(tmp_path: Path):
    path = tmp_path / "hand_eye.json"
    made().save(path)
    read = Calibration.load(path, serial="f0123")
    assert np.allclose(read.transform, BASE_FROM_CAMERA)
    assert (read.intrinsics, read.rmse) == (INTRINSICS, 0.001)
    assert set(json.loads(path.read_text())) == {
        "T_base_camera", "intrinsics", "serial", "rmse", "convention",
    }  # fmt: skip


def test_mirrored_inexact_and_foreign_calibrations_are_refused(tmp_path: Path):
    with pytest.raises(RobotError, match="determinant -1"):
        made(transform=BASE_FROM_CAMERA @ np.diag([1.0, 1.0, -1.0, 1.0]))
    with pytest.raises(RobotError, match=r"6\.0 mm"):
        made(rmse=0.006)
    with pytest.raises(RobotError, match="nan mm"):
        made(rmse=float("nan"))
    path = tmp_path / "hand_eye.json"
    made().save(path)
    with pytest.raises(RobotError, match="camera 'f0123', but the camera in use is 'other'"):
        Calibration.load(path, serial="other")
    body = json.loads(path.read_text())
    body["T_base_camera"][0] = [-v for v in body["T_base_camera"][0]]
    path.write_text(json.dumps(body))
    with pytest.raises(RobotError, match="determinant -1"):
        Calibration.load(path)


def written(tmp_path: Path, recording: Recording) -> Path:
    path = tmp_path / "recording.json"
    names = ("base_from_tcp", "camera_from_target")
    poses = zip(*(getattr(recording, name).tolist() for name in names), strict=True)
    body = {"mount": recording.mount, "serial": recording.serial, "intrinsics": vars(INTRINSICS)}
    path.write_text(json.dumps({**body, "pairs": [dict(zip(names, pair, strict=True)) for pair in poses]}))
    return path


def test_the_command_writes_the_calibration(tmp_path: Path, capsys):
    path = written(tmp_path, recorded(np.random.default_rng(2)))
    rmse = job(CalibrateConfig(pairs=str(path)), load_plugins(), tmp_path)
    said = capsys.readouterr().out
    assert all(word in said for word in ("pair 19", "RMSE", "hand_eye.json"))
    read = Calibration.load(tmp_path / "hand_eye.json", "f0123")
    assert read.rmse == rmse
    assert off(read.transform, BASE_FROM_CAMERA)[0] < 2.0


def test_a_bad_recording_leaves_no_calibration(tmp_path: Path):
    rng = np.random.default_rng(2)
    path = written(tmp_path, recorded(rng, shift=0.02, turn=0.05))
    with pytest.raises(RobotError, match="RMSE"):
        job(CalibrateConfig(pairs=str(path)), load_plugins(), tmp_path)
    assert not (tmp_path / "hand_eye.json").exists()
    broken = written(tmp_path, recorded(rng))
    body = json.loads(broken.read_text())
    body["pairs"][3]["base_from_tcp"][0][0] = float("nan")
    broken.write_text(json.dumps(body))
    with pytest.raises(RobotError, match="pair 3"):
        job(CalibrateConfig(pairs=str(broken)), load_plugins(), tmp_path)
