"""The calibration file of a camera beside a robot, and the file of pose pairs behind it.

A calibration is one JSON object: ``T_base_camera`` (4, 4) (or ``T_tcp_camera`` for a camera on the hand),
``intrinsics`` (fx, fy, cx, cy, width, height), ``serial``, ``date``, ``n``, ``rmse`` (metres), ``residuals`` (metres
per pair) and ``convention``.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from gvla2.errors import GeometryError, RobotError
from gvla2.geometry.transform import FloatArray, check_rigid
from gvla2.io.files import write_whole
from gvla2.robot.hand_eye import Mount, PosePair

LARGEST_RMSE = 0.005
"""Metres; a calibration worse than that is refused."""
ODD = 5.0
"""A pair is named when its residual exceeds the median by this factor."""

CONVENTION = "T_a_b maps points of b into a; metres; camera x right, y down, z forward, right-handed"

_KEYS: dict[Mount, str] = {"eye_to_hand": "T_base_camera", "eye_in_hand": "T_tcp_camera"}


@dataclass(frozen=True)
class Intrinsics:
    """Pixels; the principal point counts from the image's upper left corner."""

    fx: float
    fy: float
    cx: float
    cy: float
    width: int
    height: int

    @property
    def K(self) -> FloatArray:  # noqa: N802 - the field's own name
        """(3, 3) matrix in pixels."""
        return np.array([[self.fx, 0.0, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]])


@dataclass(frozen=True)
class Calibration:
    """Where a camera stands. ``transform`` (4, 4) is base_from_camera, or tcp_from_camera for an eye in the hand.

    Raises :class:`RobotError` for a mirrored or skewed transform and for an ``rmse`` (metres) above 5 mm.
    """

    transform: FloatArray
    intrinsics: Intrinsics
    serial: str
    n: int
    rmse: float
    residuals: tuple[float, ...] = ()
    mount: Mount = "eye_to_hand"
    date: str = field(default_factory=lambda: datetime.now(UTC).isoformat(timespec="seconds"))

    def __post_init__(self) -> None:
        try:
            matrix = check_rigid(self.transform, f"{_KEYS[self.mount]} of camera '{self.serial}'")
        except GeometryError as error:
            raise RobotError(f"{error} Calibrate again.") from error
        object.__setattr__(self, "transform", matrix)
        if not 0 <= self.rmse <= LARGEST_RMSE:
            raise RobotError(
                f"The calibration of camera '{self.serial}' leaves residuals of {1e3 * self.rmse:.1f} mm (RMSE); at "
                f"most {1e3 * LARGEST_RMSE:.0f} mm are accepted.{_odd_pairs(self.residuals)} Check that positions are "
                "in metres and poses the right way round (base from hand, camera from board); then calibrate again, "
                "with stiller and sharper pictures."
            )

    def save(self, path: Path) -> None:
        """Write the file whole or not at all; raises :class:`OutputError`."""
        body = {
            _KEYS[self.mount]: self.transform.tolist(),
            "intrinsics": vars(self.intrinsics),
            "serial": self.serial,
            "date": self.date,
            "n": self.n,
            "rmse": self.rmse,
            "residuals": list(self.residuals),
            "convention": CONVENTION,
        }
        write_whole(path, (json.dumps(body, indent=2) + "\n").encode())

    @classmethod
    def load(cls, path: Path, serial: str = "") -> Calibration:
        """Read and check a calibration; ``serial`` is the camera in use, "" for any.

        Raises :class:`RobotError`, naming the file, if it is damaged, mirrored, too inexact, of another convention, or
        for another camera.
        """
        body = _read(path, "calibration")
        mount: Mount = "eye_in_hand" if _KEYS["eye_in_hand"] in body else "eye_to_hand"
        try:
            if body["convention"] != CONVENTION:
                raise RobotError(
                    f"The calibration {path} has a different convention: {body['convention']!r}."
                )
            calibration = cls(
                transform=np.array(body[_KEYS[mount]], dtype=np.float64),
                intrinsics=_intrinsics(body["intrinsics"]),
                serial=str(body["serial"]),
                n=int(body["n"]),
                rmse=float(body["rmse"]),
                residuals=tuple(float(v) for v in body["residuals"]),
                mount=mount,
                date=str(body["date"]),
            )
        except (KeyError, TypeError, ValueError) as error:
            raise RobotError(f"The calibration {path} {_detail(error)}. Calibrate again.") from error
        if serial and calibration.serial != serial:
            raise RobotError(
                f"The calibration {path} is for camera '{calibration.serial}', but the camera in use is '{serial}'. "
                "Calibrate this one, or plug in the other."
            )
        return calibration


@dataclass(frozen=True)
class Recording:
    """Pose pairs of one camera: the file has ``mount``, ``serial``, ``intrinsics`` and ``pairs``."""

    pairs: tuple[PosePair, ...]
    intrinsics: Intrinsics
    serial: str
    mount: Mount = "eye_to_hand"


def load_recording(path: Path) -> Recording:
    """Read recorded pose pairs; raises :class:`RobotError` that names the file and the pair."""
    body = _read(path, "recording of pose pairs")
    mount = body.get("mount", "eye_to_hand")
    if mount not in _KEYS:
        raise RobotError(f"{path}: mount is {mount!r}; it is one of {', '.join(_KEYS)}.")
    try:
        intrinsics, serial, given = _intrinsics(body["intrinsics"]), str(body["serial"]), list(body["pairs"])
    except (KeyError, TypeError, ValueError) as error:
        raise RobotError(f"{path} {_detail(error)}. It needs intrinsics, serial and pairs.") from error
    pairs = []
    for index, pair in enumerate(given):
        try:
            pairs.append(PosePair(np.array(pair["base_from_tcp"]), np.array(pair["camera_from_target"])))
        except (KeyError, TypeError, ValueError) as error:
            detail = f"{_detail(error)}. It needs base_from_tcp and camera_from_target, matrices (4, 4)"
            raise RobotError(f"{path}: pair {index} {detail}.") from error
    return Recording(tuple(pairs), intrinsics, serial, mount)


def _detail(error: Exception) -> str:
    """What is wrong with a file, by what was raised while reading its parts."""
    return f"lacks {error}" if isinstance(error, KeyError) else f"has a wrong part ({error})"


def _intrinsics(body: dict[str, Any]) -> Intrinsics:
    fx, fy, cx, cy = (float(body[name]) for name in ("fx", "fy", "cx", "cy"))
    made = Intrinsics(fx, fy, cx, cy, int(body["width"]), int(body["height"]))
    if not np.isfinite(made.K).all() or min(made.fx, made.fy, made.width, made.height) <= 0:
        raise ValueError(f"the intrinsics {body} are not those of a camera")
    return made


def _read(path: Path, what: str) -> dict[str, Any]:
    try:
        body = json.loads(path.read_text())
    except OSError as error:
        raise RobotError(f"The {what} {path} can't be read: {error.strerror}.") from error
    except ValueError as error:
        raise RobotError(f"The {what} {path} is not JSON: {error}.") from error
    if not isinstance(body, dict):
        raise RobotError(f"The {what} {path} must be one JSON object.")
    return body


def _odd_pairs(residuals: tuple[float, ...]) -> str:
    """Which pose pairs, from 0, disagree with the rest: residuals (metres) far above the median."""
    if len(residuals) < 3:
        return ""
    usual = sorted(residuals)[len(residuals) // 2]
    odd = [str(k) for k, each in enumerate(residuals) if each > ODD * usual]
    return f" Pairs that disagree with the rest: {', '.join(odd)}." if odd else ""
