"""Solids by their signed distance, and their fit to surface points and to points known to be free.

A point that a camera saw lies on the surface: its distance should be 0. A point that a camera looked through lies
outside: its distance should not be negative. The first places the faces, the second the silhouette, which is known
to a fraction of a pixel where several views see it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from gvla2.geometry.transform import FloatArray

Distance = Callable[[FloatArray, FloatArray], FloatArray]
"""Signed distances (B, N), metres, negative inside, of points (N, 3) to solids with parameters (B, P)."""

HUBER = 0.003
LARGE = 0.012  # a point this far off belongs to something else: its pull grows no more


def _join(*planes: FloatArray) -> FloatArray:
    """Distance to the intersection of slabs, given the signed distances (B, N) to each."""
    stack = np.stack(planes)
    return np.sqrt((np.maximum(stack, 0.0) ** 2).sum(axis=0)) + np.minimum(stack.max(axis=0), 0.0)


def _columns(parameters: FloatArray) -> list[FloatArray]:
    return [column[:, None] for column in parameters.T]


def box_distance(parameters: FloatArray, points: FloatArray) -> FloatArray:
    """Upright box: centre x, y, yaw, width (its x), depth (its y), top, bottom."""
    cx, cy, yaw, width, depth, top, bottom = _columns(parameters)
    x, y, z = points.T
    dx, dy, c, s = x - cx, y - cy, np.cos(yaw), np.sin(yaw)
    side = np.abs(c * dx + s * dy) - 0.5 * width
    front = np.abs(c * dy - s * dx) - 0.5 * depth
    return _join(side, front, np.abs(z - 0.5 * (top + bottom)) - 0.5 * (top - bottom))


def cylinder_distance(parameters: FloatArray, points: FloatArray) -> FloatArray:
    """Upright cylinder: centre x, y, diameter, top, bottom."""
    cx, cy, diameter, top, bottom = _columns(parameters)
    x, y, z = points.T
    radial = np.hypot(x - cx, y - cy) - 0.5 * diameter
    return _join(radial, np.abs(z - 0.5 * (top + bottom)) - 0.5 * (top - bottom))


def sphere_distance(parameters: FloatArray, points: FloatArray) -> FloatArray:
    """Sphere: centre x, y, z, diameter."""
    cx, cy, cz, diameter = _columns(parameters)
    x, y, z = points.T
    return np.asarray(np.sqrt((x - cx) ** 2 + (y - cy) ** 2 + (z - cz) ** 2) - 0.5 * diameter)


def rectangle_distance(parameters: FloatArray, points: FloatArray) -> FloatArray:
    """Flat rectangle, z ignored: centre x, y, yaw, width, depth."""
    cx, cy, yaw, width, depth = _columns(parameters)
    dx, dy, c, s = points[:, 0] - cx, points[:, 1] - cy, np.cos(yaw), np.sin(yaw)
    return _join(np.abs(c * dx + s * dy) - 0.5 * width, np.abs(c * dy - s * dx) - 0.5 * depth)


def circle_distance(parameters: FloatArray, points: FloatArray) -> FloatArray:
    """Flat disc, z ignored: centre x, y, diameter."""
    cx, cy, diameter = _columns(parameters)
    return np.asarray(np.hypot(points[:, 0] - cx, points[:, 1] - cy) - 0.5 * diameter)


@dataclass(frozen=True)
class Fit:
    """A fitted solid: ``parameters`` (P,); ``cost`` mean robust squared error, m^2; ``agreement`` in [0, 1], the
    share of surface points on the surface less ``intrusion``, the share of free points well inside.
    """

    parameters: FloatArray
    cost: float
    agreement: float
    intrusion: float


def fit_solid(
    distance: Distance,
    start: Sequence[float] | FloatArray,
    surface: FloatArray,
    free: FloatArray,
    rays: FloatArray | None = None,
    *,
    hold: Sequence[int] = (),
    limits: tuple[Sequence[float], Sequence[float]] | None = None,
    filled: bool = False,
    slack: float = 0.0,
    tolerance: float = 0.005,
    steps: int = 14,
) -> Fit:
    """Damped Gauss-Newton from ``start`` (P,) with a robust loss.

    ``surface`` (N, 3) seen points, ``free`` (M, 3) points known to be outside; ``rays`` (R, S, 3) points along rays
    that hit the solid, which must reach into it somewhere, however wrong their depth is; ``hold`` indices of
    parameters that stay, ``limits`` their least and greatest values. With ``filled`` the seen points may also lie
    inside, as those of a painted patch do, or ``slack`` metres outside, where their depth is noisy.
    """
    parameters = np.asarray(start, dtype=np.float64).copy()
    moving = [i for i in range(len(parameters)) if i not in hold]
    rays = np.zeros((0, 1, 3)) if rays is None else rays
    counts = (len(surface), len(free), len(rays))
    share = np.repeat([1.0 / max(1, count) for count in counts], counts)
    points = np.concatenate([surface, free, rays.reshape(-1, 3)])
    first_free, first_ray = counts[0], counts[0] + counts[1]

    def errors(candidates: FloatArray) -> FloatArray:
        value = distance(candidates, points)
        seen, outside = value[:, :first_free], value[:, first_free:first_ray]
        reached = value[:, first_ray:].reshape(len(candidates), -1, rays.shape[1]).min(axis=2)
        seen = np.maximum(seen - slack, 0.0) if filled else seen
        return np.concatenate([seen, np.minimum(outside, 0.0), np.maximum(reached, 0.0)], axis=1)

    step_size = 1e-5
    damping = 1e-3
    error = errors(parameters[None])[0]
    cost = float(share @ _loss(error))
    for _ in range(steps):
        probes = np.tile(parameters, (len(moving), 1))
        probes[np.arange(len(moving)), moving] += step_size
        jacobian = (errors(probes) - error).T / step_size  # (N + M, P')
        weighted = jacobian * (share * _weight(error))[:, None]
        normal, slope = weighted.T @ jacobian, weighted.T @ error
        diagonal = np.diag(normal) + 1e-6 * max(1e-12, float(np.trace(normal)))
        improved = False
        for _ in range(4):
            move = -np.linalg.solve(normal + np.diag(damping * diagonal + 1e-12), slope)
            move = np.clip(move, -0.1, 0.1)
            trial = parameters.copy()
            trial[moving] += move
            trial = trial if limits is None else np.clip(trial, *limits)
            trial_error = errors(trial[None])[0]
            trial_cost = float(share @ _loss(trial_error))
            if trial_cost < cost:
                improved = True
                break
            damping *= 8.0
        if not improved:
            break
        gain = cost - trial_cost
        parameters, error, cost, damping = trial, trial_error, trial_cost, max(1e-6, damping / 4.0)
        if gain < 1e-3 * cost + 1e-13:
            break
    on = np.abs(error[:first_free]) < tolerance
    inside = error[first_free:first_ray] < -tolerance
    intrusion = float(inside.mean()) if len(free) else 0.0
    agreement = max(0.0, float(on.mean()) - intrusion) if len(surface) else 0.0
    return Fit(parameters, cost, agreement, intrusion)


def _weight(error: FloatArray) -> FloatArray:
    """Weights of iteratively reweighted least squares: Huber's, and less beyond LARGE."""
    size = np.maximum(np.abs(error), 1e-12)
    return np.minimum(1.0, HUBER / size) * np.minimum(1.0, (LARGE / size) ** 2)


def _loss(error: FloatArray) -> FloatArray:
    size = np.abs(error)
    huber = np.where(size < HUBER, 0.5 * size**2, HUBER * (size - 0.5 * HUBER))
    ceiling = HUBER * (LARGE - 0.5 * HUBER)
    return np.where(
        size < LARGE, huber, ceiling + HUBER * LARGE * 0.5 * (1.0 - (LARGE / np.maximum(size, LARGE)) ** 2)
    )


def evenly(points: FloatArray, most: int) -> FloatArray:
    """At most about ``most`` rows, taken at even steps: the same ones every time."""
    return points[:: max(1, -(-len(points) // most))]


def spread_out(points: FloatArray, most: int, spacing: float = 0.003) -> FloatArray:
    """At most about ``most`` rows, one a cube of side ``spacing`` metres: near cameras do not outvote far ones."""
    cells = np.floor(points / spacing).astype(np.int64)
    cells -= cells.min(axis=0)
    size = cells.max(axis=0) + 1
    _, first = np.unique((cells[:, 0] * size[1] + cells[:, 1]) * size[2] + cells[:, 2], return_index=True)
    return evenly(points[np.sort(first)], most)


def narrow_yaw(xy: FloatArray, trim: float = 1.0) -> tuple[float, FloatArray, FloatArray]:
    """Yaw in [0, pi/2), centre (2,) and lengths (2,) of the smallest rectangle about points (N, 2).

    ``trim`` per cent of the points are left out at each end, so that stray points do not count.
    """
    yaws = np.radians(np.arange(0.0, 90.0, 3.0))
    axes = np.stack([np.cos(yaws), np.sin(yaws), -np.sin(yaws), np.cos(yaws)], axis=1).reshape(-1, 2, 2)
    along = np.einsum("yij,nj->yin", axes, xy)  # (Y, 2, N)
    low, high = np.percentile(along, [trim, 100.0 - trim], axis=2)
    best = int(np.argmin((high - low).prod(axis=1)))
    middle = 0.5 * (low[best] + high[best]) @ axes[best]
    return float(yaws[best]), middle, high[best] - low[best]
