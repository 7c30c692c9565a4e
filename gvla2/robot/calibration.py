"""Hand-eye calibration: where a camera stands, from pairs of a hand's pose and a target's pose seen by the camera.

A calibration is one JSON object: ``T_base_camera`` (4, 4) (or ``T_tcp_camera`` for a camera on the hand),
``intrinsics`` (fx, fy, cx, cy, width, height), ``serial``, ``date``, ``n``, ``rmse`` (metres), ``residuals`` (metres
per pair) and ``convention``.

Eye to hand (the target is held by the hand): ``tcp_from_target = inv(base_from_tcp) base_from_camera
camera_from_target`` is the same for every pair. Eye in hand (the target lies on the table): the constant is
``base_from_target = base_from_tcp tcp_from_camera camera_from_target``. OpenCV's closed form (Park and Martin
1994) finds the unknown, refined by least squares over the unknown and the constant together.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from itertools import combinations
from pathlib import Path
from typing import Any, Literal

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from gvla2.errors import GeometryError, RobotError
from gvla2.geometry.transform import FloatArray, check_rigid, invert_rigid, rigid
from gvla2.io.files import write_whole

Mount = Literal["eye_to_hand", "eye_in_hand"]

FEWEST_PAIRS = 8
SMALLEST_TURN = np.radians(15.0)
"""The hand must be turned at least this far about two axes: shifts alone leave a calibration undetermined."""

_LEVER = 0.3  # metres: the weight of a radian of rotation error in the refinement


@dataclass(frozen=True)
class PosePair:
    """One moment at rest: ``base_from_tcp`` (4, 4) by the robot's joints, ``camera_from_target`` (4, 4) as seen."""

    base_from_tcp: FloatArray
    camera_from_target: FloatArray

    def __post_init__(self) -> None:
        object.__setattr__(self, "base_from_tcp", check_rigid(self.base_from_tcp, "base_from_tcp"))
        object.__setattr__(
            self, "camera_from_target", check_rigid(self.camera_from_target, "camera_from_target")
        )


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


@dataclass(frozen=True)
class Solution:
    """``transform`` (4, 4) is base_from_camera, or tcp_from_camera for an eye in the hand.

    ``shifts`` (N,) metres and ``turns`` (N,) radians are each pair's deviations from the mean constant; ``rmse`` is the
    root mean square of the shifts, metres.
    """

    transform: FloatArray
    shifts: FloatArray
    turns: FloatArray

    @property
    def rmse(self) -> float:
        """Metres."""
        return float(np.sqrt(np.mean(self.shifts**2)))


def solve(pairs: Sequence[PosePair], mount: Mount = "eye_to_hand") -> Solution:
    """Where the camera stands; raises :class:`RobotError` for too few pairs, and for poses that are too similar."""
    if len(pairs) < FEWEST_PAIRS:
        raise RobotError(f"Hand-eye calibration needs at least {FEWEST_PAIRS} pose pairs, got {len(pairs)}.")
    _check_variety([pair.base_from_tcp[:3, :3] for pair in pairs], "hand")
    _check_variety([pair.camera_from_target[:3, :3] for pair in pairs], "target, as the camera sees it,")
    # An eye to hand is an eye in a hand that moves the other way round.
    hands = [p.base_from_tcp if mount == "eye_in_hand" else invert_rigid(p.base_from_tcp) for p in pairs]
    targets = [p.camera_from_target for p in pairs]
    transform = _refine(_closed_form(hands, targets), hands, targets)
    constants = [hand @ transform @ target for hand, target in zip(hands, targets, strict=True)]
    mean = _mean(constants)
    shifts = np.array([np.linalg.norm(c[:3, 3] - mean[:3, 3]) for c in constants])
    turns = np.array([Rotation.from_matrix(mean[:3, :3].T @ c[:3, :3]).magnitude() for c in constants])
    return Solution(transform, shifts, turns)


def _closed_form(hands: Sequence[FloatArray], targets: Sequence[FloatArray]) -> FloatArray:
    """The unknown (4, 4) with ``hand unknown target`` constant."""
    import cv2

    rotation, shift = cv2.calibrateHandEye(
        [h[:3, :3] for h in hands],
        [h[:3, 3] for h in hands],
        [t[:3, :3] for t in targets],
        [t[:3, 3] for t in targets],
        method=cv2.CALIB_HAND_EYE_PARK,
    )
    if not np.isfinite(rotation).all():
        raise RobotError("No transform was found: are the poses of hand and target of the same moments?")
    return rigid(rotation, np.ravel(shift))


def _check_variety(rotations: Sequence[FloatArray], what: str) -> None:
    """Turns about one axis only leave the calibration open along that axis."""
    between = np.array([b @ a.T for a, b in combinations(rotations, 2)])
    turns = Rotation.from_matrix(between).as_rotvec()
    # radians along each axis of turning
    spread = np.linalg.svd(turns, compute_uv=False) / np.sqrt(len(turns))
    if spread[1] < SMALLEST_TURN / 2.0:
        raise RobotError(
            f"The {what} was turned by {np.degrees(spread[1]):.1f} degrees about its second axis; turn it by 15 "
            "or more about two axes between the pictures, and calibrate again."
        )


def _refine(start: FloatArray, hands: Sequence[FloatArray], targets: Sequence[FloatArray]) -> FloatArray:
    """Least squares over the unknown and the constant, shifts in metres, turns at a lever of 0.3 m."""
    first = _mean([h @ start @ t for h, t in zip(hands, targets, strict=True)])

    def unpack(x: FloatArray) -> tuple[FloatArray, FloatArray]:
        moved = start @ rigid(Rotation.from_rotvec(x[:3]).as_matrix(), x[3:6])
        return moved, first @ rigid(Rotation.from_rotvec(x[6:9]).as_matrix(), x[9:12])

    def residuals(x: FloatArray) -> FloatArray:
        unknown, constant = unpack(x)
        parts = []
        for hand, target in zip(hands, targets, strict=True):
            error = invert_rigid(constant) @ hand @ unknown @ target
            parts += [error[:3, 3], _LEVER * Rotation.from_matrix(error[:3, :3]).as_rotvec()]
        return np.concatenate(parts)

    return unpack(least_squares(residuals, np.zeros(12), method="lm").x)[0]


def _mean(poses: Sequence[FloatArray]) -> FloatArray:
    rotation = Rotation.from_matrix(np.array([p[:3, :3] for p in poses])).mean().as_matrix()
    return rigid(rotation, np.mean([p[:3, 3] for p in poses], axis=0))
