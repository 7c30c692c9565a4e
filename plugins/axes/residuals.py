"""Distances of a shape's outline from a mask's contour, in pixels along the contour's normals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from gvla2.geometry.camera import Camera
from gvla2.geometry.transform import FloatArray
from gvla2.reconstruction.compiled import compiled
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


def mask_contour(mask: NDArray[np.float32], count: int | None = None) -> Contour:
    """The contour of a mask (H, W) in [0, 1]: every crossing between two neighbouring pixels' centres.

    Where the mask meets the image's border the object's outline is unknown, so no point lies there. About ``count``
    points are kept, evenly spread. M = 0 for an empty or a full mask.
    """
    values = np.asarray(mask, dtype=np.float64)
    inside = values > LEVEL
    found: list[FloatArray] = []
    for axis, step in ((1, np.array([1.0, 0.0])), (0, np.array([0.0, 1.0]))):
        a = values[:, :-1] if axis == 1 else values[:-1]
        b = values[:, 1:] if axis == 1 else values[1:]
        crossing = (inside[:, :-1] != inside[:, 1:]) if axis == 1 else (inside[:-1] != inside[1:])
        rows, columns = np.nonzero(crossing)
        share = (LEVEL - a[crossing]) / (b[crossing] - a[crossing])
        found.append(np.stack([columns, rows], axis=1) + 0.5 + share[:, None] * step)
    uv = np.concatenate(found)
    if len(uv) == 0:
        return Contour(uv, uv.copy(), np.zeros(0))
    smooth = gaussian_filter(values, _SMOOTHING, mode="nearest")
    down, across = (np.asarray(slope, dtype=np.float64) for slope in np.gradient(smooth))
    normal = -np.stack([_sample(across, uv), _sample(down, uv)], axis=1)
    size = np.linalg.norm(normal, axis=1)
    kept = size > 1e-6  # a speck that vanishes after smoothing has no direction
    uv, normal = uv[kept], normal[kept] / size[kept, None]
    # A slanted contour is crossed by rows and columns both.
    length = 1.0 / np.abs(normal).sum(axis=1)
    if count is not None and len(uv) > count:
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


def _sample(image: FloatArray, uv: FloatArray) -> FloatArray:
    """Bilinear samples (M,) of an image at pixels (M, 2) between the outermost pixels' centres."""
    x, y = uv[:, 0] - 0.5, uv[:, 1] - 0.5
    j = np.clip(x.astype(np.int64), 0, image.shape[1] - 2)
    i = np.clip(y.astype(np.int64), 0, image.shape[0] - 2)
    s, t = x - j, y - i
    above = image[i, j] * (1 - s) + image[i, j + 1] * s
    below = image[i + 1, j] * (1 - s) + image[i + 1, j + 1] * s
    return np.asarray(above * (1 - t) + below * t)


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
        if not parts:
            return cls(np.zeros(0), np.zeros(0, dtype=np.int64), np.zeros((0, 3)), np.zeros(0))
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
    pixels = np.full(len(contour.uv), np.nan)
    index = np.full(len(contour.uv), -1, dtype=np.int64)
    _follow(drawn.inside, drawn.nearest, contour.uv, contour.normal, reach, pixels, index)
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


@compiled
def _value(image: Field, u: float, v: float) -> float:
    """Bilinear sample; NaN outside the pixels' centres."""
    height, width = image.shape
    x, y = u - 0.5, v - 0.5
    if not (x >= 0 and y >= 0 and x < width - 1 and y < height - 1):
        return np.nan
    j, i = int(x), int(y)
    s, t = x - j, y - i
    above = image[i, j] * (1 - s) + image[i, j + 1] * s
    below = image[i + 1, j] * (1 - s) + image[i + 1, j + 1] * s
    return float(above * (1 - t) + below * t)


@compiled
def _follow(
    inside: Field,
    nearest: NDArray[np.int32],
    uv: FloatArray,
    normal: FloatArray,
    reach: float,
    pixels: FloatArray,
    index: NDArray[np.int64],
) -> None:
    height, width = inside.shape
    steps = int(reach / _STEP)
    for k in range(len(uv)):
        here = _value(inside, uv[k, 0], uv[k, 1])
        out, back = here, here  # the latest values in both directions
        at = np.nan
        for n in range(1, steps + 1):
            t = n * _STEP
            value = _value(inside, uv[k, 0] + t * normal[k, 0], uv[k, 1] + t * normal[k, 1])
            if out >= 0 and value < 0:
                at = t - _STEP + _STEP * out / (out - value)
                break
            out = value
            value = _value(inside, uv[k, 0] - t * normal[k, 0], uv[k, 1] - t * normal[k, 1])
            if back < 0 and value >= 0:
                at = -t + _STEP * value / (value - back)
                break
            back = value
        if not np.isfinite(at):
            continue
        # The point that forms the edge lies at it or just inside.
        for inward in range(4):
            u = uv[k, 0] + (at - 0.5 * inward) * normal[k, 0]
            v = uv[k, 1] + (at - 0.5 * inward) * normal[k, 1]
            i, j = int(v), int(u)
            if u >= 0 and v >= 0 and i < height and j < width and nearest[i, j] >= 0:
                index[k] = nearest[i, j]
                pixels[k] = at
                break
