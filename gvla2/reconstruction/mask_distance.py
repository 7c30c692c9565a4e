"""Masks as signed distances to their contours, with sub-pixel accuracy."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation, binary_erosion, distance_transform_edt, map_coordinates

from gvla2.errors import GeometryError
from gvla2.geometry.camera import Camera
from gvla2.geometry.transform import FloatArray
from gvla2.geometry.views import View, Views

FEWEST_PIXELS = 4
"""A mask of fewer pixels than this is empty."""


@dataclass(frozen=True)
class Silhouette:
    """One view's mask as carving needs it.

    ``distance`` (H, W) float32: pixels from each pixel's centre to the contour, positive inside, +inf where the view
    says nothing (the robot hides the background there). ``box`` (4,): left, top, right and bottom end of the mask,
    pixels. ``cut`` (4,) bool: on which of these sides the mask reaches the image's border, so that the object may go
    on outside the image.
    """

    camera: Camera
    image: NDArray[np.uint8]
    distance: NDArray[np.float32]
    box: FloatArray
    cut: NDArray[np.bool_]

    @property
    def inside(self) -> NDArray[np.bool_]:
        """(H, W) bool, where the object is."""
        return np.asarray((self.distance > 0) & np.isfinite(self.distance))

    def sample(self, uv: FloatArray) -> FloatArray:
        """(N,) distances in pixels at pixels (N, 2), bilinear; the nearest value outside the image, NaN at NaN."""
        known = np.asarray(np.isfinite(uv).all(axis=1))
        where = np.where(known[:, None], uv - 0.5, 0.0)[:, ::-1].T
        # Where nothing is known the distance is infinite, and infinity times a weight of 0 is none.
        near = map_coordinates(np.minimum(self.distance, np.float32(1e6)), where, order=1, mode="nearest")
        return np.asarray(np.where(known, near, np.nan))


def silhouettes(views: Views) -> tuple[tuple[Silhouette, ...], tuple[str, ...]]:
    """The views' silhouettes and a note for each view that has none.

    Raises :class:`GeometryError` when no view shows the object, or a mask is not a number somewhere.
    """
    found, notes = [], []
    for view in views:
        if view.mask is None:
            notes.append(f"view '{view.name}' has no mask and is ignored")
            continue
        if not np.isfinite(view.mask).all():
            raise GeometryError(f"View '{view.name}': the mask has values that are not numbers.")
        if int((view.mask > 0.5).sum()) < FEWEST_PIXELS:
            notes.append(f"the mask of view '{view.name}' is empty and the view is ignored")
            continue
        found.append(_silhouette(view, view.mask))
    if not found:
        raise GeometryError(
            f"No view shows the object: of {len(views)} views none has a mask with at least "
            f"{FEWEST_PIXELS} pixels above 0.5."
        )
    return tuple(found), tuple(notes)


def signed_distance(mask: NDArray[np.floating]) -> NDArray[np.float32]:
    """(H, W) pixels to the contour mask = 0.5, positive inside, linear in the mask near the contour.

    The whole image inside gives +inf everywhere, nothing inside -inf.
    """
    mask = np.asarray(mask, dtype=np.float32)
    inside = mask > 0.5
    if inside.all() or not inside.any():
        return np.full(mask.shape, np.inf if inside.all() else -np.inf, dtype=np.float32)
    padded = np.pad(mask, 1, mode="edge")
    down, across = np.abs(np.diff(padded[:, 1:-1], axis=0)), np.abs(np.diff(padded[1:-1], axis=1))
    steepest = np.maximum.reduce([down[:-1], down[1:], across[:, :-1], across[:, 1:]])
    contour = binary_dilation(inside) & ~binary_erosion(inside, border_value=1)
    # At a pixel beside the contour the mask itself tells where between two centres the contour runs.
    own = np.clip((mask - 0.5) / np.maximum(steepest, 0.05), -1.0, 1.0)
    far, nearest = distance_transform_edt(~contour, return_indices=True)
    return np.asarray(np.where(inside, far, -far) + own[nearest[0], nearest[1]], dtype=np.float32)


def mask_iou(covered: NDArray[np.bool_], s: Silhouette) -> float:
    """Intersection over union of drawn pixels (H, W) with the mask, where the view says anything."""
    covered = covered & np.isfinite(s.distance)
    union = (covered | s.inside).sum()
    return float((covered & s.inside).sum() / union) if union else 0.0


def _silhouette(view: View, mask: NDArray[np.float32]) -> Silhouette:
    inside = mask > 0.5
    rows, columns = np.flatnonzero(inside.any(axis=1)), np.flatnonzero(inside.any(axis=0))
    box = np.array([columns[0], rows[0], columns[-1] + 1, rows[-1] + 1], dtype=np.float64)
    size = (view.camera.width, view.camera.height)
    cut = np.array([box[0] == 0, box[1] == 0, box[2] == size[0], box[3] == size[1]])
    distance = signed_distance(mask)
    if view.robot_mask is not None:
        # What the robot's own body hides is no evidence against the object.
        distance[view.robot_mask & ~inside] = np.inf
    return Silhouette(view.camera, view.image, distance, box, cut)
