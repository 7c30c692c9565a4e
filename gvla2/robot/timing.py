"""Time along a path: fast, within joint and tool limits, at rest at both ends."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from gvla2.errors import RobotError
from gvla2.geometry.transform import FloatArray

_GRID = 0.01  # radians of joint path between grid points, at most
_MAX_GRID = 4000


@dataclass(frozen=True)
class MotionLimits:
    """``velocity`` (dof,) in rad/s, ``acceleration`` (dof,) in rad/s², ``tool_speed`` in m/s.

    ``blend`` (seconds) is the window that rounds corners and spreads changes of acceleration.
    """

    velocity: FloatArray
    acceleration: FloatArray
    tool_speed: float
    blend: float = 0.08


def time_path(
    path: FloatArray,
    dt: float,
    limits: MotionLimits,
    tool_positions: Callable[[FloatArray], FloatArray] | None = None,
) -> FloatArray:
    """Samples (T, dof) of the polyline ``path`` (N, dof), one every ``dt`` seconds, first and last exact and at rest.

    Speed along the path is the largest that the limits allow: a forward and a backward pass over squared speed (Bobrow
    1985), with the corners of the polyline slowed down and rounded by a moving average of ``blend`` seconds; the
    average never exceeds the limits of its samples, and any excess from rounding corners is measured and slowed down.
    ``tool_positions`` maps joints (M, dof) to metres (M, 3), for the tool's speed. Raises :class:`RobotError` for a
    path, step or limit that is not finite and positive.
    """
    path = np.asarray(path, dtype=np.float64)
    if path.ndim != 2 or not len(path) or not np.isfinite(path).all():
        raise RobotError("A path must be a finite (N, dof) array with at least one point.")
    bounds = np.concatenate([[dt, limits.tool_speed, limits.blend], limits.velocity, limits.acceleration])
    if not (np.isfinite(bounds).all() and (bounds > 0).all()):
        raise RobotError("Time step, speeds and accelerations must be finite and above zero.")
    grid, where = _grid(path)
    if len(grid) < 2:
        return path[:1].copy()
    tool = None if tool_positions is None else tool_positions(grid)
    slow = 1.0
    for _ in range(12):
        samples = _sample(grid, where, tool, limits, dt, slow)
        excess = _excess(samples, dt, limits)
        if excess <= 1.0:
            break
        slow *= max(excess, 1.02)
    samples[0], samples[-1] = path[0], path[-1]
    return samples


def _grid(path: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Points (M, dof) along the polyline, its vertices among them, and their arc length (M,) in joint space."""
    lengths = np.linalg.norm(np.diff(path, axis=0), axis=1)
    keep = np.concatenate([[True], lengths > 1e-9])
    path, lengths = path[keep], lengths[lengths > 1e-9]
    ends = np.concatenate([[0.0], np.cumsum(lengths)])
    count = min(_MAX_GRID, int(np.ceil(ends[-1] / _GRID)) + 16)
    where = np.unique(np.concatenate([np.linspace(0.0, ends[-1], count), ends]))
    where = where[np.concatenate([[True], np.diff(where) > 1e-7])] if len(where) > 1 else where
    grid = np.stack([np.interp(where, ends, column) for column in path.T], axis=1)
    return grid, where


def _sample(
    grid: FloatArray, where: FloatArray, tool: FloatArray | None, limits: MotionLimits, dt: float, slow: float
) -> FloatArray:
    """Samples with limits divided by ``slow`` (speed) and its square (acceleration)."""
    ds = np.diff(where)  # (M-1,)
    slope = np.diff(grid, axis=0) / ds[:, None]  # (M-1, dof) joint radians a radian of path
    steep = np.maximum(np.abs(slope), 1e-9)
    speed = (limits.velocity / slow / steep).min(axis=1)
    if tool is not None:
        travel = np.linalg.norm(np.diff(tool, axis=0), axis=1) / ds
        speed = np.minimum(speed, limits.tool_speed / slow / np.maximum(travel, 1e-9))
    gain = (limits.acceleration / slow**2 / steep).min(axis=1)  # (M-1,) path acceleration

    # At a grid point the speed is the slower neighbour's; a change of direction costs a jump of joint speed,
    # which the moving average spreads over its window.
    turn = np.abs(np.diff(slope, axis=0))  # (M-2, dof)
    corner = (0.5 * limits.acceleration / slow**2 * limits.blend / np.maximum(turn, 1e-9)).min(axis=1)
    cap = np.zeros(len(where))
    cap[1:-1] = np.minimum(np.minimum(speed[:-1], speed[1:]), corner) ** 2
    rise = np.concatenate([[0.0], np.cumsum(2.0 * gain * ds)])
    square = rise + np.minimum.accumulate(cap - rise)
    back = rise[-1] - rise
    square = (back + np.minimum.accumulate((np.minimum(cap, square) - back)[::-1])[::-1]).clip(0.0)
    velocity = np.sqrt(square)

    # Constant acceleration between grid points: the mean of both speeds gives the time.
    times = np.concatenate([[0.0], np.cumsum(2.0 * ds / np.maximum(velocity[1:] + velocity[:-1], 1e-9))])
    half = max(1, round(0.5 * limits.blend / dt))
    count = int(np.ceil(times[-1] / dt)) + 1
    ticks = dt * np.arange(-2 * half, count + 2 * half, dtype=np.float64)
    along = _along(ticks, times, where, velocity)
    raw = np.stack([np.interp(along, where, column) for column in grid.T], axis=1)
    window = 2 * half + 1
    sums = np.cumsum(np.concatenate([np.zeros((1, raw.shape[1])), raw - raw[0]]), axis=0)
    return np.asarray((sums[window:] - sums[:-window]) / window + raw[0])


def _along(ticks: FloatArray, times: FloatArray, where: FloatArray, velocity: FloatArray) -> FloatArray:
    """Arc length at each tick: quadratic in time between grid points."""
    ticks = np.clip(ticks, 0.0, times[-1])
    k = np.clip(np.searchsorted(times, ticks, side="right") - 1, 0, len(times) - 2)
    span = times[k + 1] - times[k]
    share = ticks - times[k]
    change = (velocity[k + 1] - velocity[k]) / np.maximum(span, 1e-12)
    return np.minimum(where[k] + velocity[k] * share + 0.5 * change * share**2, where[k + 1])


def _excess(samples: FloatArray, dt: float, limits: MotionLimits) -> float:
    """The factor by which time must be stretched to keep the samples within the joint limits."""
    rested = np.concatenate([samples[:1], samples, samples[-1:]])
    velocity = np.diff(rested, axis=0) / dt
    acceleration = np.diff(velocity, axis=0) / dt
    fast = float((np.abs(velocity) / limits.velocity).max())
    hard = float((np.abs(acceleration) / limits.acceleration).max())
    return max(fast, math.sqrt(hard)) - 1e-6
