"""Axis compensation: one scale per axis and one shift, so that the shape fills its masks (source B of the paper).

T(p) = c + (p - c) * a + d along given axes, six numbers in all. The paper chooses them by E_mask, which only rewards
shrinking (``mode="paper"``). By default they make the shape's outlines meet the masks' contours: the distance to the
nearest edge of the points' outline along the contour's normal, in pixels, is a residual, and Gauss-Newton with Huber
weights minimises the residuals. The result is kept only if the symmetric IoU rises.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import partial
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import minimize

from gvla2.errors import GeometryError
from gvla2.geometry.transform import FloatArray
from gvla2.geometry.views import View, Views
from gvla2.reconstruction.compiled import run_together
from gvla2.reconstruction.contracts import AxisFit
from gvla2.reconstruction.silhouette import mean_iou, outline
from gvla2.reconstruction.support import MaskStack, as_points, mask_of
from gvla2_plugins.axes.residuals import Contour, Residuals, mask_contour, outline_residuals

__all__ = ["AxisFit", "AxisOptions", "compensate"]


def compensate(
    points: ArrayLike,
    views: Views,
    centre: ArrayLike,
    options: AxisOptions | None = None,
) -> AxisFit:
    """Find a and d for the world points (N, 3), metres, about ``centre`` (3,) (paper, axis compensation).

    The denser the points lie on the surface, the better: from 30 thousand points the outline is some 0.3 % too small,
    from 100 thousand 0.1 %. Sample a mesh if there is one. Falls back to the identity with a reason; raises
    :class:`GeometryError` for malformed input and missing masks.
    """
    chosen = options or AxisOptions()
    array = as_points(points)
    c = np.asarray(centre, dtype=np.float64)
    axes = np.asarray(chosen.axes, dtype=np.float64)
    if c.shape != (3,) or not np.isfinite(c).all():
        raise GeometryError(f"Axis compensation: the centre must be three finite numbers, got {c}.")
    if axes.shape != (3, 3) or not np.allclose(axes.T @ axes, np.eye(3), atol=1e-6):
        raise GeometryError("Axis compensation: axes must be 3x3 with orthonormal columns.")
    if chosen.mode not in ("default", "paper"):
        raise GeometryError(f"No axis mode '{chosen.mode}'. Available: default, paper.")
    finite = np.flatnonzero(np.isfinite(array).all(axis=1))
    most = chosen.points or (20_000 if chosen.mode == "paper" else 100_000)
    if most < 1:
        raise GeometryError(f"Axis compensation: points must be >= 1, got {most}.")
    kept = finite
    if len(finite) > most:  # by chance: a fixed stride through points in grid order would leave stripes
        kept = np.sort(np.random.default_rng(0).choice(finite, most, replace=False, shuffle=False))
    sample = np.ascontiguousarray(array[kept])
    masks = [mask_of(view) for view in views]
    search = AxisSearch(sample, views, c, axes, chosen)
    if len(sample) < LEAST_RESIDUALS:
        return search.rejected(f"only {len(sample)} finite points")
    if not any((mask > 0.5).any() for mask in masks):
        return search.rejected("every mask is empty")
    return search.by_mask_energy() if chosen.mode == "paper" else search.by_contours()


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


LEAST_RESIDUALS = 30
"""Least contour points with an outline for estimating six numbers."""
_RESOLUTION = 0.2
"""How far an outline of scattered points lies inside the true one, as a share of the closing radius, measured."""


class AxisSearch:
    """One search; its unknowns x (6,) are a and d in units of the object's longest side."""

    def __init__(
        self,
        points: FloatArray,
        views: Views,
        centre: FloatArray,
        axes: FloatArray,
        options: AxisOptions,
    ) -> None:
        self.points, self.views = points, views
        self.centre, self.axes, self.options = centre, axes, options
        local = (points - centre) @ axes
        # Without the outermost half percent, so that a few strays do not widen the bounds.
        spread = np.ptp(np.quantile(local, [0.005, 0.995], axis=0), axis=0) if len(local) else np.ones(3)
        self.side = max(float(spread.max()), 1e-12)
        self.low, self.high = options.bounds(self.side)
        self.rho = options.priors()
        self.identity = np.array([1.0, 1.0, 1.0, 0.0, 0.0, 0.0])
        self.radii: list[float | None] = [None] * len(views)  # one closing for all iterations

    def moved(self, x: FloatArray) -> FloatArray:
        """The points transformed by x."""
        return self.accepted(x, np.nan, np.nan, 0, "").apply(self.points)

    def iou(self, x: FloatArray) -> float:
        """Symmetric IoU of the points transformed by x."""
        return mean_iou(self.moved(x), self.views)

    def rejected(
        self, reason: str, before: float = np.nan, after: float = np.nan, iterations: int = 0
    ) -> AxisFit:
        """The identity, and why."""
        return AxisFit(
            np.ones(3), np.zeros(3), False, before, after, iterations, reason, self.centre, self.axes
        )

    def accepted(self, x: FloatArray, before: float, after: float, iterations: int, reason: str) -> AxisFit:
        """x, with shift in metres."""
        return AxisFit(
            x[:3].copy(), x[3:] * self.side, True, before, after, iterations, reason, self.centre, self.axes
        )

    def by_mask_energy(self) -> AxisFit:
        """The paper's objective, E_mask and its priors, within bounds."""
        stack = MaskStack.of(self.views)

        def objective(x: FloatArray) -> float:
            energy = 1.0 - stack.support(self.moved(x)).mean()
            return float(energy + self.rho @ (x - self.identity) ** 2)

        start = objective(self.identity)
        found = minimize(
            objective,
            self.identity,
            method="L-BFGS-B",
            bounds=list(zip(self.low, self.high, strict=True)),
            options={"eps": 1e-4, "maxiter": self.options.iterations * 5},
        )
        before, after = self.iou(self.identity), self.iou(found.x)
        if not found.fun < start - 1e-9:
            return self.rejected("E_mask does not fall", before, after, int(found.nit))
        text = f"E_mask and priors fell from {start:.6f} to {found.fun:.6f}"
        return self.accepted(found.x, before, after, int(found.nit), text)

    def by_contours(self) -> AxisFit:
        """Gauss-Newton on the contours, then the gate."""
        contours = [mask_contour(mask_of(view), self.options.contour_points) for view in self.views]
        x, best, best_cost, used = self.identity, self.identity, np.inf, 0
        floor = np.inf
        for _ in range(self.options.iterations + 1):
            residuals = self._residuals(x, contours)
            if len(residuals.pixels) < LEAST_RESIDUALS:
                if used == 0:
                    return self.rejected(
                        f"only {len(residuals.pixels)} contour points find an outline nearby, "
                        f"{LEAST_RESIDUALS} are needed"
                    )
                break
            cost, step, floor = self._step(x, residuals, floor)
            if cost < best_cost:
                best, best_cost = x, cost
            if used == self.options.iterations:
                break
            following = np.clip(x + step, self.low, self.high)
            used += 1
            if np.abs(following - x).max() < 1e-5:
                break
            x = following
        return self._gate(best, used)

    def _residuals(self, x: FloatArray, contours: list[Contour]) -> Residuals:
        points = self.moved(x)

        def of(number: int, view: View) -> Residuals:
            drawn = outline(points, view.camera, self.radii[number])
            self.radii[number] = drawn.radius
            return outline_residuals(drawn, contours[number], points, view.camera, self._reach(view))

        jobs = [partial(of, number, view) for number, view in enumerate(self.views)]
        return Residuals.joined(run_together(jobs))

    def _pixels_a_side(self, view: View) -> float:
        depth = (self.centre - view.camera.position) @ view.camera.world_from_camera[:3, 2]
        return float(view.camera.K[0, 0] * self.side / max(depth, 1e-6 + 0.5 * self.side))

    def _reach(self, view: View) -> float:
        """Search range for the outline along the normal, pixels: as far as the bounds let it move."""
        widest = max(self.high[0] - 1, 1 - self.low[0]) + np.sqrt(3) * self.high[3]
        return float(np.clip(widest * self._pixels_a_side(view), 3.0, 40.0))

    def _step(self, x: FloatArray, residuals: Residuals, floor: float) -> tuple[float, FloatArray, float]:
        """Huber cost, Gauss-Newton step and Huber's threshold in pixels, which only ever shrinks."""
        r = residuals.pixels
        floor = min(floor, max(0.5, 1.5 * float(np.median(np.abs(r)))))
        size = np.abs(r)
        huber = np.where(size <= floor, 0.5 * r * r, floor * (size - 0.5 * floor))
        weight = residuals.weight / residuals.weight.sum()
        pixels = float(np.mean([self._pixels_a_side(view) for view in self.views]))
        cost = float(weight @ huber) / pixels**2 + float(self.rho @ (x - self.identity) ** 2)
        # d(pixels)/d(a, d / side): the outline's point moves by a along the axes, seen from the normal.
        local = (self.points[residuals.index] - self.centre) @ self.axes
        seen = residuals.gradient @ self.axes
        jacobian = np.concatenate([seen * local, seen * self.side], axis=1) / pixels
        pull = weight * np.minimum(1.0, floor / np.maximum(size, 1e-12))
        normal = jacobian.T @ (pull[:, None] * jacobian) + np.diag(2 * self.rho)
        slope = jacobian.T @ (pull * r) / pixels + 2 * self.rho * (x - self.identity)
        return cost, -self._solve_within(x, normal, slope), floor

    def _solve_within(self, x: FloatArray, normal: FloatArray, slope: FloatArray) -> FloatArray:
        """Solve for the step with unknowns that lie on a bound and push outwards held fixed."""
        free = np.ones(6, dtype=np.bool_)
        step = np.zeros(6)
        for _ in range(6):
            step[:] = 0.0
            if free.any():
                step[free] = np.linalg.lstsq(normal[np.ix_(free, free)], slope[free], rcond=None)[0]
            blocked = free & (((x >= self.high) & (step < 0)) | ((x <= self.low) & (step > 0)))
            if not blocked.any():
                break
            free &= ~blocked
        return step

    def _gate(self, x: FloatArray, iterations: int) -> AxisFit:
        before, after = self.iou(self.identity), self.iou(x)
        shift = np.linalg.norm(self.moved(x) - self.points, axis=1).mean() / self.side
        pixels = shift * float(np.mean([self._pixels_a_side(view) for view in self.views]))
        radius = float(np.mean([r for r in self.radii if r is not None]))
        if pixels < _RESOLUTION * radius:
            reason = f"the shape fits already: {pixels:.2f} px of motion is less than its points can tell"
            return self.rejected(reason, before, after, iterations)
        if not after >= before + self.options.least_gain:
            reason = f"symmetric IoU does not rise ({before:.4f} to {after:.4f})"
            return self.rejected(reason, before, after, iterations)
        return self.accepted(
            x, before, after, iterations, f"symmetric IoU rose from {before:.4f} to {after:.4f}"
        )


class Contours:
    """Gauss-Newton on silhouette contours."""

    def __init__(self, iterations: int, contour_points: int, least_gain: float) -> None:
        self._options = AxisOptions(
            iterations=iterations, contour_points=contour_points, least_gain=least_gain
        )

    def compensate(self, points: FloatArray, views: Views, centre: FloatArray) -> AxisFit:
        """The fit, or the identity with a reason."""
        return compensate(points, views, centre, self._options)


class MaskEnergy:
    """The paper's objective, E_mask and its priors."""

    def __init__(self, iterations: int) -> None:
        self._options = AxisOptions(mode="paper", iterations=iterations)

    def compensate(self, points: FloatArray, views: Views, centre: FloatArray) -> AxisFit:
        """The fit, or the identity with a reason."""
        return compensate(points, views, centre, self._options)
