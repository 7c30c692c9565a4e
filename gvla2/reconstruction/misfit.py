"""How far silhouettes leave their masks, not counting the rim.

A visual hull meets its masks exactly, by construction; the true surface, sampled by points, ends half a pixel inside.
So a change for the better lowers the symmetric IoU a little, in proportion to the contour's length, while a change for
the worse bares or leaves whole areas of the masks.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy.ndimage import binary_erosion, distance_transform_edt

from gvla2.geometry.views import Views
from gvla2.reconstruction.silhouette import silhouettes
from gvla2.reconstruction.support import mask_of

BAND = 1.5
"""Pixels on both sides of a contour that count as its rim."""


def rim_share(views: Views) -> float:
    """Share of the masks' pixels that have a neighbour outside: what one pixel along the contours amounts to."""
    inside = [mask_of(view) > 0.5 for view in views]
    rim = sum(int((mask & ~binary_erosion(mask)).sum()) for mask in inside)
    return rim / max(sum(int(mask.sum()) for mask in inside), 1)


def deep_changes(before: ArrayLike, after: ArrayLike, views: Views) -> tuple[float, float]:
    """Areas newly bared and newly left beyond the rim, as shares of the masks' area; both may be below 0.

    ``before`` (N, 3) and ``after`` (M, 3) are world points whose outlines are compared with the masks.
    """
    (bare_was, out_was), (bare_now, out_now) = (deep_misfit(points, views) for points in (before, after))
    return bare_now - bare_was, out_now - out_was


def deep_misfit(points: ArrayLike, views: Views) -> tuple[float, float]:
    """Mask area farther than the rim from the points' silhouettes, and silhouette area farther than it from the masks.

    ``points`` (N, 3) in the world, metres; both answers are shares of the masks' area.
    """
    bare = left = area = 0
    for drawn, view in zip(silhouettes(points, views), views, strict=True):
        mask = mask_of(view) > 0.5
        bare += int((mask & _beyond(drawn)).sum())
        left += int((drawn & _beyond(mask)).sum())
        area += int(mask.sum())
    return bare / max(area, 1), left / max(area, 1)


def _beyond(shape: np.ndarray) -> np.ndarray:
    """Pixels farther than the rim from a shape (H, W); all of them when it is empty."""
    if not shape.any():
        return np.ones(shape.shape, dtype=np.bool_)
    return np.asarray(distance_transform_edt(~shape) > BAND)
