"""The GeoFuse-MV3D branch, top to bottom: two geometry sources, checked against the views, and their fusion.

    views (I, M, K, T) + G0 --+-> source A: prior -> appearance affine -> soft visual hull --+
                              +-> source B: axis compensation (no prior) --------------------+-> fusion -> out

Each stage reports what it did and why; a stage that the views speak against is undone.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from gvla2.errors import GeometryError
from gvla2.geometry.transform import FloatArray
from gvla2.geometry.views import Views
from gvla2.reconstruction.colour_calibration import calibrate_colours
from gvla2.reconstruction.contracts import (
    AxisCompensation,
    FusionStrategy,
    GeometryPrior,
    Reconstruction,
    Renderer,
    StageReport,
)
from gvla2.reconstruction.gate import accept
from gvla2.reconstruction.inset import alpha_iou, inset, largest
from gvla2.reconstruction.prior_fusion import fuse_prior
from gvla2.reconstruction.silhouette import symmetric_iou
from gvla2.reconstruction.things import (
    both_moved,
    dense_points,
    mismatch,
    outlined,
    points_of,
)
from gvla2.reconstruction.view_set import ViewSet
from gvla2.reconstruction.visual_hull import object_centre, released_centre, soft_hull

CLEARLY = 0.005
"""A difference of symmetric IoU that decides between two sources."""
MUCH = 0.06
"""A loss of agreement with the masks, against G0, that undoes everything: a safety net. A carved hull fits its masks
to the pixel, and a truer shape than it may well fit them less: a bowl's thin wall by .044."""


@dataclass(frozen=True)
class BranchOptions:
    """Which stages run, and how; each switch is one column of the ablation.

    ``mode``: ``paper`` puts source B beside A, both from G0, without gates; ``default`` sets a drift right first,
    carries on from A, keeps a stage only where the masks do not speak against it, and at last puts the Gaussians as far
    inside their surface as the masks say (a part of ``appearance``). ``compat="official"`` reproduces the released
    code's sampling of masks and its centre of the shrink. ``tau``, ``eta``, ``lambda_max``: the soft hull's (released
    constants).
    """

    prior: bool = True
    appearance: bool = True
    soft_hull: bool = True
    axis: bool = True
    fusion: bool = True
    mode: Literal["default", "paper"] = "default"
    compat: Literal["none", "official"] = "none"
    tau: float = 0.45
    eta: float = 0.12
    lambda_max: float = 0.008


@dataclass(frozen=True)
class BranchParts:
    """The components that the branch is made of."""

    prior: GeometryPrior
    axis: AxisCompensation
    fusion: FusionStrategy
    renderer: Renderer


@dataclass(frozen=True)
class BranchResult:
    """The branch's sources and its output; ``stages`` in the order they ran."""

    g0: Reconstruction
    a: Reconstruction
    b: Reconstruction
    out: Reconstruction
    stages: tuple[StageReport, ...]


def refine_geometry(
    g0: Reconstruction, views: Views, parts: BranchParts, options: BranchOptions = BranchOptions()
) -> BranchResult:
    """Refine an object's first reconstruction by the views' masks, a geometry prior and a fusion of two sources.

    ``views`` need masks. Raises :class:`GeometryError` when G0 holds no points or a view has no mask; whatever
    else goes wrong becomes a typed status of a stage, and that stage's input is kept.
    """
    branch = _Branch(ViewSet(views, options.compat), parts, options)
    points_of(g0)
    thing = g0
    paper = options.mode == "paper"
    # Carving has no drift, generated objects do; a prior would mend the seen sides alone, and tear them.
    if not paper:
        thing = branch.compensated(thing, "drift")
    # Source A: G0 -> x_A, theta_A.
    if options.prior:
        thing = branch.with_prior(thing)
    if options.appearance:
        thing = branch.recoloured(thing)  # (g, b) = argmin |g I^ + b - I|_M + beta (g - 1)^2 + beta b^2
    if options.soft_hull:
        thing = branch.shrunk(thing)  # p' = c + (p - c)(1 - lambda(p))
    a = thing
    # Source B: p'' = c + (p' - c) * a + delta; carrying on from A keeps what A has mended.
    b = branch.compensated(g0 if paper else a, "axis")
    out = branch.fused(a, b)  # x_out = x_A + alpha w (x_B - x_A), theta_out = theta_A
    if not paper:
        out = branch.better(out, b)
        painted = None
        if options.appearance:
            out, report = inset(out, views, parts.renderer)
            measures = report.after if report.status == "applied" else report.before
            out, painted = branch.told(out, report), measures.get("alpha_iou")
        out = branch.unless_refuted(out, g0, painted)
    return BranchResult(g0, a, b, out, tuple(branch.stages))


class _Branch:
    """The stages, each from one reconstruction to the next; ``stages`` gathers their reports."""

    def __init__(self, seen: ViewSet, parts: BranchParts, options: BranchOptions) -> None:
        self._seen, self._views, self._parts, self._options = seen, seen.views, parts, options
        self.stages: list[StageReport] = []

    def told(self, thing: Reconstruction, report: StageReport) -> Reconstruction:
        """Note a stage's report."""
        self.stages.append(report)
        return thing

    def with_prior(self, thing: Reconstruction) -> Reconstruction:
        return self.told(*fuse_prior(thing, self._seen, self._parts.prior))

    def recoloured(self, thing: Reconstruction) -> Reconstruction:
        return self.told(*calibrate_colours(thing, self._views, self._parts.renderer))

    def shrunk(self, thing: Reconstruction) -> Reconstruction:
        """The soft visual hull: points of low mask support move a little inwards."""
        began = time.perf_counter()
        o = self._options

        def move(points: FloatArray) -> FloatArray:
            # The released code takes a centre for each file, ours is one for Gaussians and mesh alike.
            c = released_centre(points) if o.compat == "official" else object_centre(points_of(thing))
            return soft_hull(points, self._seen.support(points), c, o.tau, o.eta, o.lambda_max)

        return self._gated("soft_hull", thing, both_moved(thing, move), began)

    def compensated(self, thing: Reconstruction, stage: str) -> Reconstruction:
        """Axis compensation, from masks and poses alone."""
        if not self._options.axis:
            return self.told(thing, StageReport(stage, "skipped", "Source B is switched off."))
        began = time.perf_counter()
        fit = self._parts.axis.compensate(dense_points(thing), self._views, object_centre(points_of(thing)))
        measures = {"iou": fit.iou_before}, {"iou": fit.iou_after}
        status: Literal["applied", "rejected"] = "applied" if fit.accepted else "rejected"
        report = StageReport(stage, status, fit.reason, *measures, time.perf_counter() - began)
        return self.told(both_moved(thing, fit.apply) if fit.accepted else thing, report)

    def fused(self, a: Reconstruction, b: Reconstruction) -> Reconstruction:
        """Fuse x_A and x_B by the strategy, w from s(x_A) and s(x_B). Falls back to A when they do not match."""
        began = time.perf_counter()
        o = self._options
        if not o.fusion:
            kept, which = (b, "B") if o.axis and not (o.prior or o.soft_hull) else (a, "A")
            return self.told(
                kept, StageReport("fusion", "skipped", f"Switched off: source {which} is the output.")
            )
        reason = mismatch(a, b)
        if reason:
            return self.told(a, StageReport("fusion", "fallback", f"{reason} Source A is the output."))
        gaussians, mesh = a.gaussians, a.mesh
        try:
            if gaussians is not None and b.gaussians is not None:
                centres = self._fuse(gaussians.centres, b.gaussians.centres)
                gaussians = gaussians.with_centres(centres)
            if mesh is not None and b.mesh is not None:
                mesh = mesh.with_vertices(self._fuse(mesh.vertices, b.mesh.vertices))
        except GeometryError as error:
            return self.told(a, StageReport("fusion", "fallback", f"{error} Source A is the output."))
        return self._gated("fusion", a, replace(a, gaussians=gaussians, mesh=mesh), began)

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

    def better(self, out: Reconstruction, b: Reconstruction) -> Reconstruction:
        """Source B, where it explains the masks clearly better than the fused geometry does."""
        if not (self._options.fusion and self._options.axis) or mismatch(out, b) or out is b:
            return out
        began = time.perf_counter()
        iou, iou_b = self._iou(out), self._iou(b)
        if not iou_b > iou + CLEARLY:
            return out
        reason = f"Source B explains the masks better than the fusion: IoU {iou_b:.4f} against {iou:.4f}."
        measures = {"symmetric_iou": iou}, {"symmetric_iou": iou_b}
        report = StageReport("output", "fallback", reason, *measures, time.perf_counter() - began)
        return self.told(replace(b, gaussians=b.gaussians, mesh=b.mesh, status=out.status), report)

    def unless_refuted(
        self, out: Reconstruction, g0: Reconstruction, painted: float | None
    ) -> Reconstruction:
        """The last word of the input views: what explains the masks much worse than G0 did is not kept at all.

        Gaussians are judged by what they paint (``painted`` if that is known), a mesh without any by its silhouettes.
        """
        if out is g0:
            return out
        began = time.perf_counter()
        if out.gaussians is not None and g0.gaussians is not None:
            judges = largest(self._views)
            now = alpha_iou(out.gaussians, judges, self._parts.renderer) if painted is None else painted
            if now >= 1 - MUCH:  # no G0 can be so much better
                return out
            was = alpha_iou(g0.gaussians, judges, self._parts.renderer)
        else:
            now, was = self._iou(out), self._iou(g0)
        if not now < was - MUCH:
            return out
        reason = (
            f"The masks speak against the refinement: IoU {now:.4f}, {was:.4f} as it was. G0 is the output."
        )
        measures = {"mask_iou": now}, {"mask_iou": was}
        return self.told(
            g0, StageReport("output", "fallback", reason, *measures, time.perf_counter() - began)
        )

    def _gated(
        self, stage: str, thing: Reconstruction, moved: Reconstruction, began: float
    ) -> Reconstruction:
        """``moved`` where the views do not speak against it; always in paper mode, which has no gate."""
        (before, faces), (after, _) = outlined(thing), outlined(moved)
        if np.array_equal(before, after):
            report = StageReport(
                stage, "skipped", "Nothing was to be moved.", seconds=time.perf_counter() - began
            )
            return self.told(thing, report)
        gate = accept(before, after, self._views, faces=faces)
        kept = gate.accepted or self._options.mode == "paper"
        status: Literal["applied", "rejected"] = "applied" if kept else "rejected"
        seconds = time.perf_counter() - began
        report = StageReport(stage, status, gate.reason, gate.before, gate.after, seconds)
        return self.told(moved if kept else thing, report)

    def _iou(self, thing: Reconstruction) -> float:
        points, faces = outlined(thing)
        return symmetric_iou(points, self._views, faces=faces)
