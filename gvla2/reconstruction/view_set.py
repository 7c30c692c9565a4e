"""The input views with what all stages ask of them, and the gate that keeps a stage only where the masks allow it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gvla2.errors import GeometryError
from gvla2.geometry.mesh import TriangleMesh
from gvla2.geometry.transform import FloatArray
from gvla2.geometry.views import Views
from gvla2.reconstruction.carving import Field, hull_field, surface_of
from gvla2.reconstruction.contracts import Reconstruction, StageReport
from gvla2.reconstruction.silhouette import Silhouette, depth_maps, mask_silhouettes, symmetric_iou
from gvla2.reconstruction.support import MaskStack, as_points, mask_of, mask_support


@dataclass(frozen=True, eq=False)
class ViewSet:
    """Views D = {(I_i, M_i, K_i, T_i)} that all have masks; raises :class:`GeometryError` where one has none."""

    views: Views

    def __post_init__(self) -> None:
        for view in self.views:
            mask_of(view)
            u, v = view.camera.K[:2, 2]
            if not (0 <= u <= view.camera.width and 0 <= v <= view.camera.height):
                raise GeometryError(
                    f"View '{view.name}': the principal point ({u:g}, {v:g}) lies outside its picture of "
                    f"{view.camera.width}x{view.camera.height} pixels. Was it cropped or resized, and K not?"
                )
        names = [view.name for view in self.views]
        doubled = sorted({name for name in names if names.count(name) > 1})
        if doubled:
            raise GeometryError(
                f"Views are identified by their names, and {', '.join(doubled)} stands twice."
            )

    @cached_property
    def _stack(self) -> MaskStack:
        return MaskStack.of(self.views)

    def support(self, points: FloatArray) -> FloatArray:
        """s(p) (N,) of points (N, 3) (paper, mask-consistency score)."""
        return self._stack.support(as_points(points))

    @cached_property
    def silhouettes(self) -> tuple[Silhouette, ...]:
        """The masks as signed distances, less the empty ones."""
        return mask_silhouettes(self.views)[0]

    @cached_property
    def rays(self) -> tuple[FloatArray, ...]:
        """Each view's world directions (H, W, 3) of its pixels, of depth 1."""
        return tuple(view.camera.rays()[1] for view in self.views)

    @cached_property
    def hull(self) -> Field:
        """The masks' visual hull."""
        return hull_field(self.views)

    @cached_property
    def hull_surface(self) -> TriangleMesh:
        """The zero of :attr:`hull`."""
        return surface_of(self.hull)

    @cached_property
    def hull_interval(self) -> tuple[FloatArray, FloatArray]:
        """Depths (S, H, W), metres, between which the hull lies on each pixel's ray, NaN where it is missed."""
        cameras = [view.camera for view in self.views]
        front = np.stack(depth_maps(self.hull_surface, cameras)).astype(np.float64)
        back = np.stack(depth_maps(self.hull_surface, cameras, farthest=True)).astype(np.float64)
        missed = ~np.isfinite(front)
        return np.where(missed, np.nan, front), np.where(missed, np.nan, back)


DENSE = 100_000


def points_of(obj: Reconstruction) -> FloatArray:
    """The points that stand for the object: Gaussian centres, else mesh vertices, (N, 3)."""
    if obj.gaussians is not None and len(obj.gaussians.centres):
        return np.asarray(obj.gaussians.centres, dtype=np.float64)
    if obj.mesh is not None and len(obj.mesh.vertices):
        return np.asarray(obj.mesh.vertices, dtype=np.float64)
    raise GeometryError("The reconstruction is empty: it has neither Gaussians nor mesh vertices.")


def outlined(obj: Reconstruction) -> tuple[FloatArray, NDArray[np.int64] | None]:
    """The points and faces whose silhouettes count: the mesh's, which has no gaps, else the Gaussians' centres."""
    if obj.mesh is not None and len(obj.mesh.faces):
        return obj.mesh.vertices, obj.mesh.faces
    return points_of(obj), None


def dense_points(obj: Reconstruction) -> FloatArray:
    """(N, 3) points so close together that their outline is the object's: samples of the mesh where there is one."""
    if obj.mesh is not None and len(obj.mesh.faces) and obj.mesh.areas.sum() > 0:
        return obj.mesh.sample(DENSE, np.random.default_rng(0))[0]
    return points_of(obj)


def both_moved(obj: Reconstruction, move: Callable[[FloatArray], FloatArray]) -> Reconstruction:
    """Move Gaussians and mesh by one function of points (N, 3)."""
    gaussians, mesh = obj.gaussians, obj.mesh
    if gaussians is not None:
        gaussians = gaussians.with_centres(move(np.asarray(gaussians.centres, dtype=np.float64)))
    if mesh is not None:
        mesh = mesh.with_vertices(move(np.asarray(mesh.vertices, dtype=np.float64)))
    return replace(obj, gaussians=gaussians, mesh=mesh)


def mismatch(a: Reconstruction, b: Reconstruction) -> str:
    """Return the reason why the two cannot be fused point by point, or ""."""
    if (a.gaussians is None) != (b.gaussians is None) or (a.mesh is None) != (b.mesh is None):
        return "One source has Gaussians or a mesh that the other lacks."
    if a.gaussians is not None and b.gaussians is not None and len(a.gaussians) != len(b.gaussians):
        return f"The sources have {len(a.gaussians)} and {len(b.gaussians)} Gaussians."
    if a.mesh is not None and b.mesh is not None and not np.array_equal(a.mesh.faces, b.mesh.faces):
        return "The sources' meshes differ in topology."
    return ""


IOU_TOLERANCE, SUPPORT_TOLERANCE = 1e-3, 0.02
"""Falls of symmetric IoU and of mean mask support that do not speak against a change."""


def gate_report(
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
            "symmetric_iou": symmetric_iou(points, views, faces=faces),
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
