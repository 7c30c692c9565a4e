"""How far, and where to, the views' depth pulls each point along the cameras' rays."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gvla2.geometry.transform import FloatArray
from gvla2.geometry.views import Views
from gvla2.reconstruction.compiled import compiled, run_chunks, run_together
from gvla2.reconstruction.prior_depth import PriorDepth
from gvla2.reconstruction.support import NEAR, projection
from gvla2.reconstruction.visibility import depth_of_points


@dataclass(frozen=True)
class Pull:
    """A prior's pull on points; all lengths in metres.

    ``cauchy``: the residual at which a view's say is halved; ``behind``: points farther behind the prior's surface
    belong to another one; ``tolerance`` of the z-buffer, in which points are ``spacing`` wide.
    """

    views: Views
    prior: PriorDepth
    cauchy: float
    behind: float
    tolerance: float
    spacing: float

    def of(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The weighted mean correction (N, 3) of points (N, 3), metres, and its total weight (N,).

        Weight = confidence x mask x cosine x visible x Cauchy(residual). A point before the prior's surface floats in
        space that the view looks through: it moves back, whether other points hide it or not. One behind it
        moves forward only if it is visible and near, else it belongs to a surface that the view does not see.
        """
        cameras = [view.camera for view in self.views]
        front = np.empty_like(self.prior.depth)

        def draw(s: int) -> Callable[[], None]:
            def job() -> None:
                front[s] = depth_of_points(points, cameras[s], self.spacing)

            return job

        run_together([draw(s) for s in range(len(cameras))])
        P = np.stack([projection(camera) for camera in cameras])
        positions = np.stack([camera.position for camera in cameras])
        correction, weight = np.empty_like(points), np.empty(len(points))

        def body(first: int, last: int) -> None:
            _pull(
                points,
                P,
                positions,
                self.prior.depth,
                self.prior.weight,
                front,
                self.tolerance,
                self.cauchy,
                self.behind,
                self.prior.jump,
                correction,
                weight,
                first,
                last,
            )

        run_chunks(body, len(points))
        return correction, weight


@compiled
def _pull(
    points: FloatArray,
    P: FloatArray,
    positions: FloatArray,
    depth: FloatArray,
    weight: FloatArray,
    front: NDArray[np.float64],
    tolerance: float,
    cauchy: float,
    behind: float,
    jump: float,
    correction: FloatArray,
    total: FloatArray,
    first: int,
    last: int,
) -> None:
    views, height, width = depth.shape
    for n in range(first, last):
        x, y, z = points[n, 0], points[n, 1], points[n, 2]
        dx = dy = dz = heard = 0.0
        for s in range(views):
            here = P[s, 2, 0] * x + P[s, 2, 1] * y + P[s, 2, 2] * z + P[s, 2, 3]
            if not here > NEAR:
                continue
            u = (P[s, 0, 0] * x + P[s, 0, 1] * y + P[s, 0, 2] * z + P[s, 0, 3]) / here
            v = (P[s, 1, 0] * x + P[s, 1, 1] * y + P[s, 1, 2] * z + P[s, 1, 3]) / here
            if not (u >= 0 and v >= 0 and u < width and v < height):
                continue
            row, column = int(v), int(u)
            trust = weight[s, row, column]
            if not trust > 0:
                continue
            # Bilinear in inverse depth, which is exact on planes, over the neighbours on the same surface.
            own = depth[s, row, column]
            top, left = int(np.floor(v - 0.5)), int(np.floor(u - 0.5))
            shares, inverse = 0.0, 0.0
            for i in range(max(top, 0), min(top + 2, height)):
                for j in range(max(left, 0), min(left + 2, width)):
                    if weight[s, i, j] > 0 and abs(depth[s, i, j] - own) < jump:
                        share = (1.0 - abs(u - 0.5 - j)) * (1.0 - abs(v - 0.5 - i))
                        shares += share
                        inverse += share / depth[s, i, j]
            surface = shares / inverse if shares > 1e-6 else own
            residual = surface - here
            if residual <= 0 and (residual < -behind or here > front[s, row, column] + tolerance):
                continue
            w = trust / (1.0 + (residual / cauchy) ** 2)
            # Along the ray, a step of one in depth is (point - position) / depth.
            along = w * residual / here
            dx += along * (x - positions[s, 0])
            dy += along * (y - positions[s, 1])
            dz += along * (z - positions[s, 2])
            heard += w
        share = 1.0 / max(heard, 1e-12)
        correction[n, 0], correction[n, 1], correction[n, 2] = dx * share, dy * share, dz * share
        total[n] = heard
