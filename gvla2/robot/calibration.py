"""Hand-eye calibration: where a camera stands, from pairs of a hand's pose and a target's pose seen by the camera.

A calibration is one JSON object: ``T_base_camera`` (4, 4) (or ``T_tcp_camera`` for a camera on the hand),
``intrinsics`` (fx, fy, cx, cy, width, height), ``serial``, ``rmse`` (metres) and ``convention``.

Eye to hand (the target is held by the hand): ``tcp_from_target = inv(base_from_tcp) base_from_camera
camera_from_target`` is the same for every pair. Eye in hand (the target lies on the table): the constant is
``base_from_target = base_from_tcp tcp_from_camera camera_from_target``. OpenCV's closed form (Park and Martin 1994)
finds the unknown, refined by least squares of the pairs' deviations.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from typing import Any, Literal

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from gvla2.errors import GeometryError, RobotError
from gvla2.geometry.camera import Camera
from gvla2.geometry.transform import FloatArray, check_rigid, invert_rigid, rigid
from gvla2.io.files import write_whole

Mount = Literal["eye_to_hand", "eye_in_hand"]

FEWEST_PAIRS = 8
SMALLEST_TURN = np.radians(15.0)
"""The hand must be turned at least this far about two axes: shifts alone leave a calibration undetermined."""

LARGEST_RMSE = 0.005
"""Metres; a calibration worse than that is refused."""

CONVENTION = "T_a_b maps points of b into a; metres; camera x right, y down, z forward, right-handed"

_LEVER = 0.3  # metres: the weight of a radian of rotation error in the refinement
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

    def __post_init__(self) -> None:
        numbers = list(vars(self).values())
        if not np.isfinite(numbers).all() or min(self.fx, self.fy, self.width, self.height) <= 0:
            raise ValueError(f"the intrinsics {vars(self)} are not those of a camera")


@dataclass(frozen=True)
class Calibration:
    """Where a camera stands. ``transform`` (4, 4) is base_from_camera, or tcp_from_camera for an eye in the hand.

    Raises :class:`RobotError` for a mirrored or skewed transform and for an ``rmse`` (metres) above 5 mm.
    """

    transform: FloatArray
    intrinsics: Intrinsics
    serial: str
    rmse: float
    mount: Mount = "eye_to_hand"

    def __post_init__(self) -> None:
        try:
            matrix = check_rigid(self.transform, f"{_KEYS[self.mount]} of camera '{self.serial}'")
        except GeometryError as error:
            raise RobotError(f"{error} Calibrate again.") from error
        object.__setattr__(self, "transform", matrix)
        if not 0 <= self.rmse <= LARGEST_RMSE:
            raise RobotError(
                f"The calibration of camera '{self.serial}' leaves residuals of {1e3 * self.rmse:.1f} mm (RMSE); at "
                f"most {1e3 * LARGEST_RMSE:.0f} mm are accepted. Check that positions are in metres and poses the "
                "right way round (base from hand, camera from board); then calibrate again, with stiller and sharper "
                "pictures."
            )

    def camera(self, name: str, base_from_tcp: FloatArray | None) -> Camera:
        """The pinhole camera in the base frame. One on the hand needs the tool's pose ``base_from_tcp`` (4, 4)."""
        pose, i = self.transform, self.intrinsics
        if self.mount == "eye_in_hand":
            if base_from_tcp is None:
                raise RobotError(f"The camera '{self.serial}' is on the hand: it needs the hand's pose.")
            pose = base_from_tcp @ pose
        matrix = np.array([[i.fx, 0.0, i.cx], [0.0, i.fy, i.cy], [0.0, 0.0, 1.0]])
        return Camera(matrix, pose, i.width, i.height, name)

    def save(self, path: Path) -> None:
        """Write the file whole or not at all; raises :class:`OutputError`."""
        body = {
            _KEYS[self.mount]: self.transform.tolist(),
            "intrinsics": vars(self.intrinsics),
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
        body = _read(path)
        mount: Mount = "eye_in_hand" if _KEYS["eye_in_hand"] in body else "eye_to_hand"
        try:
            if body["convention"] != CONVENTION:
                raise ValueError(f"the convention {body['convention']!r} is not ours")
            transform = np.array(body[_KEYS[mount]], dtype=np.float64)
            intrinsics = Intrinsics(**body["intrinsics"])
            made = cls(transform, intrinsics, str(body["serial"]), float(body["rmse"]), mount)
        except (KeyError, TypeError, ValueError) as error:
            raise RobotError(
                f"The calibration {path} lacks or has a wrong {error}. Calibrate again."
            ) from error
        if serial and made.serial != serial:
            raise RobotError(
                f"The calibration {path} is for camera '{made.serial}', but the camera in use is '{serial}'. "
                "Calibrate this one, or plug in the other."
            )
        return made


@dataclass(frozen=True)
class Recording:
    """Pose pairs (N, 4, 4) of one camera, each taken at rest: ``base_from_tcp`` by the robot's joints and
    ``camera_from_target`` as seen.
    """

    base_from_tcp: FloatArray
    camera_from_target: FloatArray
    intrinsics: Intrinsics
    serial: str
    mount: Mount = "eye_to_hand"


def load_recording(path: Path) -> Recording:
    """Read ``mount``, ``serial``, ``intrinsics`` and ``pairs`` of a JSON file.

    Raises :class:`RobotError` that names the file and the pair.
    """
    body, where = _read(path), str(path)
    try:
        mount: Mount = body.get("mount", "eye_to_hand")
        if mount not in _KEYS:
            raise ValueError(f"mount {mount!r}; it is one of {', '.join(_KEYS)}")
        intrinsics, serial = Intrinsics(**body["intrinsics"]), str(body["serial"])
        poses = []
        for index, pair in enumerate(body["pairs"]):
            where = f"{path}: pair {index}"
            poses += [
                check_rigid(np.array(pair[name]), name) for name in ("base_from_tcp", "camera_from_target")
            ]
    except (KeyError, TypeError, ValueError) as error:
        raise RobotError(
            f"{where} lacks or has a wrong {error}. A recording has intrinsics, serial and pairs of base_from_tcp and "
            "camera_from_target, matrices (4, 4)."
        ) from error
    return Recording(*np.array(poses).reshape(-1, 2, 4, 4).swapaxes(0, 1), intrinsics, serial, mount)


def _read(path: Path) -> dict[str, Any]:
    try:
        body = json.loads(path.read_text())
    except (OSError, ValueError) as error:
        raise RobotError(f"{path} can't be read as JSON: {error}.") from error
    if not isinstance(body, dict):
        raise RobotError(f"{path} must be one JSON object.")
    return body


def solve(recording: Recording) -> tuple[FloatArray, FloatArray, FloatArray]:
    """The transform (4, 4) of :class:`Calibration`, and each pair's deviations from the mean constant: shifts (N,)
    in metres, turns (N,) in radians.

    Raises :class:`RobotError` for too few pairs, and for poses that are too similar.
    """
    import cv2

    hands, targets = recording.base_from_tcp, recording.camera_from_target
    if len(hands) < FEWEST_PAIRS:
        raise RobotError(f"Hand-eye calibration needs at least {FEWEST_PAIRS} pose pairs, got {len(hands)}.")
    for poses, what in ((hands, "hand"), (targets, "target, as the camera sees it,")):
        _check_variety(poses, what)
    if recording.mount == "eye_to_hand":  # an eye in a hand that moves the other way round
        hands = np.array([invert_rigid(hand) for hand in hands])
    pairs = (list(poses[:, :3, part]) for poses in (hands, targets) for part in (slice(3), 3))
    rotation, shift = cv2.calibrateHandEye(*pairs, method=cv2.CALIB_HAND_EYE_PARK)
    if not np.isfinite(rotation).all():
        raise RobotError("No transform was found: are the poses of hand and target of the same moments?")
    start = rigid(rotation, np.ravel(shift))

    def moved(x: FloatArray) -> FloatArray:
        return start @ rigid(Rotation.from_rotvec(x[:3]).as_matrix(), x[3:])

    def weighted(x: FloatArray) -> FloatArray:
        return (_deviations(hands @ moved(x) @ targets) * ([1.0] * 3 + [_LEVER] * 3)).ravel()

    transform = moved(least_squares(weighted, np.zeros(6), method="lm").x)
    off = _deviations(hands @ transform @ targets)
    return transform, np.linalg.norm(off[:, :3], axis=1), np.linalg.norm(off[:, 3:], axis=1)


def _deviations(poses: FloatArray) -> FloatArray:
    """(N, 6) shifts in metres and turns in radians of poses (N, 4, 4) from their mean."""
    turns, shifts = Rotation.from_matrix(poses[:, :3, :3]), poses[:, :3, 3]
    return np.hstack([shifts - shifts.mean(axis=0), (turns.mean().inv() * turns).as_rotvec()])


def _check_variety(poses: FloatArray, what: str) -> None:
    """Turns about one axis only leave the calibration open along that axis."""
    between = np.array([b @ a.T for a, b in combinations(poses[:, :3, :3], 2)])
    turns = Rotation.from_matrix(between).as_rotvec()
    # radians along each axis of turning
    spread = np.linalg.svd(turns, compute_uv=False) / np.sqrt(len(turns))
    if spread[1] < SMALLEST_TURN / 2.0:
        raise RobotError(
            f"The {what} was turned by {np.degrees(spread[1]):.1f} degrees about its second axis; turn it by 15 "
            "or more about two axes between the pictures, and calibrate again."
        )
