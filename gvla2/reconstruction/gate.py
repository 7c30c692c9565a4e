"""The gate behind every stage: changed geometry is kept only when the input masks do not speak against it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from gvla2.errors import GeometryError
from gvla2.geometry.views import Views
from gvla2.reconstruction.silhouette import mean_iou
from gvla2.reconstruction.support import as_points, mask_support

IOU_TOLERANCE, SUPPORT_TOLERANCE = 1e-3, 0.02
"""Falls of symmetric IoU and of mean mask support that do not speak against a change."""


@dataclass(frozen=True)
class Gate:
    """Whether the new geometry is kept, and what was measured.

    ``reason`` says why, as a sentence; ``before`` and ``after`` hold ``support`` (mean mask support) and
    ``symmetric_iou`` of the old and the new points, NaN where every mask is empty.
    """

    accepted: bool
    reason: str
    before: Mapping[str, float]
    after: Mapping[str, float]


def accept(before: ArrayLike, after: ArrayLike, views: Views, *, faces: ArrayLike | None = None) -> Gate:
    """Compare points (N, 3) with where a stage put them (M, 3), metres, by the views' masks.

    Kept when neither the symmetric IoU nor the mean mask support falls by more than its tolerance. Support may
    fall besides by as much as the IoU rises: a shape grown to its true size has its rim on the masks' edges, where
    a mask is worth one half, and support alone would only ever let shapes shrink.
    ``faces`` (F, 3) are those of :func:`gvla2.reconstruction.silhouette.symmetric_iou`.
    Raises :class:`GeometryError` for malformed points and a view without a mask.
    """
    old, new = as_points(before, "before"), as_points(after, "after")
    if len(old) == 0 or len(new) == 0:
        raise GeometryError(f"The gate compares points: got {len(old)} before and {len(new)} after.")
    measured = [
        {
            "support": float(mask_support(points, views).mean()),
            "symmetric_iou": mean_iou(points, views, faces=faces),
        }
        for points in (old, new)
    ]
    was, now = measured
    lost = int((~np.isfinite(new)).any(axis=1).sum()) - int((~np.isfinite(old)).any(axis=1).sum())
    if lost > 0:
        return Gate(False, f"{lost} points became infinite or not-a-number.", was, now)
    if np.isnan(was["symmetric_iou"]):
        return Gate(False, "Every mask is empty: nothing speaks for the change.", was, now)
    if not now["symmetric_iou"] >= was["symmetric_iou"] - IOU_TOLERANCE:
        reason = f"Symmetric IoU fell from {was['symmetric_iou']:.4f} to {now['symmetric_iou']:.4f}."
        return Gate(False, reason, was, now)
    gain = max(0.0, now["symmetric_iou"] - was["symmetric_iou"])
    if not now["support"] >= was["support"] - SUPPORT_TOLERANCE - gain:
        reason = f"Mean mask support fell from {was['support']:.4f} to {now['support']:.4f}."
        return Gate(False, reason, was, now)
    reason = (
        f"Symmetric IoU {was['symmetric_iou']:.4f} to {now['symmetric_iou']:.4f}, "
        f"support {was['support']:.4f} to {now['support']:.4f}."
    )
    return Gate(True, reason, was, now)
