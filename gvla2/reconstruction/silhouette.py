"""How well a shape's silhouettes and the input masks cover one another."""

from __future__ import annotations

from functools import partial

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gvla2.errors import GeometryError
from gvla2.geometry.camera import Camera
from gvla2.geometry.views import Views
from gvla2.reconstruction.compiled import run_together
from gvla2.reconstruction.outline import outline
from gvla2.reconstruction.support import as_points, mask_of
from gvla2.reconstruction.zbuffer import depth_of


def symmetric_iou(points: ArrayLike, views: Views, *, faces: ArrayLike | None = None) -> float:
    """Mean over the views of |S n M| / |S u M|, of silhouette S and mask M > 0.5.

    Views with an empty mask are left out.
    ``points`` (N, 3) metres; with ``faces`` (F, 3) they are a mesh's vertices and its triangles are drawn, else S is
    the points' closed outline, much the same for 10 thousand and for 300 thousand points of one surface.
    Raises :class:`GeometryError` for a view without a mask and when every mask is empty.
    """
    value = mean_iou(points, views, faces=faces)
    if np.isnan(value):
        raise GeometryError(f"All {len(views)} masks are empty: there is no silhouette to compare with.")
    return value


def mean_iou(points: ArrayLike, views: Views, *, faces: ArrayLike | None = None) -> float:
    """The same; NaN, not an error, when every mask is empty."""
    found = []
    for drawn, view in zip(silhouettes(points, views, faces=faces), views, strict=True):
        mask = mask_of(view) > 0.5
        if mask.any():
            found.append((drawn & mask).sum() / (drawn | mask).sum())
    return float(np.mean(found)) if found else float("nan")


def silhouettes(
    points: ArrayLike, views: Views, *, faces: ArrayLike | None = None
) -> list[NDArray[np.bool_]]:
    """One silhouette (H, W) a view, true where the pixel's centre is covered; arguments as in :func:`symmetric_iou`."""
    array = as_points(points)
    triangles = None if faces is None else np.asarray(faces, dtype=np.int64)
    if triangles is not None and (triangles.ndim != 2 or triangles.shape[1] != 3):
        raise GeometryError(f"faces must be (F, 3), got shape {triangles.shape}.")
    if triangles is not None and triangles.size and not 0 <= triangles.min() <= triangles.max() < len(array):
        raise GeometryError(f"A face names a vertex outside 0..{len(array) - 1}.")

    def drawn(camera: Camera) -> NDArray[np.bool_]:
        if triangles is None:
            return outline(array, camera).mask
        return np.isfinite(depth_of(array, triangles, camera))

    return run_together([partial(drawn, view.camera) for view in views])
