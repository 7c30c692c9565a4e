"""How far, and where to, a view's depth pulls each point along the camera's rays."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gvla2.geometry.transform import FloatArray
from gvla2.reconstruction.compiled import compiled
from gvla2.reconstruction.support import NEAR


@compiled
def pull(
    points: FloatArray,
    P: FloatArray,
    position: FloatArray,
    depth: FloatArray,
    weight: FloatArray,
    front: NDArray[np.float64],
    tolerance: float,
    cauchy: float,
    behind: float,
    jump: float,
    totals: FloatArray,
) -> None:
    """Add one view's weighted corrections of points (N, 3) to ``totals`` (N, 4): weight x correction, weight.

    ``P`` (3, 4) is K T and ``position`` (3,) the camera's; ``depth`` and ``weight`` (H, W) are the prior's, ``front``
    (H, W) the z-buffer of the points; lengths in metres. A point before the prior's surface floats in space that the
    view looks through: it moves back, whether other points hide it or not. One behind it moves forward only if it is
    visible and at most ``behind`` away, else it belongs to a surface that the view does not see.
    """
    height, width = depth.shape
    for n in range(len(points)):
        x, y, z = points[n, 0], points[n, 1], points[n, 2]
        here = P[2, 0] * x + P[2, 1] * y + P[2, 2] * z + P[2, 3]
        if not here > NEAR:
            continue
        u = (P[0, 0] * x + P[0, 1] * y + P[0, 2] * z + P[0, 3]) / here
        v = (P[1, 0] * x + P[1, 1] * y + P[1, 2] * z + P[1, 3]) / here
        if not (u >= 0 and v >= 0 and u < width and v < height):
            continue
        row, column = int(v), int(u)
        trust = weight[row, column]
        if not trust > 0:
            continue
        # Bilinear in inverse depth, which is exact on planes, over the neighbours on the same surface.
        own = depth[row, column]
        top, left = int(np.floor(v - 0.5)), int(np.floor(u - 0.5))
        shares, inverse = 0.0, 0.0
        for i in range(max(top, 0), min(top + 2, height)):
            for j in range(max(left, 0), min(left + 2, width)):
                if weight[i, j] > 0 and abs(depth[i, j] - own) < jump:
                    share = (1.0 - abs(u - 0.5 - j)) * (1.0 - abs(v - 0.5 - i))
                    shares += share
                    inverse += share / depth[i, j]
        surface = shares / inverse if shares > 1e-6 else own
        residual = surface - here
        if residual <= 0 and (residual < -behind or here > front[row, column] + tolerance):
            continue
        w = trust / (1.0 + (residual / cauchy) ** 2)
        # Along the ray, a step of one in depth is (point - position) / depth.
        along = w * residual / here
        totals[n, 0] += along * (x - position[0])
        totals[n, 1] += along * (y - position[1])
        totals[n, 2] += along * (z - position[2])
        totals[n, 3] += w
