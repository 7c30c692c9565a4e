"""Similarities Sim(3), and the scale between the cameras that a prior assumes and the calibrated ones."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from gvla2.errors import GeometryError
from gvla2.geometry.transform import FloatArray, check_rigid

_FLAT = 1e-6
"""Below this share of the distance from the origin, a spread counts as zero."""


@dataclass(frozen=True)
class Sim3:
    """x -> scale * rotation @ x + translation.

    ``rotation`` (3, 3) proper; ``translation`` (3,) in the target's unit; ``scale`` > 0, target units a source
    unit. Raises :class:`GeometryError` for anything else, a mirror (determinant -1) by name.
    """

    scale: float
    rotation: FloatArray
    translation: FloatArray

    def __post_init__(self) -> None:
        if not (np.isfinite(self.scale) and self.scale > 0):
            raise GeometryError(f"A similarity's scale must be a finite number > 0, got {self.scale}.")
        matrix = np.eye(4)
        matrix[:3, :3] = np.asarray(self.rotation, dtype=np.float64)
        matrix[:3, 3] = np.asarray(self.translation, dtype=np.float64)
        matrix = check_rigid(matrix, "A similarity's rotation and translation")
        object.__setattr__(self, "scale", float(self.scale))
        object.__setattr__(self, "rotation", matrix[:3, :3])
        object.__setattr__(self, "translation", matrix[:3, 3])

    def apply(self, points: ArrayLike) -> FloatArray:
        """Points (..., 3) of the source in the target's frame."""
        return np.asarray(
            self.scale * (np.asarray(points, dtype=np.float64) @ self.rotation.T) + self.translation
        )

    def compose(self, first: Sim3) -> Sim3:
        """``first``, then this one."""
        return Sim3(self.scale * first.scale, self.rotation @ first.rotation, self.apply(first.translation))


def scale_between(estimated: ArrayLike, calibrated: ArrayLike) -> float | None:
    """The scale of the similarity from a prior's cameras to the calibrated ones, by centres and axis points.

    ``estimated`` and ``calibrated`` are world_from_camera (S, 4, 4). Each camera stands for
    its centre and three points on its axes, one root mean square spread of the centres away, so that two or
    collinear centres fix the rotation too; the axes say nothing about scale, which comes from the centres alone.
    None when all centres coincide (one view, or a turning camera): depth must then be scaled by other means.
    Raises :class:`GeometryError` for different numbers of cameras, or poses that are not rigid.
    """
    a, b = (np.asarray(x, dtype=np.float64) for x in (estimated, calibrated))
    if a.ndim != 3 or len(a) == 0 or a.shape != b.shape:
        raise GeometryError(
            f"Cameras to align must both be (S, 4, 4) with S >= 1, got {a.shape} and {b.shape}."
        )
    a = np.stack([check_rigid(pose, f"Estimated camera {i}") for i, pose in enumerate(a)])
    b = np.stack([check_rigid(pose, f"Calibrated camera {i}") for i, pose in enumerate(b)])
    mean_a, mean_b = a[:, :3, 3].mean(axis=0), b[:, :3, 3].mean(axis=0)
    centres_a, centres_b = a[:, :3, 3] - mean_a, b[:, :3, 3] - mean_b
    spread_a, spread_b = (float(np.sqrt((c * c).sum(axis=1).mean())) for c in (centres_a, centres_b))
    # Far from the origin, equal centres differ by rounding.
    floor_a, floor_b = (_FLAT * max(float(np.abs(m).max()), 1e-6) for m in (mean_a, mean_b))
    if spread_a <= floor_a or spread_b <= floor_b:
        return None
    # Axis points at one spread's distance, in units of the spread: centres and axes then weigh alike.
    axes = np.einsum("sij,skj->ik", b[:, :3, :3], a[:, :3, :3])
    u, _, vt = np.linalg.svd(axes + centres_b.T @ centres_a / (spread_a * spread_b))
    # Of all proper rotations, the one with the largest trace of R^T times that.
    rotation = (u * [1.0, 1.0, np.sign(np.linalg.det(u) * np.linalg.det(vt))]) @ vt
    scale = float(np.sum(centres_b * (centres_a @ rotation.T)) / (len(a) * spread_a**2))
    return scale if scale > 0 else None
