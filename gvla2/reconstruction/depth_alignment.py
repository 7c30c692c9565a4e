"""Depth maps as evidence with errors of their own: one joint, robust solve of what each view has wrong.

Depth of view i is believed up to a smooth factor exp(B_i(u) theta_i): a scale, a tilt across the object, its relief,
and a coarse field. The unknowns of all views are found together (scipy's least squares, Cauchy loss) from

    r_pair   = n . (p_i - q_j) / sigma          samples of one view against planes through another's points
    r_hull   = log d - log d_front, d_back      surfaces lie within the visual hull, most of them near its front
    r_prior  = theta / spread                   how large such errors are

The noise sigma and the spread of tilts are estimated from what is left over, round by round: first with stiff terms
alone, then with the field. An estimate's poses are dropped before (see ``evidence``): with masks and depth on the same
pixels, what a wrong pose does to depth is a tilt, a scale and a field, so that no pose is solved for.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

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
    depth: FloatArray, solid: NDArray[np.bool_], views: Views, front: FloatArray, back: FloatArray
) -> Aligned:
    """Correct depth maps (S, H, W), metres, NaN where unknown.

    ``solid`` (S, H, W) marks pixels that do not fly between surfaces; ``front`` and ``back`` (S, H, W) are the depths
    between which the visual hull lies, NaN outside it.
    """
    looks = [look_at(*each) for each in zip(views, depth, solid, front, back, strict=True)]
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
        answer = least_squares(
            problem.residuals, theta.ravel(), problem.jacobian, loss=cast(Any, problem.loss),
            max_nfev=6, x_scale=1 / problem.prior, ftol=1e-4, xtol=1e-5,
        )  # fmt: skip
        theta = answer.x.reshape(theta.shape)
        jacobian = np.asarray(answer.jac)
        covariance, rows = np.linalg.inv(jacobian.T @ jacobian), problem.data
        gaps = problem.gaps(theta)
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


class _Problem:
    """Residuals of all unknowns theta (S * P,), their Jacobian and their loss.

    ``sigma`` relative noise of depth; ``edge`` relative width of the hull's surface; ``spread`` (P,) of the unknowns.
    """

    def __init__(
        self,
        looks: Sequence[Look | None],
        links: Sequence[Link],
        sigma: float,
        edge: float,
        spread: FloatArray,
    ) -> None:
        self.shape = len(looks), len(spread)
        self._looks = [(s, look) for s, look in enumerate(looks) if look is not None]
        self._links, self._sigma, self._edge = links, np.sqrt(2) * sigma, edge
        self.prior = np.tile(1 / spread, len(looks))
        self.data = sum(len(link.which) for link in links)
        self._hull = 2 * sum(len(look.at) for _, look in self._looks)

    def residuals(self, x: FloatArray) -> FloatArray:
        theta = x.reshape(self.shape)
        parts = [link.gap(theta) / self._sigma for link in self._links]
        for s, look in self._looks:
            now = look.at + look.design @ theta[s]
            parts += [(now - look.nearest) / self._width(look, now)]
            parts += [np.maximum(now - look.farthest, 0) / self._edge]
        return np.concatenate([*parts, x * self.prior])

    def jacobian(self, x: FloatArray) -> FloatArray:
        theta, size = x.reshape(self.shape), self.shape[1]
        made = np.zeros((self.data + self._hull + len(x), len(x)))
        row = 0
        for link in self._links:
            rows = slice(row, row + len(link.which))
            of_i, of_j = link.slopes(theta)
            made[rows, link.i * size : (link.i + 1) * size] = of_i / self._sigma
            made[rows, link.j * size : (link.j + 1) * size] = of_j / self._sigma
            row = rows.stop
        for s, look in self._looks:
            now = look.at + look.design @ theta[s]
            for weight in (1 / self._width(look, now), (now > look.farthest) / self._edge):
                made[row : row + len(now), s * size : (s + 1) * size] = weight[:, None] * look.design
                row += len(now)
        made[row:] = np.diag(self.prior)
        return made

    def _width(self, look: Look, now: FloatArray) -> FloatArray:
        """Relative depth that counts as one deviation: little before the hull's front, much behind it."""
        behind = np.maximum(GAP * (look.farthest - look.nearest), self._edge) / DRAW
        return np.where(now < look.nearest, self._edge, behind)

    def loss(self, z: FloatArray) -> FloatArray:
        """Cauchy for what pairs and hull say, squares for what errors are like.

        Without the second derivative each step is a reweighted least squares, which never overshoots.
        """
        told = self.data + self._hull
        width = np.concatenate([np.full(self.data, CAUCHY**2), np.ones(self._hull)])
        rho = np.stack([z, np.ones_like(z), np.zeros_like(z)])
        rho[0, :told] = width * np.log1p(z[:told] / width)
        rho[1, :told] = 1 / (1 + z[:told] / width)
        return rho

    def gaps(self, theta: FloatArray) -> FloatArray:
        """Relative distances of all pairs."""
        return np.concatenate([link.gap(theta) for link in self._links] or [np.zeros(0)])
