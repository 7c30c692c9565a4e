"""Distances of a shape's outline from a mask's contour, in pixels along the contour's normals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter, map_coordinates

from gvla2.geometry.camera import Camera
from gvla2.geometry.transform import FloatArray
from gvla2.reconstruction.silhouette import Field, Outline
from gvla2.reconstruction.support import projection

LEVEL = 0.5
_SMOOTHING = 2.0  # pixels; a binary mask's own gradient has only eight directions


@dataclass(frozen=True)
class Contour:
    """Points where a mask crosses 0.5.

    ``uv`` (M, 2) pixels; ``normal`` (M, 2) unit, out of the mask; ``length`` (M,) pixels of contour that each
    point stands for.
    """

    uv: FloatArray
    normal: FloatArray
    length: FloatArray


def mask_contour(mask: NDArray[np.float32], count: int) -> Contour:
    """The contour of a mask (H, W) in [0, 1]: every crossing between two neighbouring pixels' centres.

    Where the mask meets the image's border the object's outline is unknown, so no point lies there. About ``count``
    points are kept, evenly spread. M = 0 for an empty or a full mask.
    """
    values = np.asarray(mask, dtype=np.float64)
    inside = values > LEVEL
    found: list[FloatArray] = []
    for a, b in ((np.s_[:, :-1], np.s_[:, 1:]), (np.s_[:-1], np.s_[1:])):
        rows, columns = np.nonzero(inside[a] != inside[b])
        before, after = values[a][rows, columns], values[b][rows, columns]
        step = [1.0, 0.0] if a == np.s_[:, :-1] else [0.0, 1.0]
        share = (LEVEL - before) / (after - before)
        found.append(np.stack([columns, rows], axis=1) + 0.5 + share[:, None] * step)
    uv = np.concatenate(found)
    if len(uv) == 0:
        return Contour(uv, uv.copy(), np.zeros(0))
    smooth = gaussian_filter(values, _SMOOTHING, mode="nearest")
    at = uv[:, ::-1].T - 0.5
    down, across = (
        map_coordinates(np.gradient(smooth, axis=axis), at, order=1, mode="nearest") for axis in (0, 1)
    )
    normal = -np.stack([across, down], axis=1)
    size = np.linalg.norm(normal, axis=1)
    kept = size > 1e-6  # a speck that vanishes after smoothing has no direction
    uv, normal = uv[kept], normal[kept] / size[kept, None]
    # A slanted contour is crossed by rows and columns both.
    length = 1.0 / np.abs(normal).sum(axis=1)
    if len(uv) > count:
        chosen = _even(uv, length, count)
        length = np.full(len(chosen), length.sum() / len(chosen))
        uv, normal = uv[chosen], normal[chosen]
    return Contour(uv, normal, length)


def _even(uv: FloatArray, length: FloatArray, count: int) -> NDArray[np.int64]:
    """Indices of ``count`` points, evenly spread along the contour as it winds about its middle."""
    middle = uv.mean(axis=0)
    order = np.argsort(np.arctan2(uv[:, 1] - middle[1], uv[:, 0] - middle[0]), kind="stable")
    reached = np.cumsum(length[order])
    marks = (np.arange(count) + 0.5) * (reached[-1] / count)
    return np.asarray(order[np.unique(np.searchsorted(reached, marks))])


_STEP = 0.5  # pixels between two samples along a normal


@dataclass(frozen=True)
class Residuals:
    """M contour points that found the outline.

    ``pixels`` (M,) from contour to outline, positive when the shape reaches too far out; ``index`` (M,) the point that
    forms the outline there; ``gradient`` (M, 3) change of ``pixels`` per metre of that point in the world; ``weight``
    (M,).
    """

    pixels: FloatArray
    index: NDArray[np.int64]
    gradient: FloatArray
    weight: FloatArray

    @classmethod
    def joined(cls, parts: Sequence[Residuals]) -> Residuals:
        """The residuals of several views as one; every view counts the same."""
        return cls(
            np.concatenate([p.pixels for p in parts]),
            np.concatenate([p.index for p in parts]),
            np.concatenate([p.gradient for p in parts]),
            np.concatenate([p.weight / max(p.weight.sum(), 1e-12) for p in parts]),
        )


def outline_residuals(
    drawn: Outline, contour: Contour, points: FloatArray, camera: Camera, reach: float
) -> Residuals:
    """Follow each normal both ways, up to ``reach`` pixels, to the nearest edge of the outline of the points (N, 3).

    An edge counts only if the shape is on its inner side, as at the contour; contour points without such an edge within
    reach (a part is missing, or another one begins) are left out.
    """
    pixels = _crossings(drawn.inside, contour, reach)
    # The point that forms the edge is drawn at it or just inside.
    inward = pixels[:, None] - 0.5 * np.arange(4)
    spot = contour.uv[:, None] + inward[..., None] * contour.normal[:, None]  # (M, 4, 2)
    within = camera.inside(spot)
    column, row = np.where(within[..., None], spot, 0).astype(np.int64).transpose(2, 0, 1)
    drawn_there = np.where(within, drawn.nearest[row, column], -1)
    index = drawn_there[np.arange(len(pixels)), (drawn_there >= 0).argmax(axis=1)].astype(np.int64)
    found = np.isfinite(pixels) & (index >= 0)
    index, normal = index[found], contour.normal[found]
    P = projection(camera)
    image = points[index] @ P[:, :3].T + P[:, 3]
    u, v, depth = image[:, 0] / image[:, 2], image[:, 1] / image[:, 2], image[:, 2:]
    gradient = (
        normal[:, :1] * (P[0, :3] - u[:, None] * P[2, :3])
        + normal[:, 1:] * (P[1, :3] - v[:, None] * P[2, :3])
    ) / depth
    return Residuals(pixels[found], index, gradient, contour.length[found])


def _crossings(inside: Field, contour: Contour, reach: float) -> FloatArray:
    """(M,) pixels along each normal to the nearest place where the outline ends outwards, NaN where there is none."""
    t = _STEP * np.arange(int(reach / _STEP) + 1)

    def along(sign: float) -> FloatArray:
        at = contour.uv[:, None] + sign * t[:, None] * contour.normal[:, None] - 0.5  # (M, T, 2)
        where = at[..., ::-1].transpose(2, 0, 1)
        return np.asarray(map_coordinates(inside, where, output=np.float64, order=1, cval=np.nan))

    def first(crossed: NDArray[np.bool_]) -> NDArray[np.intp]:
        return np.where(crossed.any(axis=1), crossed.argmax(axis=1), len(t))

    out, back = along(1.0), along(-1.0)
    leaves = first((out[:, :-1] >= 0) & (out[:, 1:] < 0))
    enters = first((back[:, :-1] < 0) & (back[:, 1:] >= 0))
    n, rows = np.minimum(np.minimum(leaves, enters), len(t) - 2), np.arange(len(out))
    with np.errstate(invalid="ignore", divide="ignore"):
        outwards = t[n] + _STEP * out[rows, n] / (out[rows, n] - out[rows, n + 1])
        inwards = -t[n + 1] + _STEP * back[rows, n + 1] / (back[rows, n + 1] - back[rows, n])
    crossing = np.where(leaves <= enters, outwards, inwards)
    return np.where(np.minimum(leaves, enters) < len(t), crossing, np.nan)
