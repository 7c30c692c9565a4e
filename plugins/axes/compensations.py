"""Axis compensation: one scale per axis and one shift, so that the shape fills its masks (source B of the paper).

T(p) = c + (p - c) * a + d, six numbers in all. The paper chooses them by E_mask, which only rewards shrinking
(:class:`MaskEnergy`). :class:`Contours` makes the shape's outlines meet the masks' contours: the distance to the
nearest edge of the points' outline along the contour's normal, in pixels, is a residual, and Gauss-Newton with Huber
weights minimises the residuals. The result is kept only if the symmetric IoU rises.
"""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import minimize

from gvla2.errors import ConfigurationError, GeometryError
from gvla2.geometry.compiled import run_together
from gvla2.geometry.transform import FloatArray
from gvla2.geometry.views import View, Views
from gvla2.reconstruction.contracts import AxisFit
from gvla2.reconstruction.silhouette import outline, symmetric_iou
from gvla2.reconstruction.support import MaskStack, as_points, mask_of
from gvla2_plugins.axes.residuals import Contour, Residuals, mask_contour, outline_residuals

if TYPE_CHECKING:
    from gvla2_plugins.axes import ContoursConfig

LEAST_RESIDUALS = 30
"""Least contour points with an outline for estimating six numbers."""
_POINTS, _ENERGY_POINTS = 100_000, 20_000
"""Most points used by contours and by E_mask, drawn with a fixed seed."""
_RHO = 1e-4
"""Weight of the paper's priors |a - 1|^2 and |d / side|^2 against residuals in units of the object's size in the image;
against E_mask it is 1."""
_RELEASED_SCALE, _RELEASED_SHIFT = 0.02, 0.008
"""The released code's bounds, as in ``ContoursConfig``."""
_RESOLUTION = 0.2
"""How far an outline of scattered points lies inside the true one, as a share of the closing radius, measured."""
IDENTITY = np.array([1.0, 1.0, 1.0, 0.0, 0.0, 0.0])


class Contours:
    """Gauss-Newton on silhouette contours."""

    def __init__(self, config: ContoursConfig) -> None:
        if not (0 < config.scale_bound < 1 and config.shift_bound >= 0):
            raise ConfigurationError(
                "axis=contours needs scale_bound in (0, 1) and shift_bound >= 0, got "
                f"{config.scale_bound:g} and {config.shift_bound:g}."
            )
        self._config = config

    def compensate(self, points: FloatArray, views: Views, centre: FloatArray) -> AxisFit:
        """The fit for world points (N, 3), metres, about ``centre`` (3,), or the identity with a reason.

        The denser the points lie on the surface, the better: from 30 thousand points the outline is some 0.3 % too
        small, from 100 thousand 0.1 %. Raises :class:`GeometryError` for malformed input and missing masks.
        """
        c = self._config
        search = _Search(points, views, centre, _POINTS, c.scale_bound, c.shift_bound)
        if search.reason:
            return search.rejected(search.reason)
        contours = [mask_contour(mask_of(view), c.contour_points) for view in views]
        x, best, best_cost, used, floor = IDENTITY, IDENTITY, np.inf, 0, np.inf
        for _ in range(c.iterations + 1):
            residuals = search.residuals(x, contours)
            if len(residuals.pixels) < LEAST_RESIDUALS:
                if used == 0:
                    return search.rejected(
                        f"only {len(residuals.pixels)} contour points find an outline nearby, "
                        f"{LEAST_RESIDUALS} are needed"
                    )
                break
            cost, step, floor = search.step(x, residuals, floor)
            if cost < best_cost:
                best, best_cost = x, cost
            if used == c.iterations:
                break
            following = np.clip(x + step, search.low, search.high)
            used += 1
            if np.abs(following - x).max() < 1e-5:
                break
            x = following
        return search.gated(best, used, c.least_gain)


class MaskEnergy:
    """The paper's objective, E_mask and its priors, within the released bounds."""

    def __init__(self, iterations: int) -> None:
        self._iterations = iterations

    def compensate(self, points: FloatArray, views: Views, centre: FloatArray) -> AxisFit:
        """The fit, or the identity with a reason; arguments and errors as in :class:`Contours`."""
        search = _Search(points, views, centre, _ENERGY_POINTS, _RELEASED_SCALE, _RELEASED_SHIFT)
        if search.reason:
            return search.rejected(search.reason)
        stack = MaskStack.of(views)

        def objective(x: FloatArray) -> float:
            energy = 1.0 - stack.support(search.moved(x)).mean()
            return float(energy + ((x - IDENTITY) ** 2).sum())

        start = objective(IDENTITY)
        found = minimize(
            objective,
            IDENTITY,
            method="L-BFGS-B",
            bounds=list(zip(search.low, search.high, strict=True)),
            options={"eps": 1e-4, "maxiter": self._iterations * 5},
        )
        before, after = search.iou(IDENTITY), search.iou(found.x)
        if not found.fun < start - 1e-9:
            return search.rejected("E_mask does not fall", before, after, int(found.nit))
        text = f"E_mask and priors fell from {start:.6f} to {found.fun:.6f}"
        return search.accepted(found.x, before, after, int(found.nit), text)


class _Search:
    """One search; its unknowns x (6,) are a and d in units of the object's longest side.

    ``reason`` says why there is nothing to search for, "" if there is.
    """

    def __init__(
        self, points: FloatArray, views: Views, centre: FloatArray, most: int, scale: float, shift: float
    ) -> None:
        array, self.centre = as_points(points), np.asarray(centre, dtype=np.float64)
        if self.centre.shape != (3,) or not np.isfinite(self.centre).all():
            raise GeometryError(f"Axis compensation: the centre must be three finite numbers, got {centre}.")
        kept = np.flatnonzero(np.isfinite(array).all(axis=1))
        if len(kept) > most:  # by chance: a fixed stride through points in grid order would leave stripes
            kept = np.sort(np.random.default_rng(0).choice(kept, most, replace=False, shuffle=False))
        self.points, self.views = np.ascontiguousarray(array[kept]), views
        # Without the outermost half percent, so that a few strays do not widen the bounds.
        spread = np.ptp(np.quantile(self.points, [0.005, 0.995], axis=0), axis=0) if len(kept) else np.ones(3)
        self.side = max(float(spread.max()), 1e-12)
        reach = np.array([scale] * 3 + [shift] * 3)
        self.low, self.high = IDENTITY - reach, IDENTITY + reach
        self.radii: list[float | None] = [None] * len(views)  # one closing for all iterations
        masks = [mask_of(view) for view in views]
        self.reason = "" if any((mask > 0.5).any() for mask in masks) else "every mask is empty"
        if len(kept) < LEAST_RESIDUALS:
            self.reason = f"only {len(kept)} finite points"

    def moved(self, x: FloatArray) -> FloatArray:
        """The points transformed by x."""
        return self.accepted(x, np.nan, np.nan, 0, "").apply(self.points)

    def iou(self, x: FloatArray) -> float:
        """Symmetric IoU of the points transformed by x."""
        return symmetric_iou(self.moved(x), self.views)

    def rejected(
        self, reason: str, before: float = np.nan, after: float = np.nan, iterations: int = 0
    ) -> AxisFit:
        """The identity, and why."""
        return AxisFit(np.ones(3), np.zeros(3), False, before, after, iterations, reason, self.centre)

    def accepted(self, x: FloatArray, before: float, after: float, iterations: int, reason: str) -> AxisFit:
        """The transform x, with its shift in metres."""
        return AxisFit(x[:3], x[3:] * self.side, True, before, after, iterations, reason, self.centre)

    def residuals(self, x: FloatArray, contours: list[Contour]) -> Residuals:
        """How far the outlines of the points transformed by x lie from the masks' contours."""
        points = self.moved(x)
        # As far along a normal as the bounds let an outline move.
        widest = self.high[0] - 1 + np.sqrt(3) * self.high[3]

        def of(number: int, view: View) -> Residuals:
            drawn = outline(points, view.camera, self.radii[number])
            self.radii[number] = drawn.radius
            reach = float(np.clip(widest * self._pixels_a_side(view), 3.0, 40.0))
            return outline_residuals(drawn, contours[number], points, view.camera, reach)

        return Residuals.joined(
            run_together([partial(of, number, view) for number, view in enumerate(self.views)])
        )

    def _pixels_a_side(self, view: View) -> float:
        depth = (self.centre - view.camera.position) @ view.camera.world_from_camera[:3, 2]
        return float(view.camera.K[0, 0] * self.side / max(depth, 1e-6 + 0.5 * self.side))

    def step(self, x: FloatArray, residuals: Residuals, floor: float) -> tuple[float, FloatArray, float]:
        """Huber cost, Gauss-Newton step and Huber's threshold in pixels, which only ever shrinks."""
        r = residuals.pixels
        floor = min(floor, max(0.5, 1.5 * float(np.median(np.abs(r)))))
        size = np.abs(r)
        huber = np.where(size <= floor, 0.5 * r * r, floor * (size - 0.5 * floor))
        weight = residuals.weight / residuals.weight.sum()
        pixels = float(np.mean([self._pixels_a_side(view) for view in self.views]))
        cost = float(weight @ huber) / pixels**2 + _RHO * float(((x - IDENTITY) ** 2).sum())
        # d(pixels)/d(a, d / side): the outline's point moves by a along the axes, seen from the normal.
        local, seen = self.points[residuals.index] - self.centre, residuals.gradient
        jacobian = np.concatenate([seen * local, seen * self.side], axis=1) / pixels
        pull = weight * np.minimum(1.0, floor / np.maximum(size, 1e-12))
        normal = jacobian.T @ (pull[:, None] * jacobian) + 2 * _RHO * np.eye(6)
        slope = jacobian.T @ (pull * r) / pixels + 2 * _RHO * (x - IDENTITY)
        return cost, -self._solve_within(x, normal, slope), floor

    def _solve_within(self, x: FloatArray, normal: FloatArray, slope: FloatArray) -> FloatArray:
        """Solve for the step with unknowns that lie on a bound and push outwards held fixed."""
        free, step = np.ones(6, dtype=np.bool_), np.zeros(6)
        for _ in range(6):
            step[:] = 0.0
            step[free] = np.linalg.lstsq(normal[np.ix_(free, free)], slope[free], rcond=None)[0]
            blocked = free & (((x >= self.high) & (step < 0)) | ((x <= self.low) & (step > 0)))
            if not blocked.any():
                break
            free &= ~blocked
        return step

    def gated(self, x: FloatArray, iterations: int, least_gain: float) -> AxisFit:
        """The fit x where it moves the shape by more than its points resolve, and its symmetric IoU rises."""
        before, after = self.iou(IDENTITY), self.iou(x)
        shift = np.linalg.norm(self.moved(x) - self.points, axis=1).mean() / self.side
        pixels = shift * float(np.mean([self._pixels_a_side(view) for view in self.views]))
        radius = float(np.mean([r for r in self.radii if r is not None]))
        if pixels < _RESOLUTION * radius:
            reason = f"the shape fits already: {pixels:.2f} px of motion is less than its points resolve"
            return self.rejected(reason, before, after, iterations)
        if not after >= before + least_gain:
            reason = f"symmetric IoU does not rise ({before:.4f} to {after:.4f})"
            return self.rejected(reason, before, after, iterations)
        reason = f"symmetric IoU rose from {before:.4f} to {after:.4f}"
        return self.accepted(x, before, after, iterations, reason)
