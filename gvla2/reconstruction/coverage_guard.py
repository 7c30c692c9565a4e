"""Keeps every mask pixel explained while points move: what a move uncovers, the points that covered it cover again."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

from gvla2.geometry.transform import FloatArray
from gvla2.geometry.views import Views
from gvla2.reconstruction.compiled import run_together
from gvla2.reconstruction.outline import Outline, outline
from gvla2.reconstruction.support import mask_of, projection

_REACH = 4.0
"""Pixels from a silhouette's edge within which the prior's depth may be borrowed."""


class CoverageGuard:
    """Remembers which points (N, 3) of an object cover which mask pixels before they move.

    ``depth`` (S, H, W) is a prior's, 0 where unknown; ``farthest`` in metres bounds how far a point may slide.
    """

    def __init__(self, start: FloatArray, views: Views, depth: FloatArray, farthest: float) -> None:
        self._start, self._views, self._depth, self._farthest = start, views, depth, farthest
        self._before = _outlines(start, views)
        self._masks = [mask_of(view) > 0.5 for view in views]

    def restore(self, moved: FloatArray, rounds: int = 3) -> FloatArray:
        """The moved points (N, 3), but those that left a mask pixel bare slide along that view's ray instead.

        A point that slides along a view's ray keeps its pixel there, and ends where the prior sees the surface. It
        goes back to its start when the prior knows nothing near that pixel, or when sliding did not help.
        """
        points = moved.copy()
        slid = np.zeros(len(points), dtype=np.bool_)
        for _ in range(rounds):
            after = _outlines(points, self._views)
            bare = [
                mask & was.mask & ~now.mask
                for mask, was, now in zip(self._masks, self._before, after, strict=True)
            ]
            if not any(b.any() for b in bare):
                break
            for s, pixels in enumerate(bare):
                guilty = np.unique(self._before[s].nearest[pixels])
                guilty = guilty[guilty >= 0]
                again = slid[guilty]
                points[guilty[again]] = self._start[guilty[again]]
                points[guilty[~again]] = self._slide(s, guilty[~again])
                slid[guilty] = True
        return points

    def _slide(self, s: int, which: NDArray[np.int64]) -> FloatArray:
        """Points ``which`` at their start's pixel in view ``s``, at the prior's depth there."""
        points, camera, depth = self._start[which], self._views[s].camera, self._depth[s]
        unknown = depth <= 0
        if unknown.all() or len(which) == 0:
            return points
        off, nearest = distance_transform_edt(unknown, return_indices=True)
        image = points @ projection(camera)[:, :3].T + projection(camera)[:, 3]
        here = image[:, 2]
        column = np.clip(image[:, 0] / here, 0, camera.width - 1).astype(int)
        row = np.clip(image[:, 1] / here, 0, camera.height - 1).astype(int)
        there = depth[tuple(nearest[:, row, column])]
        near = (off[row, column] <= _REACH) & (np.abs(there - here) <= self._farthest)
        scale = np.where(near, there / here, 1.0)[:, None]
        return np.asarray(camera.position + (points - camera.position) * scale)


def _outlines(points: FloatArray, views: Views) -> list[Outline]:
    found: list[Outline | None] = [None] * len(views)

    def draw(s: int) -> Callable[[], None]:
        def job() -> None:
            found[s] = outline(points, views[s].camera)

        return job

    run_together([draw(s) for s in range(len(views))])
    return _complete(found)


def _complete(found: Sequence[Outline | None]) -> list[Outline]:
    return [o for o in found if o is not None]
