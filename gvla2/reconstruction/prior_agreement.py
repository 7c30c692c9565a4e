"""Do a prior's depth maps agree with one another through the calibrated cameras?

A surface that one view places where another view looks through, or outside another view's mask, cannot be there.
The same comparison finds a wrong scale: the calibrated baselines fix it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter

from gvla2.geometry.transform import FloatArray
from gvla2.geometry.views import Views
from gvla2.reconstruction.compiled import compiled
from gvla2.reconstruction.prior_depth import PriorDepth
from gvla2.reconstruction.support import mask_of, projection

_SAMPLES = 1500
"""Pixels of each view that are compared with every other view."""
_SEARCH = 0.35
"""The scale is searched this far around 1, as a natural logarithm."""
_SHARP = 3.0
"""By how much the tolerance shrinks to place the scale."""
ALIKE = 0.7
"""Cosine between two normals of one surface, at least."""
_MARGIN = 2
"""Pixels by which a mask is widened before a point counts as outside it."""


@dataclass(frozen=True)
class Agreement:
    """Shares of the pairs (pixel of a view, other view), each in [0, 1], NaN-free.

    ``agreeing``: the other view's depth is there too, within the tolerance (a soft count); ``conflicting``: the
    other view sees through the point or has no object there. The rest is hidden and says nothing. ``pairs`` is
    how many could be compared at all.
    """

    agreeing: float
    conflicting: float
    pairs: int

    @property
    def conflict_ratio(self) -> float:
        """Conflicts among the pairs that say something; 0 when none does."""
        total = self.agreeing + self.conflicting
        return self.conflicting / total if total > 0 else 0.0

    @property
    def score(self) -> float:
        """Highest where the depth maps fit together best."""
        return self.agreeing - self.conflicting


class CrossCheck:
    """Compares the depth maps of a prior; ``tolerance`` in metres."""

    def __init__(self, prior: PriorDepth, views: Views, tolerance: float) -> None:
        self._tolerance = tolerance
        self._depth = prior.solid  # a flying pixel would contradict every other view
        self._projections = [projection(view.camera) for view in views]
        self._masks = [maximum_filter(mask_of(view) > 0.5, 2 * _MARGIN + 1) for view in views]
        self._samples: list[tuple[FloatArray, FloatArray, FloatArray, FloatArray]] = []
        self._normals = prior.normals
        for s, view in enumerate(views):
            rows, columns = np.nonzero(
                (prior.solid[s] > 0) & (prior.weight[s] > 0.25 * prior.weight[s].max(initial=0.0))
            )
            step = max(1, len(rows) // _SAMPLES)
            rows, columns = rows[::step], columns[::step]
            origin, rays = view.camera.rays()
            at = prior.depth[s][rows, columns]
            normals = np.ascontiguousarray(prior.normals[s][rows, columns])
            self._samples.append((origin, rays[rows, columns], at, normals))

    def at(self, scale: float = 1.0, sharpness: float = 1.0) -> Agreement:
        """The agreement when all depths are multiplied by ``scale``; ``sharpness`` divides the tolerance."""
        counts = np.zeros(3)
        for s, (origin, rays, depth, normals) in enumerate(self._samples):
            points = np.ascontiguousarray(origin + rays * (scale * depth)[:, None])
            for t in range(len(self._projections)):
                if t != s:
                    _compare(
                        points,
                        normals,
                        self._normals[t],
                        self._projections[t],
                        self._depth[t],
                        self._masks[t],
                        scale,
                        self._tolerance / sharpness,
                        counts,
                    )
        pairs = max(counts[2], 1.0)
        return Agreement(float(counts[0] / pairs), float(counts[1] / pairs), int(counts[2]))

    def best_scale(self) -> float:
        """The factor on all depths that makes most of them agree; 1 unless the gain is plain.

        A wide tolerance finds the peak, a sharp one places it: with a wide one, the two sides of thin objects meet.
        """
        if self.at().pairs == 0:
            return 1.0
        peak = self._search(0.0, _SEARCH, 29, 1.0)
        best = float(np.exp(self._search(peak, 0.03, 25, _SHARP)))
        was, now = self.at(1.0, _SHARP).score, self.at(best, _SHARP).score
        # A small gain is noise, and metric depth is right more often than not.
        return best if now > was + 0.1 * abs(now) + 0.01 else 1.0

    def _search(self, middle: float, reach: float, steps: int, sharpness: float) -> float:
        """The logarithm of the best scale within ``reach`` of ``middle``, searched ever finer."""
        while reach > 1e-3:
            tried = np.linspace(middle - reach, middle + reach, steps)
            scores = [self.at(float(np.exp(x)), sharpness).score for x in tried]
            middle, reach, steps = float(tried[int(np.argmax(scores))]), 2 * reach / (steps - 1), 7
        return middle


@compiled
def _compare(
    points: FloatArray,
    normals: FloatArray,
    there: FloatArray,
    P: FloatArray,
    depth: FloatArray,
    mask: NDArray[np.bool_],
    scale: float,
    tolerance: float,
    counts: FloatArray,
) -> None:
    height, width = depth.shape
    for n in range(len(points)):
        x, y, z = points[n, 0], points[n, 1], points[n, 2]
        here = P[2, 0] * x + P[2, 1] * y + P[2, 2] * z + P[2, 3]
        if not here > 0:
            continue
        u = (P[0, 0] * x + P[0, 1] * y + P[0, 2] * z + P[0, 3]) / here
        v = (P[1, 0] * x + P[1, 1] * y + P[1, 2] * z + P[1, 3]) / here
        if not (u >= 0 and v >= 0 and u < width and v < height):
            continue
        row, column = int(v), int(u)
        counts[2] += 1.0
        if not mask[row, column]:
            counts[1] += 1.0
        elif depth[row, column] > 0:
            off = (here - scale * depth[row, column]) / tolerance
            # The far side of a thin wall, or another side of an edge, is another surface, however near.
            alike = (
                normals[n, 0] * there[row, column, 0]
                + normals[n, 1] * there[row, column, 1]
                + normals[n, 2] * there[row, column, 2]
            )
            if alike > ALIKE:
                counts[0] += 1.0 / (1.0 + off * off)
            if off < -3.0:
                counts[1] += 1.0
