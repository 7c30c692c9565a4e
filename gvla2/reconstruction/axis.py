"""Axis compensation: one scale an axis and one shift, so that the shape fills its masks (source B of the paper).

T(p) = c + (p - c) * a + d along given axes, six numbers in all. The paper chooses them by E_mask, which only
rewards shrinking (``mode="paper"``). By default they make the shape's outlines meet the masks' contours: where the
nearest edge of the points' outline lies along the contour's normal, in pixels, is a residual, and Gauss-Newton
with Huber weights brings the residuals to zero. The outcome is kept only when the symmetric IoU rises.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import minimize

from gvla2.errors import GeometryError
from gvla2.geometry.transform import FloatArray
from gvla2.geometry.views import View, Views
from gvla2.reconstruction.compiled import run_together
from gvla2.reconstruction.contour import Contour, mask_contour
from gvla2.reconstruction.outline import outline
from gvla2.reconstruction.residuals import Residuals, outline_residuals
from gvla2.reconstruction.silhouette import coverage
from gvla2.reconstruction.support import MaskStack, as_points, mask_of

LEAST_RESIDUALS = 30
"""With fewer contour points that find an outline, six numbers are not estimated."""
_RESOLUTION = 0.15
"""Share of the closing radius that an outline of scattered points lies within the true one, measured."""


@dataclass(frozen=True)
class AxisOptions:
    """How to search for a and d.

    ``scale_bounds`` and ``shift_bound`` (share of the object's longest side) are (0.9, 1.1) and 0.05 by default,
    the released (0.98, 1.02) and 0.008 with ``mode="paper"``. ``rho_scale`` and ``rho_shift`` are the paper's priors
    on |a - 1|^2 and |d / side|^2; None means 1e-4 (against mean squared residuals in units of the object's size
    in the image), and 1 with ``mode="paper"`` (against E_mask). ``points``: at most so many are drawn (evenly
    spaced in index); ``contour_points`` a view. ``axes`` (3, 3) has orthonormal columns in the world frame, along which
    a and d are meant. ``least_gain`` is the rise of symmetric IoU below which the input is kept.
    """

    mode: Literal["default", "paper"] = "default"
    scale_bounds: tuple[float, float] | None = None
    shift_bound: float | None = None
    rho_scale: float | None = None
    rho_shift: float | None = None
    iterations: int = 10
    contour_points: int = 400
    points: int = 100_000
    axes: FloatArray = field(default_factory=lambda: np.eye(3))
    least_gain: float = 5e-4

    def bounds(self, side: float) -> tuple[FloatArray, FloatArray]:
        """Lowest and highest (a, d / side), (6,) each; errors for bounds that leave out the identity."""
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


@dataclass(frozen=True)
class AxisFit:
    """``scale`` a (3,) and ``shift`` d (3,) metres about ``centre`` (3,) along the columns of ``axes`` (3, 3).

    When not ``accepted``, a = 1 and d = 0 and ``reason`` says why; ``iou_before`` and ``iou_after`` are the
    symmetric IoU of the input and of what was found (NaN when no mask shows anything).
    """

    scale: FloatArray
    shift: FloatArray
    accepted: bool
    iou_before: float
    iou_after: float
    iterations: int
    reason: str
    centre: FloatArray
    axes: FloatArray

    def apply(self, points: ArrayLike) -> FloatArray:
        """T(p) of world points (N, 3), metres, for Gaussians and mesh alike; the points themselves if not accepted."""
        array = as_points(points)
        return _transform(array, self.centre, self.axes, self.scale, self.shift) if self.accepted else array


def compensate(
    points: ArrayLike,
    views: Views,
    centre: ArrayLike,
    options: AxisOptions | None = None,
    *,
    extents: ArrayLike | None = None,
) -> AxisFit:
    """Find a and d for the world points (N, 3), metres, about ``centre`` (3,) (paper, axis compensation).

    The denser the points lie on the surface, the better: from 30 thousand points the outline is some 0.3 %
    too small, from 100 thousand 0.1 %. Sample a mesh where there is one. ``extents`` (N,) metres: how far the
    surface lies outside each point, for Gaussians that are centred within the object.
    Falls back to the identity with a reason; raises :class:`GeometryError` for malformed input and missing masks.
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
    if extents is not None and np.shape(extents) != (len(array),):
        raise GeometryError(f"extents must be ({len(array)},), got shape {np.shape(extents)}.")
    finite = np.flatnonzero(np.isfinite(array).all(axis=1))
    kept = finite[:: max(1, -(-len(finite) // chosen.points))]
    sample = np.ascontiguousarray(array[kept])
    sizes = None if extents is None else np.asarray(extents, dtype=np.float64)[kept]
    masks = [mask_of(view) for view in views]
    search = _Search(sample, sizes, views, c, axes, chosen)
    if len(sample) < LEAST_RESIDUALS:
        return search.rejected(f"only {len(sample)} finite points")
    if not any((mask > 0.5).any() for mask in masks):
        return search.rejected("every mask is empty")
    return search.by_mask_energy() if chosen.mode == "paper" else search.by_contours()


def _transform(
    points: FloatArray, c: FloatArray, axes: FloatArray, a: FloatArray, d: FloatArray
) -> FloatArray:
    return np.ascontiguousarray(c + ((points - c) @ axes * a + d) @ axes.T)


class _Search:
    """One search; its unknowns x (6,) are a and d in units of the object's longest side."""

    def __init__(
        self,
        points: FloatArray,
        extents: FloatArray | None,
        views: Views,
        centre: FloatArray,
        axes: FloatArray,
        options: AxisOptions,
    ) -> None:
        self.points, self.extents, self.views = points, extents, views
        self.centre, self.axes, self.options = centre, axes, options
        local = (points - centre) @ axes
        # Without the outermost half percent, so that a few stray points do not widen the bounds.
        spread = np.ptp(np.quantile(local, [0.005, 0.995], axis=0), axis=0) if len(local) else np.ones(3)
        self.side = max(float(spread.max()), 1e-12)
        self.low, self.high = options.bounds(self.side)
        self.rho = options.priors()
        self.identity = np.array([1.0, 1.0, 1.0, 0.0, 0.0, 0.0])
        self.radii: list[float | None] = [None] * len(views)  # one closing for all iterations

    def moved(self, x: FloatArray) -> FloatArray:
        return _transform(self.points, self.centre, self.axes, x[:3], x[3:] * self.side)

    def iou(self, x: FloatArray) -> float:
        return coverage(self.moved(x), self.views, extents=self.extents).mean_iou

    def rejected(
        self, reason: str, before: float = np.nan, after: float = np.nan, iterations: int = 0
    ) -> AxisFit:
        return AxisFit(
            np.ones(3), np.zeros(3), False, before, after, iterations, reason, self.centre, self.axes
        )

    def accepted(self, x: FloatArray, before: float, after: float, iterations: int, reason: str) -> AxisFit:
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
        parts: list[Residuals | None] = [None] * len(self.views)

        def job(number: int, view: View) -> Callable[[], None]:
            def run() -> None:
                drawn = outline(points, view.camera, self.extents, self.radii[number])
                self.radii[number] = drawn.radius
                reach = self._reach(view)
                parts[number] = outline_residuals(drawn, contours[number], points, view.camera, reach)

            return run

        run_together([job(number, view) for number, view in enumerate(self.views)])
        return Residuals.joined([part for part in parts if part is not None])

    def _pixels_a_side(self, view: View) -> float:
        depth = (self.centre - view.camera.position) @ view.camera.world_from_camera[:3, 2]
        return float(view.camera.K[0, 0] * self.side / max(depth, 1e-6 + 0.5 * self.side))

    def _reach(self, view: View) -> float:
        """Pixels along the normal in which the outline is looked for: as far as the bounds let it move."""
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
        """Solve for the step with the unknowns that lie on a bound and push outwards held still."""
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
