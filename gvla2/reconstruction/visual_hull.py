"""The soft visual hull: points with little mask support move a little inwards; none is deleted."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from gvla2.errors import GeometryError
from gvla2.geometry.transform import FloatArray
from gvla2.reconstruction.support import as_points

TAU, ETA, LAMBDA_MAX = 0.45, 0.12, 0.008
"""The released constants: support threshold, softness, greatest shrink ratio."""


def shrink_strength(
    support: ArrayLike, tau: float = TAU, eta: float = ETA, lambda_max: float = LAMBDA_MAX
) -> FloatArray:
    """lambda(p) = lambda_max * sigmoid((tau - s(p)) / eta)^2, (N,) in [0, lambda_max] (paper, shrink strength).

    Raises :class:`GeometryError` for support outside [0, 1], eta <= 0 or lambda_max outside [0, 1].
    """
    s = np.asarray(support, dtype=np.float64)
    if not (eta > 0 and 0 <= lambda_max <= 1 and np.isfinite(tau)):
        raise GeometryError(
            f"Soft hull: eta must be > 0, lambda_max in [0, 1] and tau finite; "
            f"got eta={eta}, lambda_max={lambda_max}, tau={tau}."
        )
    if s.size and not (s.min() >= 0 and s.max() <= 1):
        raise GeometryError(f"Soft hull: support must lie in [0, 1], got {s.min():g} to {s.max():g}.")
    # With the tanh, no exponential overflows for a small eta.
    sigmoid = 0.5 + 0.5 * np.tanh(0.5 * (tau - s) / eta)
    return np.asarray(lambda_max * sigmoid * sigmoid)


def object_centre(points: ArrayLike) -> FloatArray:
    """(3,) centre of the bounding box of the finite points (N, 3): the paper's object centre c.

    The box's, not the mean: Gaussians and mesh vertices of one object are spread differently over it, yet must
    move alike. Take it once an object, from either, and pass it on to both.
    Raises :class:`GeometryError` when no point is finite.
    """
    array = as_points(points)
    finite = array[np.isfinite(array).all(axis=1)]
    if len(finite) == 0:
        raise GeometryError(f"None of {len(array)} points is finite: the object has no centre.")
    return np.asarray(0.5 * (finite.min(axis=0) + finite.max(axis=0)))


def soft_hull(
    points: ArrayLike,
    support: ArrayLike,
    centre: ArrayLike | None = None,
    tau: float = TAU,
    eta: float = ETA,
    lambda_max: float = LAMBDA_MAX,
) -> FloatArray:
    """P' = c + (p - c) (1 - lambda(p)) (N, 3) of world points (N, 3) with support (N,).

    ``centre`` (3,) is :func:`object_centre` of these points by default; give one centre for Gaussians and mesh
    alike. Raises :class:`GeometryError` for shapes that do not match and as in :func:`shrink_strength`.
    """
    array = as_points(points)
    strength = shrink_strength(support, tau, eta, lambda_max)
    if strength.shape != (len(array),):
        raise GeometryError(f"Soft hull: {len(array)} points but support of shape {strength.shape}.")
    if len(array) == 0:
        return array
    c = object_centre(array) if centre is None else np.asarray(centre, dtype=np.float64)
    if c.shape != (3,) or not np.isfinite(c).all():
        raise GeometryError(f"Soft hull: the centre must be three finite numbers, got {c}.")
    return np.asarray(array - (array - c) * strength[:, None])
