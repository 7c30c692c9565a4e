"""The gate behind every stage: changed geometry is kept only when the input masks do not speak against it."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from gvla2.errors import GeometryError
from gvla2.geometry.views import Views
from gvla2.reconstruction.contracts import StageReport
from gvla2.reconstruction.silhouette import mean_iou
from gvla2.reconstruction.support import as_points, mask_support

IOU_TOLERANCE, SUPPORT_TOLERANCE = 1e-3, 0.02
"""Falls of symmetric IoU and of mean mask support that do not speak against a change."""


def judged(
    stage: str, before: ArrayLike, after: ArrayLike, views: Views, *, faces: ArrayLike | None = None
) -> StageReport:
    """Compare points (N, 3) with where a stage put them (M, 3), metres, by the views' masks.

    The report is ``applied`` or ``rejected``; its measures are ``support`` (mean mask support) and ``symmetric_iou``
    of the old and the new points, NaN where every mask is empty. Applied when neither falls by more than its
    tolerance. Support may fall besides by as much as the IoU rises: a shape grown to its true size has its rim on the
    masks' edges, where a mask is worth one half, and support alone would only ever let shapes shrink.
    ``faces`` (F, 3) are those of :func:`gvla2.reconstruction.silhouette.symmetric_iou`.
    Raises :class:`GeometryError` for malformed points or faces and a view without a mask.
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
    status: Literal["applied", "rejected"] = "rejected"
    gain = max(0.0, now["symmetric_iou"] - was["symmetric_iou"])
    if lost > 0:
        reason = f"{lost} points became infinite or not-a-number."
    elif np.isnan(was["symmetric_iou"]):
        reason = "Every mask is empty: nothing speaks for the change."
    elif not now["symmetric_iou"] >= was["symmetric_iou"] - IOU_TOLERANCE:
        reason = f"Symmetric IoU fell from {was['symmetric_iou']:.4f} to {now['symmetric_iou']:.4f}."
    elif not now["support"] >= was["support"] - SUPPORT_TOLERANCE - gain:
        reason = f"Mean mask support fell from {was['support']:.4f} to {now['support']:.4f}."
    else:
        status = "applied"
        reason = (
            f"Symmetric IoU {was['symmetric_iou']:.4f} to {now['symmetric_iou']:.4f}, "
            f"support {was['support']:.4f} to {now['support']:.4f}."
        )
    return StageReport(stage, status, reason, was, now)
