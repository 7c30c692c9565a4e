"""The search behind the axis compensation: Gauss-Newton on contours, or the paper's energy."""

from __future__ import annotations

from functools import partial

import numpy as np
from scipy.optimize import minimize

from gvla2.geometry.transform import FloatArray
from gvla2.geometry.views import View, Views
from gvla2.reconstruction.compiled import run_together
from gvla2.reconstruction.contracts import AxisFit
from gvla2.reconstruction.outline import outline
from gvla2.reconstruction.silhouette import mean_iou
from gvla2.reconstruction.support import MaskStack, mask_of
from gvla2_plugins.axes.contour import Contour, mask_contour
from gvla2_plugins.axes.options import AxisOptions
from gvla2_plugins.axes.residuals import Residuals, outline_residuals

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
