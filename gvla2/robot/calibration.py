"""Hand-eye calibration: the file that says where a camera stands.

It is one JSON object: ``T_base_camera`` (4, 4) (or ``T_tcp_camera`` for a camera on the hand), ``intrinsics`` (fx, fy,
cx, cy, width, height), ``serial``, ``rmse`` (metres) and ``convention``. ``examples/08_hand_eye.py`` finds it from
recorded pose pairs by OpenCV; any other tool may write it.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np

from gvla2.errors import RobotError, reading
from gvla2.geometry.camera import Camera
from gvla2.geometry.transform import FloatArray
from gvla2.io.files import write_whole

Mount = Literal["eye_to_hand", "eye_in_hand"]

LARGEST_RMSE = 0.005
"""Metres; a calibration worse than that is refused."""

CONVENTION = "T_a_b maps points of b into a; metres; camera x right, y down, z forward, right-handed"

_KEYS: dict[Mount, str] = {"eye_to_hand": "T_base_camera", "eye_in_hand": "T_tcp_camera"}


@dataclass(frozen=True)
class Calibration:
    """Where a camera stands: the pose of ``lens`` is base_from_camera, or tcp_from_camera for an eye in the hand.

    Raises :class:`RobotError` for an ``rmse`` (metres) above 5 mm.
    """

    lens: Camera
    serial: str
    rmse: float
    mount: Mount = "eye_to_hand"

    def __post_init__(self) -> None:
        if not 0 <= self.rmse <= LARGEST_RMSE:
            raise RobotError(
                f"The calibration of camera '{self.serial}' leaves residuals of {1e3 * self.rmse:.1f} mm (RMSE); at "
                f"most {1e3 * LARGEST_RMSE:.0f} mm are accepted. Check that positions are in metres and poses the "
                "right way round (base from hand, camera from board); then calibrate again, with stiller and sharper "
                "pictures."
            )

    def camera(self, name: str, base_from_tcp: FloatArray | None) -> Camera:
        """The pinhole camera in the base frame. One on the hand needs the tool's pose ``base_from_tcp`` (4, 4)."""
        pose = self.lens.world_from_camera
        if self.mount == "eye_in_hand":
            if base_from_tcp is None:
                raise RobotError(f"The camera '{self.serial}' is on the hand: it needs the hand's pose.")
            pose = base_from_tcp @ pose
        return replace(self.lens, world_from_camera=pose, name=name)

    def save(self, path: Path) -> None:
        """Write the file whole or not at all; raises :class:`OutputError`."""
        (fx, _, cx), (_, fy, cy), _ = self.lens.K.tolist()
        size = {"width": self.lens.width, "height": self.lens.height}
        body = {
            _KEYS[self.mount]: self.lens.world_from_camera.tolist(),
            "intrinsics": {"fx": fx, "fy": fy, "cx": cx, "cy": cy, **size},
            "serial": self.serial,
            "rmse": self.rmse,
            "convention": CONVENTION,
        }
        write_whole(path, (json.dumps(body, indent=2) + "\n").encode())

    @classmethod
    def load(cls, path: Path, serial: str = "") -> Calibration:
        """Read and check a calibration; ``serial`` is the camera in use, "" for any.

        Raises :class:`RobotError`, naming the file, if it is damaged, mirrored, too inexact, of another convention, or
        for another camera.
        """
        with reading("a calibration", path, RobotError, "Calibrate again."):
            body = dict(json.loads(path.read_text("utf-8-sig")))
            mount: Mount = "eye_in_hand" if _KEYS["eye_in_hand"] in body else "eye_to_hand"
            if body["convention"] != CONVENTION:
                raise ValueError(f"the convention {body['convention']!r} is not ours")
            pose, lens = np.array(body[_KEYS[mount]], dtype=np.float64), body["intrinsics"]
            made = cls(pinhole(pose=pose, **lens), str(body["serial"]), float(body["rmse"]), mount)
        if serial and made.serial != serial:
            raise RobotError(
                f"The calibration {path} is for camera '{made.serial}', but the camera in use is '{serial}'. "
                "Calibrate this one, or plug in the other."
            )
        return made


def pinhole(
    fx: float, fy: float, cx: float, cy: float, width: int, height: int, pose: FloatArray | None = None
) -> Camera:
    """A camera of these pixels, the principal point counted from the image's upper left corner."""
    matrix = np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
    return Camera(matrix, np.eye(4) if pose is None else pose, width, height)
