"""Depth maps as evidence with errors of their own: one joint, robust solve of what each view has wrong.

Depth of view i is believed up to a smooth factor exp(B_i(u) theta_i): a scale, a tilt across the object, its relief,
and a coarse field. The unknowns of all views are found together (scipy's dogleg, Cauchy loss) from

    r_pair   = n . (p_i - q_j) / sigma          samples of one view against planes through another's points
    r_hull   = log d - log d_front, d_back      surfaces lie within the visual hull, most of them near its front
    r_mask   = log d - log d_cap                where another view's mask has no other surface on its ray
    r_prior  = theta / spread                   how large such errors are

The noise sigma and the spread of tilts are estimated from what is left over, round by round: first with stiff terms
alone, then with the field. An estimate's poses are dropped before (see ``evidence``): with masks and depth on the same
pixels, what a wrong pose does to depth is a tilt, a scale and a field, so that no pose is solved for.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from gvla2.geometry.transform import FloatArray
from gvla2.geometry.views import Views
from gvla2.reconstruction.depth_looks import KNOTS, LOW, Link, Look, linked, look_at, turned

ROUNDS, STIFF = 8, 4
"""Rounds of matching and solving, and how many of them keep the field still."""
SCALE, TILT, RELIEF = 0.3, 0.1, 0.03
"""Standard deviations of log scale, tilt and relief before anything is known; the tilt's is then estimated."""
STILL = 1e-3
"""The field's standard deviation while it is kept still."""
CAUCHY = 2.4
"""Standard deviations beyond which a pair counts less and less."""
DRAW, GAP = 0.15, 0.06
"""How strongly depth is drawn to the hull's front, from within this share of the hull's thickness."""
GATE = 0.10
"""Largest relative distance of a pair at first."""
STEPS = 8
"""Steps of a solve, between two rounds of matching."""
UNEVEN = 0.5
"""The field's knots leave at least this share of its size unexplained."""


@dataclass(frozen=True)
class Aligned:
    """Depth after correction, and how far to trust it.

    ``depth`` (S, H, W) metres, NaN where unknown or where a view could not be used; ``std`` (S, H, W) relative standard
    deviation; ``theta`` (S, P) what was wrong: log scale, two tilts, relief, field.
    """

    depth: FloatArray
    std: FloatArray
    theta: FloatArray


def align(
    depth: FloatArray,
    solid: NDArray[np.bool_],
    views: Views,
    front: FloatArray,
    back: FloatArray,
    caps: FloatArray,
) -> Aligned:
    """Correct depth maps (S, H, W), metres, NaN where unknown.

    ``solid`` (S, H, W) marks pixels that do not fly between surfaces; ``front`` and ``back`` (S, H, W) are the depths
    between which the visual hull lies, NaN outside it; ``caps`` (S, H, W) depths behind which no surface can begin,
    NaN where nobody knows.
    """
    looks = [look_at(*each) for each in zip(views, depth, solid, front, back, caps, strict=True)]
    size = LOW + KNOTS * KNOTS
    theta = np.zeros((len(looks), size))
    for s, look in enumerate(looks):
        if look is not None:
            theta[s, 0] = look.scale_within_hull()
    pixel = float(np.median([1 / view.camera.K[0, 0] for view in views]))
    sigma, gate, field, tilt = 0.02, GATE, STILL, TILT
    covariance, rows = np.eye(theta.size), 0
    for number in range(ROUNDS):
        if 0 < number <= STIFF:
            looks = [None if look is None else turned(look, theta[s]) for s, look in enumerate(looks)]
        spread = np.concatenate([[SCALE, tilt, tilt, RELIEF], np.full(size - LOW, field)])
        problem = _Problem(looks, linked(looks, theta, gate), sigma, max(pixel, sigma), spread)
        theta, covariance = problem.solved(theta)
        rows, gaps = problem.rows, problem.gaps(theta)
        if len(gaps) == 0:
            break
        left = float(1.4826 * np.median(np.abs(gaps)) / np.sqrt(2))
        if number == STIFF - 1:
            field = max(left, 1e-4)  # what stiff terms leave over is the field's
        sigma = max(left, 0.1 * pixel, UNEVEN * field if number >= STIFF else 0.0)
        # How large tilts are: their posterior second moment, the mean over the views (MacKay's evidence).
        moment = theta**2 + np.diag(covariance).reshape(theta.shape)
        tilt = float(np.sqrt(moment[:, 1:3].mean()))
        gate = float(np.clip(5 * left, 4 * pixel, GATE))
    # Rows that share a knot share an error, and count once.
    covariance = covariance * max(1.0, rows / (len(looks) * KNOTS * KNOTS))
    return _corrected(depth, looks, theta, covariance, sigma)


def _corrected(
    depth: FloatArray, looks: Sequence[Look | None], theta: FloatArray, covariance: FloatArray, sigma: float
) -> Aligned:
    corrected, std = np.full(depth.shape, np.nan), np.full(depth.shape, np.nan)
    size = theta.shape[1]
    for s, look in enumerate(looks):
        if look is None:
            continue
        known = np.isfinite(depth[s])
        log = np.log(depth[s][known])
        design = look.basis.at(look.camera.pixel_centres()[known], log)
        own = covariance[s * size : (s + 1) * size, s * size : (s + 1) * size]
        corrected[s][known] = np.exp(log + design @ theta[s])
        std[s][known] = np.sqrt(np.einsum("np,np->n", design @ own, design) + sigma**2)
    return Aligned(corrected, std, theta)


Rows = tuple[FloatArray, float, tuple[tuple[int, FloatArray], ...]]
"""Residuals (N,), the square of the Cauchy loss's width, and their slopes (N, P) by the views that they are of."""


class _Problem:
    """The negative log posterior of all unknowns theta (S, P), and its minimum.

    ``sigma`` relative noise of depth; ``edge`` relative width of the hull's surface; ``spread`` (P,) of the unknowns.
    The solver sees them in units of their spread.
    """

    def __init__(
        self,
        looks: Sequence[Look | None],
        links: Sequence[Link],
        sigma: float,
        edge: float,
        spread: FloatArray,
    ) -> None:
        self._looks = [(s, look) for s, look in enumerate(looks) if look is not None]
        self._links, self._sigma, self._edge = links, np.sqrt(2) * sigma, edge
        self._spread = np.tile(spread, len(looks)).reshape(len(looks), -1)
        self.rows = sum(len(link.which) for link in links)

    def solved(self, theta: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The likeliest theta near the given one, and its covariance (S P, S P)."""
        bounds: dict[str, Any] = {"initial_trust_radius": 10.0, "max_trust_radius": 1000.0, "maxiter": STEPS}
        answer = minimize(  # type: ignore[call-overload]  # jac=True: the cost brings its slope
            self._cost, (theta / self._spread).ravel(), method="dogleg", jac=True, hess=self._curvature,
            options=bounds,
        )  # fmt: skip
        scale = self._spread.ravel()
        covariance = np.linalg.inv(self._curvature(answer.x)) * np.outer(scale, scale)
        return (answer.x * scale).reshape(theta.shape), covariance

    def _rows(self, theta: FloatArray) -> Iterator[Rows]:
        for link in self._links:
            of_i, of_j = link.slopes(theta)
            slopes = (link.i, of_i / self._sigma), (link.j, of_j / self._sigma)
            yield link.gap(theta) / self._sigma, CAUCHY**2, slopes
        for s, look in self._looks:
            now = look.at + look.design @ theta[s]
            # Little may lie before the hull's front, much behind it.
            behind = np.maximum(GAP * (look.farthest - look.nearest), self._edge) / DRAW
            width = np.where(now < look.nearest, self._edge, behind)
            yield (now - look.nearest) / width, 1.0, ((s, look.design / width[:, None]),)
            past = np.maximum(now - look.farthest, 0) / self._edge
            yield past, 1.0, ((s, look.design * ((past > 0) / self._edge)[:, None]),)
            at, design, cap = look.capped
            past = np.maximum(at + design @ theta[s] - cap, 0) / self._edge
            yield past, 1.0, ((s, design * ((past > 0) / self._edge)[:, None]),)

    def _cost(self, z: FloatArray) -> tuple[float, FloatArray]:
        """Cauchy for what pairs and hull say, squares for what errors are like; and the slope by z."""
        z = z.reshape(self._spread.shape)
        cost, slope = 0.5 * float((z * z).sum()), z.copy()
        for r, width, slopes in self._rows(z * self._spread):
            cost += 0.5 * width * float(np.log1p(r * r / width).sum())
            for s, by in slopes:
                slope[s] += self._spread[s] * ((r / (1 + r * r / width)) @ by)
        return cost, slope.ravel()

    def _curvature(self, z: FloatArray) -> FloatArray:
        """(S P, S P) second derivative of a reweighted least squares: positive definite, so that no step overshoots."""
        views, size = self._spread.shape
        made = np.zeros((views, size, views, size))
        for r, width, slopes in self._rows(z.reshape(views, size) * self._spread):
            weight = 1 / (1 + r * r / width)
            for s, by in slopes:
                for t, other in slopes:
                    made[s, :, t] += (weight[:, None] * by).T @ other
        scale = self._spread.ravel()
        return np.asarray(made.reshape(len(scale), -1) * np.outer(scale, scale) + np.eye(len(scale)))

    def gaps(self, theta: FloatArray) -> FloatArray:
        """Relative distances of all pairs."""
        return np.concatenate([link.gap(theta) for link in self._links] or [np.zeros(0)])
