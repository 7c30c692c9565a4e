"""Options of an axis compensation."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from gvla2.errors import GeometryError
from gvla2.geometry.transform import FloatArray


@dataclass(frozen=True)
class AxisOptions:
    """How to search for a and d.

    ``scale_bounds`` and ``shift_bound`` (share of the object's longest side) are (0.9, 1.1) and 0.05 by default,
    the released (0.98, 1.02) and 0.008 with ``mode="paper"``. ``rho_scale`` and ``rho_shift`` are the paper's priors
    on |a - 1|^2 and |d / side|^2; None means 1e-4 (against mean squared residuals in units of the object's size
    in the image), and 1 with ``mode="paper"`` (against E_mask).

    ``points``: at most so many are used, drawn with a fixed seed; by default 100 thousand, 20 thousand with
    ``mode="paper"``. ``contour_points`` per view. ``axes`` (3, 3) has orthonormal columns in the world frame, along
    which a and d apply. ``least_gain`` is the rise of symmetric IoU below which the input is kept.
    """

    mode: Literal["default", "paper"] = "default"
    scale_bounds: tuple[float, float] | None = None
    shift_bound: float | None = None
    rho_scale: float | None = None
    rho_shift: float | None = None
    iterations: int = 10
    contour_points: int = 400
    points: int | None = None
    axes: FloatArray = field(default_factory=lambda: np.eye(3))
    least_gain: float = 5e-4

    def bounds(self, side: float) -> tuple[FloatArray, FloatArray]:
        """Lowest and highest (a, d / side), (6,) each; errors for bounds that exclude the identity."""
        paper = self.mode == "paper"
        low, high = self.scale_bounds or ((0.98, 1.02) if paper else (0.9, 1.1))
        shift = self.shift_bound if self.shift_bound is not None else (0.008 if paper else 0.05)
        if not (0 < low <= 1 <= high and shift >= 0 and side > 0):
            raise GeometryError(
                "Axis compensation: scale_bounds must enclose 1 and shift_bound be >= 0, "
                f"got ({low}, {high}) and {shift}."
            )
        return np.array([low] * 3 + [-shift] * 3), np.array([high] * 3 + [shift] * 3)

    def priors(self) -> FloatArray:
        """(6,) weights of (a - 1)^2 and (d / side)^2."""
        default = 1.0 if self.mode == "paper" else 1e-4
        scale = default if self.rho_scale is None else self.rho_scale
        shift = default if self.rho_shift is None else self.rho_shift
        return np.array([scale] * 3 + [shift] * 3)
