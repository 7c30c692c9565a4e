"""Hand-eye calibration: where a camera stands, from pairs of a hand's pose and a target's pose seen by the camera.

Eye to hand (the target is held by the hand): ``tcp_from_target = inv(base_from_tcp) base_from_camera
camera_from_target`` is the same for every pair. Eye in hand (the target lies on the table): the constant is
``base_from_target = base_from_tcp tcp_from_camera camera_from_target``. OpenCV's closed form (Park and Martin
1994) finds the unknown, refined by least squares over the unknown and the constant together.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Literal

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from gvla2.errors import RobotError
from gvla2.geometry.transform import FloatArray, check_rigid, invert_rigid, rigid

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
