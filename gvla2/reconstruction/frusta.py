"""Where an object can be at all: the intersection of its masks' frusta."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import linprog

from gvla2.errors import GeometryError
from gvla2.geometry.transform import FloatArray
from gvla2.reconstruction.mask_distance import Silhouette
from gvla2.reconstruction.support import projection

_MARGIN = 0.5  # pixels around a mask's box: a mask is known to half a pixel
_UNBOUNDED_DEPTH = 1.0  # metres, where nothing at all says how far the object is


@dataclass(frozen=True)
class Region:
    """``bounds`` (2, 3), metres, world; ``depths`` (S, 2) nearest and farthest depth in each view, metres.

    ``complete``: the views alone bound the object; otherwise the depths are a guess from the masks' sizes.
    """

    bounds: FloatArray
    depths: FloatArray
    complete: bool


def frusta_region(silhouettes: Sequence[Silhouette], depth: float | None = None) -> Region | None:
    """The box around the intersection of the masks' frusta, None when they do not meet.

    One view, or views side by side, leave the depth open: the object is then taken to be as deep as its masks are
    wide, beginning at ``depth`` (metres along the first camera's z) if that is given, else around the point nearest
    to all the masks' middle rays. Raises :class:`GeometryError` when every mask fills its whole image.
    """
    if all(s.cut.all() for s in silhouettes):
        raise GeometryError("Every mask fills its whole image: nothing bounds the object.")
    rows = [row for s in silhouettes for row in _sides(s)]
    free = np.tile([0.0, np.inf], (len(silhouettes), 1))
    bounds = None
    if len(silhouettes) > 1:
        status, bounds = _box(np.array(rows))
        if status == "empty":
            return None
        if bounds is not None and not _too_long(bounds, silhouettes):
            return Region(bounds, free, True)
    depths = _slabs(silhouettes, _middle(silhouettes, depth))
    for s, (near, far) in zip(silhouettes, depths, strict=True):
        row = projection(s.camera)[2]
        rows += [row - [0, 0, 0, near], -row + [0, 0, 0, far]]
    # A mask that is cut on a side ends there for want of anything better.
    rows += [row for s in silhouettes for row in _sides(s, cut=True)]
    status, bounds = _box(np.array(rows))
    return None if bounds is None else Region(bounds, depths, False)


def _sides(s: Silhouette, cut: bool = False) -> list[FloatArray]:
    """Half-spaces (4,) with row . (x, 1) >= 0 of the mask's frustum: its sides, and the front of the camera."""
    P = projection(s.camera)
    rows = [P[2]]
    for side, (axis, sign) in enumerate(((0, 1.0), (1, 1.0), (0, -1.0), (1, -1.0))):
        if cut or not s.cut[side]:
            rows.append(sign * (P[axis] - (s.box[side] - sign * _MARGIN) * P[2]))
    return rows


def _box(rows: FloatArray) -> tuple[str, FloatArray | None]:
    """('ok', (2, 3) box) of a polytope of half-spaces (H, 4), or ('empty' | 'open', None)."""
    rows = rows / np.linalg.norm(rows[:, :3], axis=1, keepdims=True)
    box: FloatArray = np.empty((2, 3))
    for axis in range(3):
        for end, sign in enumerate((1.0, -1.0)):
            cost = np.zeros(3)
            cost[axis] = sign
            answer = linprog(cost, A_ub=-rows[:, :3], b_ub=rows[:, 3], bounds=(None, None), method="highs")
            if answer.status != 0 or answer.x is None:
                return ("open" if answer.status == 3 else "empty"), None
            box[end, axis] = float(answer.x[axis])
    return "ok", box


def _reach(s: Silhouette, depth: float) -> float:
    """Half the diagonal of the mask's box at a depth, metres."""
    size = (s.box[2:] - s.box[:2]) / np.array([s.camera.K[0, 0], s.camera.K[1, 1]])
    return 0.5 * depth * float(np.hypot(*size))


def _too_long(bounds: FloatArray, silhouettes: Sequence[Silhouette]) -> bool:
    """Whether the frusta meet so flatly that their box is far longer than anything the masks show."""
    middle = bounds.mean(axis=0)
    depths = [float(s.camera.project(middle)[1]) for s in silhouettes]
    widest = max(2 * _reach(s, max(d, 1e-6)) for s, d in zip(silhouettes, depths, strict=True))
    return float(np.linalg.norm(bounds[1] - bounds[0])) > 8 * widest


def _middle(silhouettes: Sequence[Silhouette], depth: float | None) -> FloatArray:
    """(3,) the object's middle: nearest to the middle rays of all masks, or behind ``depth`` along the first one."""
    origins, directions = [], []
    for s in silhouettes:
        uv = 0.5 * (s.box[:2] + s.box[2:])
        ray = s.camera.world_from_camera[:3, :3] @ np.linalg.inv(s.camera.K) @ np.append(uv, 1.0)
        origins.append(s.camera.position)
        directions.append(ray)
    if depth is None and len(silhouettes) > 1:
        unit = np.array(directions) / np.linalg.norm(directions, axis=1, keepdims=True)
        across = np.eye(3) - unit[:, :, None] * unit[:, None, :]
        normal = across.sum(axis=0)
        if np.linalg.cond(normal) < 1e6:
            point = np.linalg.solve(normal, (across @ np.array(origins)[:, :, None]).sum(axis=0)[:, 0])
            if all(s.camera.project(point)[1] > 0 for s in silhouettes):
                return np.asarray(point, dtype=np.float64)
    if depth is None:
        # A scene is commonly built around its origin; where the camera looks away from it, a metre will do.
        facing = float(directions[0] @ (-origins[0])) / float(directions[0] @ directions[0])
        middle = facing if facing > 1e-3 else _UNBOUNDED_DEPTH
    else:
        # The slab below is centred, and half as thick as this share of its own depth.
        middle = depth / max(1.0 - _reach(silhouettes[0], 1.0) / np.sqrt(2), 0.2)
    return np.asarray(origins[0] + middle * directions[0], dtype=np.float64)


def _slabs(silhouettes: Sequence[Silhouette], middle: FloatArray) -> FloatArray:
    """(S, 2) nearest and farthest depth of the object in each view: as deep as the widest mask is wide."""
    depths = np.array([float(s.camera.project(middle)[1]) for s in silhouettes])
    half = max(_reach(s, d) for s, d in zip(silhouettes, depths, strict=True) if d > 0) / np.sqrt(2)
    return np.stack([np.maximum(depths - half, 0.05 * np.abs(depths)), np.abs(depths) + half], axis=1)
