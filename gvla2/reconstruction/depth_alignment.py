"""Depth maps as evidence with errors of their own: one joint, robust solve of what each view has wrong.

Depth of view i is believed up to a smooth factor exp(B_i(u) theta_i): a scale, a tilt across the object, its relief,
and a coarse field. The unknowns of all views are found together (Gauss-Newton, Cauchy loss) from

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

import numpy as np
from numpy.typing import NDArray

from gvla2.geometry.transform import FloatArray
from gvla2.reconstruction.compiled import compiled
from gvla2.reconstruction.depth_looks import (
    KNOTS,
    LOW,
    UNKNOWNS,
    Design,
    Look,
    Pairs,
    linked,
    look_at,
    turned,
)
from gvla2.reconstruction.view_set import ViewSet

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
LITTLE = 0.05
"""A gain of the log posterior that is not worth another step."""
UNEVEN = 0.5
"""The field's knots leave at least this share of its size unexplained."""


@dataclass(frozen=True)
class Aligned:
    """Depth after correction, and how far to trust it.

    ``depth`` (S, H, W) metres, NaN where unknown or where a view could not be used; ``std`` (S, H, W) relative standard
    deviation.
    """

    depth: FloatArray
    std: FloatArray


def align(
    depth: FloatArray,
    solid: NDArray[np.bool_],
    seen: ViewSet,
    caps: FloatArray,
) -> Aligned:
    """Correct depth maps (S, H, W), metres, NaN where unknown.

    ``solid`` (S, H, W) marks pixels that do not fly between surfaces; ``caps`` (S, H, W) are depths behind which no
    surface can begin, NaN where nobody knows.
    """
    views, ends = seen.views, seen.hull_interval
    each = zip(views, seen.rays, depth, solid, *ends, caps, strict=True)
    looks = [look_at(s, *of_view) for s, of_view in enumerate(each)]
    theta = np.zeros((len(looks), UNKNOWNS))
    for s, look in enumerate(looks):
        if look is not None:
            theta[s, 0] = look.scale_within_hull()
    pixel = float(np.median([1 / view.camera.K[0, 0] for view in views]))
    sigma, gate, field, tilt = 0.02, GATE, STILL, TILT
    covariance, rows = np.eye(theta.size), 0
    for number in range(ROUNDS):
        if 0 < number <= STIFF:
            looks = [None if look is None else turned(look, theta) for look in looks]
        spread = np.concatenate([[SCALE, tilt, tilt, RELIEF], np.full(UNKNOWNS - LOW, field)])
        pairs = linked(looks, theta, gate)
        theta, covariance = _Problem(looks, pairs, sigma, max(pixel, sigma), spread).solved(theta)
        if pairs is None:
            break
        rows, gaps = len(pairs.at), pairs.gaps(theta)[0]
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
    for s, look in enumerate(looks):
        if look is None:
            continue
        known = np.isfinite(depth[s])
        log = np.log(depth[s][known])
        design = look.basis.at(look.camera.pixel_centres()[known], log)
        corrected[s][known] = np.exp(log + design @ theta)
        std[s][known] = np.sqrt(_variances(design.columns, design.values, covariance) + sigma**2)
    return Aligned(corrected, std)


Rows = tuple[FloatArray, float, Design]
"""Residuals (N,), the square of the Cauchy loss's width, and their slopes."""


class _Problem:
    """The negative log posterior of all unknowns theta (S, P), and its minimum.

    ``sigma`` relative noise of depth; ``edge`` relative width of the hull's surface; ``spread`` (P,) of the unknowns.
    The solver sees them in units of their spread.
    """

    def __init__(
        self,
        looks: Sequence[Look | None],
        pairs: Pairs | None,
        sigma: float,
        edge: float,
        spread: FloatArray,
    ) -> None:
        self._looks = [look for look in looks if look is not None]
        self._pairs, self._sigma, self._edge = pairs, np.sqrt(2) * sigma, edge
        self._spread = np.tile(spread, len(looks))

    def solved(self, theta: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The likeliest theta near the given one, and its covariance (S P, S P)."""
        z = theta.ravel() / self._spread
        now = self._at(z)
        for _ in range(STEPS):
            cost, slope, curvature = now
            step = -_inverse(curvature) @ slope
            now = self._at(z + step)
            while not now[0] <= cost and np.abs(step).max() > 1e-6:  # nor where depth has overflown
                step *= 0.5
                now = self._at(z + step)
            z = z + step
            if cost - now[0] < LITTLE:
                break
        covariance = _inverse(now[2]) * np.outer(self._spread, self._spread)
        return (z * self._spread).reshape(theta.shape), covariance

    def _rows(self, theta: FloatArray) -> Iterator[Rows]:
        if self._pairs is not None:
            gaps, slopes = self._pairs.gaps(theta)
            yield gaps / self._sigma, CAUCHY**2, Design(slopes.columns, slopes.values / self._sigma)
        for look in self._looks:
            now = look.at + look.design @ theta
            # Little may lie before the hull's front, much behind it.
            behind = np.maximum(GAP * (look.farthest - look.nearest), self._edge) / DRAW
            width = np.where(now < look.nearest, self._edge, behind)
            yield (now - look.nearest) / width, 1.0, look.design.scaled(1 / width)
            past = np.maximum(now - look.farthest, 0) / self._edge
            yield past, 1.0, look.design.scaled((past > 0) / self._edge)
            at, design, cap = look.capped
            past = np.maximum(at + design @ theta - cap, 0) / self._edge
            yield past, 1.0, design.scaled((past > 0) / self._edge)

    def _at(self, z: FloatArray) -> tuple[float, FloatArray, FloatArray]:
        """The cost at z, its slope (S P,), and the curvature (S P, S P) of a reweighted least squares.

        Cauchy for what pairs and hull say, squares for what errors are like. The curvature is positive definite.
        """
        cost, slope, curvature = 0.0, np.zeros(len(z)), np.zeros((len(z), len(z)))
        for r, width, slopes in self._rows(z * self._spread):
            weight = 1 / (1 + r * r / width)
            cost += 0.5 * width * float(np.log1p(r * r / width).sum())
            _gather(slopes.columns, slopes.values, weight, weight * r, slope, curvature)
        curvature *= np.outer(self._spread, self._spread)
        return cost + 0.5 * float(z @ z), slope * self._spread + z, curvature + np.eye(len(z))


@compiled
def _gather(
    columns: NDArray[np.intp],
    values: FloatArray,
    weight: FloatArray,
    pull: FloatArray,
    slope: FloatArray,
    curvature: FloatArray,
) -> None:
    """Add J^T pull and J^T diag(weight) J of rows (N, K) that have few columns each."""
    for n in range(len(columns)):
        for a in range(columns.shape[1]):
            i, value = columns[n, a], values[n, a]
            slope[i] += value * pull[n]
            for b in range(columns.shape[1]):
                curvature[i, columns[n, b]] += value * weight[n] * values[n, b]


@compiled
def _variances(columns: NDArray[np.intp], values: FloatArray, covariance: FloatArray) -> FloatArray:
    """(N,) of what rows (N, K) tell of unknowns with a covariance (P, P)."""
    found = np.zeros(len(columns))
    for n in range(len(columns)):
        for a in range(columns.shape[1]):
            for b in range(columns.shape[1]):
                found[n] += values[n, a] * covariance[columns[n, a], columns[n, b]] * values[n, b]
    return found


@compiled
def _inverse(matrix: FloatArray) -> FloatArray:
    """Of a positive definite matrix, by Gauss and Jordan.

    So small a matrix gains nothing from the threads of numpy's, which wait for one another busily: with other work on
    the cores they take a hundred times as long.
    """
    inverse, size = matrix.copy(), len(matrix)
    for k in range(size):
        pivot = 1 / inverse[k, k]
        inverse[k, k] = 1.0
        for j in range(size):
            inverse[k, j] *= pivot
        for i in range(size):
            if i != k:
                factor = inverse[i, k]
                inverse[i, k] = 0.0
                for j in range(size):
                    inverse[i, j] -= factor * inverse[k, j]
    return inverse
