"""Closed-form answers to AX = XB: Tsai and Lenz, Park and Martin, Andreff; and OpenCV's, if available.

OpenCV's Python packages of the first 5.0 releases were built without ``calibrateHandEye``; nothing here depends on it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from itertools import combinations
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from gvla2.geometry.transform import FloatArray, invert_rigid, rigid

Solver = Callable[[Sequence[FloatArray], Sequence[FloatArray]], FloatArray]
"""From hands (N of (4, 4)) and targets (N of (4, 4)) to X (4, 4) with ``hand X target`` constant."""

_OPENCV_METHODS = ("TSAI", "PARK", "HORAUD", "ANDREFF", "DANIILIDIS")


def solvers() -> dict[str, Solver]:
    """All available solvers by name; OpenCV's are called ``opencv_...``."""
    own: dict[str, Solver] = {"tsai": tsai, "park": park, "andreff": andreff}
    try:
        import cv2
    except ImportError:
        return own
    if hasattr(cv2, "calibrateHandEye"):
        for method in _OPENCV_METHODS:
            number = getattr(cv2, f"CALIB_HAND_EYE_{method}")
            own[f"opencv_{method.lower()}"] = partial(_opencv, cv2, number)
    return own


def motions(
    hands: Sequence[FloatArray], targets: Sequence[FloatArray]
) -> tuple[list[FloatArray], list[FloatArray]]:
    """A and B of AX = XB for every two moments."""
    pairs = list(combinations(range(len(hands)), 2))
    a = [invert_rigid(hands[j]) @ hands[i] for i, j in pairs]
    return a, [targets[j] @ invert_rigid(targets[i]) for i, j in pairs]


def park(hands: Sequence[FloatArray], targets: Sequence[FloatArray]) -> FloatArray:
    """X turns the rotation vectors of B into those of A (Park and Martin 1994); then the shift by least squares."""
    a, b = motions(hands, targets)
    turn, _ = Rotation.align_vectors(_rotations(a).as_rotvec(), _rotations(b).as_rotvec())
    return _with_shift(turn.as_matrix(), a, b)


def tsai(hands: Sequence[FloatArray], targets: Sequence[FloatArray]) -> FloatArray:
    """Linear equations in a modified Rodrigues vector (Tsai and Lenz 1989)."""
    a, b = motions(hands, targets)
    # The vector is the axis times 2 sin(angle / 2): twice the quaternion's imaginary part.
    pa, pb = (2.0 * _rotations(poses).as_quat(canonical=True)[:, :3] for poses in (a, b))
    rows = np.concatenate([np.cross(np.eye(3), u + v) for u, v in zip(pa, pb, strict=True)])
    scaled = np.linalg.lstsq(rows, (pb - pa).ravel(), rcond=None)[0]
    p = 2.0 * scaled / np.sqrt(1.0 + scaled @ scaled)
    turn = Rotation.from_quat([*(0.5 * p), np.sqrt(max(0.0, 1.0 - 0.25 * p @ p))])
    return _with_shift(turn.as_matrix(), a, b)


def andreff(hands: Sequence[FloatArray], targets: Sequence[FloatArray]) -> FloatArray:
    """Rotation and shift as twelve linear unknowns (Andreff et al. 1999), then the nearest rotation."""
    a, b = motions(hands, targets)
    eye3, eye9 = np.eye(3), np.eye(9)
    rows, right = [], []
    for one, other in zip(a, b, strict=True):
        turn = eye9 - np.kron(one[:3, :3], other[:3, :3])  # R_X = R_A R_X R_B^T, row-major
        shift = np.kron(eye3, other[:3, 3][None, :])
        rows += [np.hstack([turn, np.zeros((9, 3))]), np.hstack([shift, eye3 - one[:3, :3]])]
        right += [np.zeros(9), one[:3, 3]]
    unknown = np.linalg.lstsq(np.vstack(rows), np.concatenate(right), rcond=None)[0]
    return _with_shift(_orthonormal(unknown[:9].reshape(3, 3)), a, b)


def _opencv(cv2: Any, method: int, hands: Sequence[FloatArray], targets: Sequence[FloatArray]) -> FloatArray:
    rotation, shift = cv2.calibrateHandEye(
        [h[:3, :3] for h in hands],
        [h[:3, 3] for h in hands],
        [t[:3, :3] for t in targets],
        [t[:3, 3] for t in targets],
        method=method,
    )
    return rigid(_orthonormal(np.asarray(rotation, dtype=np.float64)), np.ravel(shift))


def _with_shift(rotation: FloatArray, a: Sequence[FloatArray], b: Sequence[FloatArray]) -> FloatArray:
    """(R_A - I) t = R_X t_B - t_A."""
    rows = np.concatenate([one[:3, :3] - np.eye(3) for one in a])
    right = np.concatenate([rotation @ other[:3, 3] - one[:3, 3] for one, other in zip(a, b, strict=True)])
    return rigid(rotation, np.linalg.lstsq(rows, right, rcond=None)[0])


def _orthonormal(matrix: FloatArray) -> FloatArray:
    """The rotation nearest to a (3, 3) matrix."""
    u, _, vt = np.linalg.svd(matrix)
    return np.asarray(u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt)


def _rotations(poses: Sequence[FloatArray]) -> Rotation:
    return Rotation.from_matrix(np.array([p[:3, :3] for p in poses]))
