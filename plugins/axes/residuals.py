"""Distances of a shape's outline from a mask's contour, in pixels along the contour's normals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gvla2.geometry.camera import Camera
from gvla2.geometry.transform import FloatArray
from gvla2.reconstruction.compiled import compiled
from gvla2.reconstruction.outline import Field, Outline
from gvla2.reconstruction.support import projection
from gvla2_plugins.axes.contour import Contour

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
