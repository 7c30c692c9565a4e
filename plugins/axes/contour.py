"""The contours of masks: points on the outline with their normals, to a fraction of a pixel."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from gvla2.geometry.transform import FloatArray

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
