"""The soft visual hull: points with little mask support move a little inwards; none is deleted."""

from __future__ import annotations

from functools import partial

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gvla2.errors import GeometryError
from gvla2.geometry.transform import FloatArray
from gvla2.reconstruction.compiled import compiled, run_chunks
from gvla2.reconstruction.support import as_points

TAU, ETA, LAMBDA_MAX = 0.45, 0.12, 0.008
"""The released constants: support threshold, softness, greatest shrink ratio."""


def object_centre(points: ArrayLike) -> FloatArray:
    """(3,) centre of the bounding box of points (N, 3): the paper's object centre c.

    The box's, not the mean: Gaussians and mesh vertices of one object are spread differently over it, yet must
    move alike. Take it once an object, from either, and pass it on to both.
    Raises :class:`GeometryError` for no points, and for any that is not finite.
    """
    array = _finite(points)
    if len(array) == 0:
        raise GeometryError("No points: the object has no centre.")
    columns = np.ascontiguousarray(array.T)  # whose ends are found ten times as fast
    return np.asarray(0.5 * (columns.min(axis=1) + columns.max(axis=1)))


def released_centre(points: ArrayLike) -> FloatArray:
    """(3,) mean of points (N, 3), in single precision: the centre of the released code, another one for each file."""
    return np.asarray(_finite(points).astype(np.float32).mean(axis=0), dtype=np.float64)


def _finite(points: ArrayLike) -> FloatArray:
    array = as_points(points)
    if not np.isfinite(array).all():
        lost = int((~np.isfinite(array)).any(axis=1).sum())
        raise GeometryError(f"{lost} of {len(array)} points are not finite: drop them first.")
    return array


def soft_hull(
    points: ArrayLike,
    support: ArrayLike,
    centre: ArrayLike | None = None,
    tau: float = TAU,
    eta: float = ETA,
    lambda_max: float = LAMBDA_MAX,
) -> FloatArray:
    """P' = c + (p - c) (1 - lambda(p)) (N, 3) of world points (N, 3) with support s (N,).

    lambda(p) = lambda_max * sigmoid((tau - s(p)) / eta)^2, in [0, lambda_max] (paper, shrink strength).
    ``centre`` (3,) is :func:`object_centre` of these points by default; give one centre for Gaussians and mesh
    alike. Raises :class:`GeometryError` for points that are not finite, shapes that do not match, support outside
    [0, 1], eta <= 0 and lambda_max outside [0, 1].
    """
    array = as_points(points)
    s = np.ascontiguousarray(support, dtype=np.float64)
    if not (eta > 0 and 0 <= lambda_max <= 1 and np.isfinite(tau)):
        raise GeometryError(
            f"Soft hull: eta must be > 0, lambda_max in [0, 1] and tau finite; "
            f"got eta={eta}, lambda_max={lambda_max}, tau={tau}."
        )
    if s.shape != (len(array),):
        raise GeometryError(f"Soft hull: {len(array)} points but support of shape {s.shape}.")
    if len(array) == 0:
        return array
    c = object_centre(array) if centre is None else np.asarray(centre, dtype=np.float64)
    if c.shape != (3,) or not np.isfinite(c).all():
        raise GeometryError(f"Soft hull: the centre must be three finite numbers, got {c}.")
    moved, wrong = np.empty_like(array), np.zeros(2, dtype=np.int64)
    run_chunks(partial(_shrink, array, s, c, tau, eta, lambda_max, moved, wrong), len(array))
    if wrong[0]:
        raise GeometryError(f"Soft hull: points must be finite; at least {wrong[0]} of {len(array)} are not.")
    if wrong[1]:
        raise GeometryError("Soft hull: support must lie in [0, 1].")
    return moved


@compiled
def _shrink(
    points: FloatArray,
    support: FloatArray,
    c: FloatArray,
    tau: float,
    eta: float,
    lambda_max: float,
    moved: FloatArray,
    wrong: NDArray[np.int64],
    start: int,
    stop: int,
) -> None:
    for n in range(start, stop):
        s, x, y, z = support[n], points[n, 0], points[n, 1], points[n, 2]
        wrong[0] += not np.isfinite(x + y + z)
        wrong[1] += not (s >= 0.0 and s <= 1.0)
        # A huge exponent would only make the sigmoid 0, as it should be.
        sigmoid = 1.0 / (1.0 + np.exp(min((s - tau) / eta, 700.0)))
        strength = lambda_max * sigmoid * sigmoid
        moved[n, 0] = x - (x - c[0]) * strength
        moved[n, 1] = y - (y - c[1]) * strength
        moved[n, 2] = z - (z - c[2]) * strength
