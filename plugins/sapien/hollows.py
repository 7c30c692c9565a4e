"""The width of a body's opening at its top, from its solids."""

from __future__ import annotations

import numpy as np

from gvla2.geometry.transform import FloatArray, invert_rigid, transform_points
from gvla2.robot.scan import Scan
from gvla2.robot.task import Solid
from gvla2_plugins.sapien.convex import pieces

BELOW_TOP = 0.2
"""Where the walls are checked: this share of the height below the top."""

DIRECTIONS, STEPS = 24, 400


def opening(solids: tuple[Solid, ...], low: FloatArray, high: FloatArray) -> float:
    """The narrowest inner width of a body about its middle, near its top, metres; 0 if it is closed.

    ``low`` and ``high`` (3,) bound the body in its own frame. It is open when its middle is empty there and walls
    surround it.
    """
    middle = 0.5 * (low + high)
    height = high[2] - BELOW_TOP * (high[2] - low[2])
    turns = 2.0 * np.pi * np.arange(DIRECTIONS) / DIRECTIONS
    reach = 0.5 * float(np.hypot(*(high - low)[:2])) * np.arange(STEPS + 1) / STEPS
    xy = np.stack([np.cos(turns), np.sin(turns)], axis=1)[:, None] * reach[None, :, None]  # (D, S, 2)
    points = np.concatenate([middle[:2] + xy, np.full((*xy.shape[:2], 1), height)], axis=2)
    solid = _within(solids, points.reshape(-1, 3)).reshape(xy.shape[:2])
    if solid[:, 0].any() or not solid.any(axis=1).all():
        return 0.0
    free = reach[solid.argmax(axis=1)]
    half = DIRECTIONS // 2
    return float((free[:half] + free[half:]).min())


def _within(solids: tuple[Solid, ...], points: FloatArray) -> np.ndarray:
    """(N,) bool: points (N, 3) inside any of the solids."""
    inside = np.zeros(len(points), dtype=bool)
    for solid in solids:
        local = transform_points(invert_rigid(solid.body_from_shape), points)
        if isinstance(solid, Scan):
            inside |= np.any([piece.holds(local) for piece in pieces(solid)], axis=0)
            continue
        x, y, z = np.abs(local).T
        a, b, c = 0.5 * np.asarray(solid.size)
        if solid.kind == "box":
            inside |= (x <= a) & (y <= b) & (z <= c)
        elif solid.kind == "cylinder":
            inside |= (np.hypot(x, y) <= a) & (z <= c)
        else:
            inside |= x**2 + y**2 + z**2 <= a**2
    return inside
