"""The GeoFuse-MV3D branch, top to bottom: two geometry sources, checked against the views, and their fusion.

    views (I, M, K, T) + G0 --+-> source A: prior -> appearance affine -> soft visual hull --+
                              +-> source B: axis compensation (no prior) --------------------+-> fusion -> out

Each stage reports what it did and why; a stage that the views speak against is undone.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal, ParamSpec

import numpy as np

from gvla2.errors import GeometryError
from gvla2.geometry.mesh import TriangleMesh
from gvla2.geometry.transform import FloatArray
from gvla2.geometry.views import Views
from gvla2.reconstruction.appearance import calibrate_colours, vertex_colours
from gvla2.reconstruction.carving import normals_of, surface_of, without_specks
from gvla2.reconstruction.contracts import (
    AxisCompensation,
    FusionStrategy,
    GeometryEstimate,
    GeometryPrior,
    Reconstruction,
    Renderer,
    StageReport,
)
from gvla2.reconstruction.depth_evidence import DepthEvidence, gather
from gvla2.reconstruction.inset import alpha_iou, inset, largest
from gvla2.reconstruction.options import BranchOptions
from gvla2.reconstruction.silhouette import depth_maps, symmetric_iou
from gvla2.reconstruction.support import object_centre, soft_hull
from gvla2.reconstruction.surfels import place
from gvla2.reconstruction.view_set import (
    ViewSet,
    both_moved,
    dense_points,
    gate_report,
    mismatch,
    outlined,
    points_of,
)
from gvla2.reconstruction.volume import Posterior, fuse_volume

MAX_MASK_LOSS = 0.06
"""Loss of agreement with the masks, against G0, that undoes everything: a safety net. A carved hull fits its masks to
the pixel, and a truer shape may fit them less: a bowl's thin wall by .044."""


@dataclass(frozen=True)
class BranchComponents:
    """The components that the branch is made of."""

    prior: GeometryPrior
    axis: AxisCompensation
    fusion: FusionStrategy
    renderer: Renderer


@dataclass(frozen=True)
class BranchResult:
    """The branch's sources and its output; ``stages`` in the order they ran. B is A where nothing asks for it."""

    g0: Reconstruction
    a: Reconstruction
    b: Reconstruction
    out: Reconstruction
    stages: tuple[StageReport, ...]


def refine_geometry(
    g0: Reconstruction, views: Views, parts: BranchComponents, options: BranchOptions | None = None
) -> BranchResult:
    """Refine an object's first reconstruction by the views' masks, a geometry prior and a fusion of two sources.

    ``views`` need masks. Raises :class:`GeometryError` when G0 holds no points or a view has no mask; whatever
    else goes wrong becomes a typed status of a stage, and that stage's input is kept.
    """
    options = options or BranchOptions()
    seen = ViewSet(views)
    branch = _Branch(seen, parts, options)
    points_of(g0)
    obj = g0
    paper = options.mode == "paper"
    # Carving has no drift, generated objects do; a prior would mend the seen sides alone, and tear them.
    if not paper:
        obj = branch.run(branch.compensated, obj, "drift")
    # Source A: G0 -> x_A, theta_A.
    if options.prior:
        obj = branch.run(fuse_prior, obj, seen, parts.prior)
    if options.appearance:
        # (g, b) = argmin |g I^ + b - I|_M + beta (g - 1)^2 + beta b^2
        obj = branch.run(calibrate_colours, obj, views, parts.renderer)
    if options.soft_hull:
        obj = branch.run(branch.shrunk, obj)  # p' = c + (p - c)(1 - lambda(p))
    a = obj
    # Source B: p'' = c + (p' - c) * a + delta; carrying on from A keeps what A has mended.
    b = a
    if options.fusion or options.axis_alone:
        b = branch.run(branch.compensated, g0 if paper else a, "axis")
    out = branch.run(branch.fused, a, b)  # x_out = x_A + alpha w (x_B - x_A), theta_out = theta_A
    if not paper:
        painted = None
        if options.appearance:
            out = branch.run(inset, out, views, parts.renderer)
            last = branch.stages[-1]
            painted = (last.after if last.status == "applied" else last.before).get("alpha_iou")
        out = branch.run(branch.fall_back_to_g0, out, g0, painted)
    return BranchResult(g0, a, b, out, tuple(branch.stages))


P = ParamSpec("P")
Outcome = tuple[Reconstruction, StageReport | None]


class _Branch:
    """The stages, each from one reconstruction to the next; ``stages`` gathers their reports."""

    def __init__(self, seen: ViewSet, parts: BranchComponents, options: BranchOptions) -> None:
        self._seen, self._views, self._parts, self._options = seen, seen.views, parts, options
        self.stages: list[StageReport] = []

    def run(self, stage: Callable[P, Outcome], *args: P.args, **options: P.kwargs) -> Reconstruction:
        """Run a stage and return its reconstruction; its report, if any, is kept with its seconds."""
        began = time.perf_counter()
        obj, report = stage(*args, **options)
        if report is not None:
            self.stages.append(replace(report, seconds=time.perf_counter() - began))
        return obj

    def shrunk(self, obj: Reconstruction) -> Outcome:
        """The soft visual hull: points of low mask support move a little inwards."""
        o, c = self._options, object_centre(points_of(obj))  # one centre for Gaussians and mesh alike

        def move(points: FloatArray) -> FloatArray:
            return soft_hull(points, self._seen.support(points), c, o.tau, o.eta, o.lambda_max)

        return self._gated("soft_hull", obj, both_moved(obj, move))

    def compensated(self, obj: Reconstruction, stage: str) -> Outcome:
        """Axis compensation, from masks and poses alone."""
        if not self._options.axis:
            return obj, StageReport(stage, "skipped", "Source B is switched off.")
        fit = self._parts.axis.compensate(dense_points(obj), self._views, object_centre(points_of(obj)))
        measures = {"iou": fit.iou_before}, {"iou": fit.iou_after}
        status: Literal["applied", "rejected"] = "applied" if fit.accepted else "rejected"
        moved = both_moved(obj, fit.apply) if fit.accepted else obj
        return moved, StageReport(stage, status, fit.reason, *measures)

    def fused(self, a: Reconstruction, b: Reconstruction) -> Outcome:
        """Fuse x_A and x_B by the strategy, w from s(x_A) and s(x_B). Falls back to A when they do not match."""
        o = self._options
        if not o.fusion:
            kept, which = (b, "B") if o.axis_alone else (a, "A")
            return kept, StageReport("fusion", "skipped", f"Switched off: source {which} is the output.")
        reason = mismatch(a, b)
        if reason:
            return a, StageReport("fusion", "fallback", f"{reason} Source A is the output.")
        gaussians, mesh = a.gaussians, a.mesh
        try:
            if gaussians is not None and b.gaussians is not None:
                gaussians = gaussians.with_centres(self._fuse(gaussians.centres, b.gaussians.centres))
            if mesh is not None and b.mesh is not None:
                mesh = mesh.with_vertices(self._fuse(mesh.vertices, b.mesh.vertices))
        except GeometryError as error:
            return a, StageReport("fusion", "fallback", f"{error} Source A is the output.")
        return self._gated("fusion", a, replace(a, gaussians=gaussians, mesh=mesh))

    def _fuse(self, of_a: np.ndarray, of_b: np.ndarray) -> FloatArray:
        of_a, of_b = (np.asarray(x, dtype=np.float64) for x in (of_a, of_b))
        if np.array_equal(of_a, of_b):
            return of_a
        supports = self._seen.support(of_a), self._seen.support(of_b)
        fused = np.asarray(self._parts.fusion.fuse(of_a, of_b, *supports), dtype=np.float64)
        if fused.shape != of_a.shape or not np.isfinite(fused).all():
            raise GeometryError(
                f"The fusion strategy returned centres of shape {fused.shape}, or not finite."
            )
        return fused

    def fall_back_to_g0(self, out: Reconstruction, g0: Reconstruction, painted: float | None) -> Outcome:
        """Return to G0 where the result explains the masks much worse than G0 did.

        Gaussians are judged by what they paint (``painted`` if that is known), a mesh without any by its silhouettes.
        """
        if out is g0:
            return out, None
        if out.gaussians is not None and g0.gaussians is not None:
            judges = largest(self._views)
            now = alpha_iou(out.gaussians, judges, self._parts.renderer) if painted is None else painted
            if now >= 1 - MAX_MASK_LOSS:  # no G0 can be better by that
                return out, None
            was = alpha_iou(g0.gaussians, judges, self._parts.renderer)
        else:
            now, was = self._iou(out), self._iou(g0)
        if not now < was - MAX_MASK_LOSS:
            return out, None
        reason = (
            f"The masks speak against the refinement: IoU {now:.4f}, {was:.4f} as it was. The first "
            "reconstruction is the output."
        )
        return g0, StageReport("output", "fallback", reason, {"mask_iou": now}, {"mask_iou": was})

    def _gated(self, stage: str, obj: Reconstruction, moved: Reconstruction) -> Outcome:
        """``moved`` if it passes the gate; always in paper mode, which has none."""
        (before, faces), (after, _) = outlined(obj), outlined(moved)
        if np.array_equal(before, after):
            return obj, StageReport(stage, "skipped", "There was nothing to move.")
        report = gate_report(stage, before, after, self._views, faces=faces)
        if self._options.mode == "paper":
            report = replace(report, status="applied")
        return (moved if report.status == "applied" else obj), report

    def _iou(self, obj: Reconstruction) -> float:
        points, faces = outlined(obj)
        return symmetric_iou(points, self._views, faces=faces)


NO_PRIOR = "There is no geometry prior."
"""The reason where none was chosen, or the chosen one has no depth for any view."""
THIN_WALLS = 0.75
"""Points that masks need, per pixel of their outlines, above which the object has walls thinner than a voxel."""
MAX_STILL_NEEDED = 0.5
"""Share of these points that a second correction may leave."""


def fuse_evidence(
    estimate: GeometryEstimate, seen: ViewSet, g0: TriangleMesh | None
) -> tuple[DepthEvidence, Posterior]:
    """Correct the prior's depth by the views, and fuse both in one volume.

    Depth that is wrong in one view may cut away points that other views' masks need. A second correction must not place
    depth behind those points; its result is kept where it leaves few of them. Walls thinner than a voxel are cut
    everywhere, however right the depth is: there the first result stays.
    """

    def fused(needed: FloatArray | None) -> tuple[DepthEvidence, Posterior]:
        evidence = gather(estimate, seen, needed)
        return evidence, fuse_volume(seen, evidence, g0)

    first = fused(None)
    needed = first[1].needed
    rim = sum(int(((s.distance > 0) & (s.distance <= 1)).sum()) for s in seen.silhouettes)
    if not 0 < len(needed) < THIN_WALLS * rim:
        return first
    second = fused(needed)
    return second if len(second[1].needed) < MAX_STILL_NEEDED * len(needed) else first


def fuse_prior(
    obj: Reconstruction, seen: ViewSet, prior: GeometryPrior
) -> tuple[Reconstruction, StageReport]:
    """``obj`` with the surface that masks, depth and itself agree on, and its Gaussians on that surface.

    Depth is corrected view by view (:mod:`~gvla2.reconstruction.depth_evidence`), fused with masks and G0 in one
    volume (:mod:`~gvla2.reconstruction.volume`), the surface coloured from the views, and the Gaussians placed on it
    with their attributes. Skipped without a prior; an unusable one is a ``rejected`` stage with its reason.
    """
    estimate = prior.predict(seen.views)
    if estimate is None:
        return obj, StageReport("prior", "skipped", NO_PRIOR)
    try:
        evidence, posterior = fuse_evidence(estimate, seen, obj.mesh)
        if not (posterior.field.values > 0).any():
            raise GeometryError("The prior leaves nothing of the object.")
    except GeometryError as error:
        return obj, StageReport("prior", "rejected", f"{error} The first reconstruction stays.")
    # Depth maps that err leave specks between them.
    field = without_specks(posterior.field, seen.silhouettes)
    mesh, step = surface_of(field), 2 * field.step
    normals = normals_of(field, mesh.vertices)
    depths = depth_maps(mesh, [s.camera for s in seen.silhouettes])
    colours, _ = vertex_colours(mesh, normals, seen.silhouettes, depths, step)
    mesh = replace(mesh, colours=colours)
    gaussians = obj.gaussians
    if gaussians is not None and len(gaussians):
        gaussians = place(gaussians, obj.mesh, mesh, normals)
    measured = float((posterior.confidence > 0).mean())
    report = StageReport("prior", "applied", evidence.summary, {}, {"voxels_measured": measured})
    return replace(obj, gaussians=gaussians, mesh=mesh), report
