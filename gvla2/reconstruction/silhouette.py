"""How well a shape's silhouettes and the input masks cover one another."""

from __future__ import annotations

from functools import partial

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gvla2.errors import GeometryError
from gvla2.geometry.mesh import TriangleMesh
from gvla2.geometry.views import Views
from gvla2.reconstruction.compiled import run_together
from gvla2.reconstruction.outline import outline
from gvla2.reconstruction.support import as_points, mask_of
from gvla2.reconstruction.zbuffer import depth_maps


def symmetric_iou(points: ArrayLike, views: Views, *, faces: ArrayLike | None = None) -> float:
    """Mean over the views of |S n M| / |S u M|, of silhouette S and mask M > 0.5.

    Views with an empty mask are left out.
    ``points`` (N, 3) metres; with ``faces`` (F, 3) they are a mesh's vertices and its triangles are drawn, else S is
    the points' closed outline, much the same for 10 thousand and for 300 thousand points of one surface.
    Raises :class:`GeometryError` for a view without a mask, when every mask is empty, and for faces or their vertices
    that a mesh must not have.
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
    array, cameras = as_points(points), [view.camera for view in views]
    if faces is None:
        outlines = run_together([partial(outline, array, camera) for camera in cameras])
        return [drawn.mask for drawn in outlines]
    mesh = TriangleMesh(array, np.asarray(faces))
    return [np.isfinite(depth) for depth in depth_maps(mesh, cameras)]
