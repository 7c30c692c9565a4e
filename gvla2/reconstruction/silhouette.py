"""How well a shape's silhouettes and the input masks cover one another."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gvla2.errors import GeometryError
from gvla2.geometry.transform import FloatArray
from gvla2.geometry.views import View, Views
from gvla2.reconstruction.compiled import run_together
from gvla2.reconstruction.outline import outline
from gvla2.reconstruction.support import as_points, mask_of
from gvla2.reconstruction.zbuffer import depth_of


@dataclass(frozen=True)
class Coverage:
    """Agreement of silhouette and mask in each view, all (S,) in [0, 1]; NaN for a view whose mask is empty.

    ``explained``: share of the mask that the silhouette covers (low when the shape is too small);
    ``contained``: share of the silhouette within the mask (low when it is too large; 1 when it is empty);
    ``iou``: both ways at once.
    """

    explained: FloatArray
    contained: FloatArray
    iou: FloatArray

    @property
    def mean_iou(self) -> float:
        """Mean over the views with a mask; NaN when every mask is empty."""
        seen = ~np.isnan(self.iou)
        return float(self.iou[seen].mean()) if seen.any() else float("nan")


def symmetric_iou(points: ArrayLike, views: Views, *, faces: ArrayLike | None = None) -> float:
    """Mean over the views of |S n M| / |S u M|, of silhouette S and mask M > 0.5.

    Views with an empty mask are left out.
    ``points`` (N, 3) metres; with ``faces`` (F, 3) they are a mesh's vertices and its triangles are drawn, else S is
    the points' closed outline, much the same for 10 thousand and for 300 thousand points of one surface.
    Raises :class:`GeometryError` for a view without a mask and when every mask is empty.
    """
    value = coverage(points, views, faces=faces).mean_iou
    if np.isnan(value):
        raise GeometryError(f"All {len(views)} masks are empty: there is no silhouette to compare with.")
    return value


def coverage(points: ArrayLike, views: Views, *, faces: ArrayLike | None = None) -> Coverage:
    """What :func:`symmetric_iou` averages, view by view and each way; an empty mask gives NaN, not an error."""
    drawn = silhouettes(points, views, faces=faces)
    rows = [_compare(mask, view) for mask, view in zip(drawn, views, strict=True)]
    explained, contained, iou = np.array(rows).T
    return Coverage(explained, contained, iou)


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
    masks: list[NDArray[np.bool_]] = [np.zeros((0, 0), dtype=np.bool_)] * len(views)

    def draw(number: int, view: View) -> Callable[[], None]:
        def job() -> None:
            if triangles is None:
                masks[number] = outline(array, view.camera).mask
            else:
                masks[number] = np.isfinite(depth_of(array, triangles, view.camera))

        return job

    run_together([draw(number, view) for number, view in enumerate(views)])
    return masks


def _compare(drawn: NDArray[np.bool_], view: View) -> tuple[float, float, float]:
    mask = mask_of(view) > 0.5
    both, in_mask, in_drawn = int((drawn & mask).sum()), int(mask.sum()), int(drawn.sum())
    if in_mask == 0:
        return np.nan, np.nan, np.nan
    return both / in_mask, both / in_drawn if in_drawn else 1.0, both / (in_mask + in_drawn - both)
