"""Hand-eye calibration: refused when it can't be, written and read."""

import json
import os
from pathlib import Path

import numpy as np
import pytest

from gvla2.errors import RobotError
from gvla2.geometry.transform import look_along
from gvla2.robot.calibration import Calibration, pinhole

BASE_FROM_CAMERA = look_along([0.8, -0.3, 0.6], [-0.6, 0.3, -0.5])
LENS = pinhole(600.0, 601.0, 320.5, 240.25, 640, 480, BASE_FROM_CAMERA)


def made(**changes):
    fields = {"lens": LENS, "serial": "f0123", "rmse": 0.001}
    return Calibration(**{**fields, **changes})


def test_a_calibration_survives_its_file(tmp_path: Path):
    path = tmp_path / "hand_eye.json"
    made().save(path)
    read = Calibration.load(path, serial="f0123")
    assert np.allclose(read.lens.world_from_camera, BASE_FROM_CAMERA)
    assert np.allclose(read.lens.K, LENS.K)
    assert (read.lens.width, read.lens.height, read.rmse) == (640, 480, 0.001)
    assert set(json.loads(path.read_text())) == {
        "T_base_camera", "intrinsics", "serial", "rmse", "convention",
    }  # fmt: skip


def test_mirrored_inexact_and_foreign_calibrations_are_refused(tmp_path: Path):
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
    path.unlink()
    os.mkfifo(path)
    with pytest.raises(RobotError, match="not a file"):
        Calibration.load(path)
