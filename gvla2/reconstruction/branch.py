"""The GeoFuse-MV3D branch: two geometry sources, checked against the views, and a geometry-only fusion.

    views (I, M, K, T) + G0 --+-> source A: prior guidance -> appearance affine -> soft visual hull --+
                              +-> source B: axis compensation (no prior) ----------------------------+-> fusion -> out

Only x, y, z of Gaussian centres and mesh vertices change (and, in source A, one global affine of the base colours).
Each stage reports what it did and why; a stage that the views speak against is undone.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from gvla2.errors import GeometryError
from gvla2.geometry.gaussians import Gaussians
from gvla2.geometry.mesh import Mesh
from gvla2.geometry.transform import FloatArray
from gvla2.geometry.views import Views
from gvla2.reconstruction.axis import AxisOptions, compensate
from gvla2.reconstruction.colour_calibration import calibrate_colours
from gvla2.reconstruction.contracts import (
    FusionStrategy,
    GeometryPrior,
    Reconstruction,
    Renderer,
    StageReport,
)
from gvla2.reconstruction.gate import accept
from gvla2.reconstruction.guidance import guide
from gvla2.reconstruction.rim import Shell, alpha_iou, inset, largest
from gvla2.reconstruction.silhouette import symmetric_iou
from gvla2.reconstruction.support import mask_support
from gvla2.reconstruction.visual_hull import soft_hull

Move = Callable[[FloatArray], FloatArray]
"""Takes points (N, 3) of the object to where a stage puts them; serves Gaussians and mesh alike."""


@dataclass(frozen=True)
class BranchOptions:
    """Which stages run, and how; each switch is one column of the ablation.

    ``mode``: ``paper`` follows the published formulas to the letter, ``default`` takes the better ones: an axis
    compensation on silhouette contours, applied after source A instead of beside it, gates on every stage, and at
    last the Gaussians as far inside their surface as the masks say (a part of ``appearance``).
    ``compat="official"`` reproduces the released code's sampling of masks. ``tau``, ``eta``, ``lambda_max``: the soft
    hull's (released constants).
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
class BranchResult:
    """The branch's sources and its output; ``stages`` in the order they ran."""

    g0: Reconstruction
    a: Reconstruction
    b: Reconstruction
    out: Reconstruction
    stages: tuple[StageReport, ...]


@dataclass(frozen=True)
class _Source:
    """A reconstruction under way and the reports of its stages."""

    state: Reconstruction
    stages: tuple[StageReport, ...] = ()

    def after(self, state: Reconstruction, report: StageReport) -> _Source:
        return _Source(state, (*self.stages, report))


def refine_geometry(
    g0: Reconstruction,
    views: Views,
    prior: GeometryPrior,
    fusion: FusionStrategy,
    renderer: Renderer,
    options: BranchOptions = BranchOptions(),
) -> BranchResult:
    """Refine an object's first reconstruction by the views' masks, a geometry prior and a fusion of two sources.

    ``views`` need masks. Raises :class:`GeometryError` when G0 holds no points or no view has a mask; whatever
    else goes wrong becomes a typed status of a stage, and that stage's input is kept.
    """
    if any(view.mask is None for view in views):
        raise GeometryError("The branch checks geometry against masks: give every view one.")
    _points(g0)
    start = _Source(g0)
    if options.mode == "default":
        # A drift of the whole object is set right first: a prior moves the seen sides alone, and would tear it.
        start = _source_b(start, views, options, "drift")
    a = _source_a(start, views, prior, renderer, options)
    # The published branch puts source B beside A, both from G0; carrying on from A keeps what A has mended.
    b = _source_b(_Source(g0 if options.mode == "paper" else a.state), views, options)
    out = _fused(a.state, b.state, views, fusion, options)
    if options.mode == "default":
        if options.fusion and options.axis:
            out = _better(out, b.state, views)
        if options.appearance:
            out = out.after(*inset(out.state, views, renderer))
        out = _unless_refuted(out, g0, views, renderer)
    return BranchResult(g0, a.state, b.state, out.state, (*a.stages, *b.stages, *out.stages))


def _source_a(
    source: _Source, views: Views, prior: GeometryPrior, renderer: Renderer, options: BranchOptions
) -> _Source:
    """Prior guidance, appearance affine, soft visual hull."""
    if options.prior:
        source = _guided(source, views, prior)
    if options.appearance:
        source = source.after(*calibrate_colours(source.state, views, renderer))
    if options.soft_hull:
        source = _shrunk(source, views, options)
    return source


def _guided(source: _Source, views: Views, prior: GeometryPrior) -> _Source:
    estimate = prior.predict(views)
    if estimate is None:
        return source.after(source.state, StageReport("prior", "skipped", "There is no geometry prior."))
    thing, shell = source.state, _shell(source.state)
    guided = guide(_points(thing) if shell is None else shell.feet, views, estimate)
    if guided.report.status not in ("applied", "partial"):
        return source.after(thing, guided.report)
    if shell is None or thing.gaussians is None or thing.mesh is None:
        return source.after(_moved(thing, guided.move), guided.report)
    # Centres lie inside the surface that they paint; it's the surface that the prior sees.
    centres = guided.points + shell.heights[:, None] * shell.normals
    moved = replace(
        thing,
        gaussians=thing.gaussians.with_centres(centres),
        mesh=thing.mesh.with_vertices(guided.move(thing.mesh.vertices)),
    )
    return source.after(moved, guided.report)


def _shell(thing: Reconstruction) -> Shell | None:
    """The Gaussians over their mesh; None where there is one of the two alone."""
    if thing.gaussians is None or thing.mesh is None or not len(thing.gaussians) or not len(thing.mesh.faces):
        return None
    return Shell.of(_double(thing.gaussians.centres), thing.mesh)


def _shrunk(source: _Source, views: Views, options: BranchOptions) -> _Source:
    """Points of low mask support move a little inwards: p' = c + (p - c)(1 - lambda(p))."""
    began = time.perf_counter()
    centre = object_centre(source.state)

    def move(points: FloatArray) -> FloatArray:
        support = mask_support(points, views, compat=options.compat)
        return soft_hull(points, support, centre, options.tau, options.eta, options.lambda_max)

    return _gated("soft_hull", source, _moved(source.state, move), views, options, began)


def _source_b(source: _Source, views: Views, options: BranchOptions, stage: str = "axis") -> _Source:
    """Axis compensation p'' = c + (p - c) * a + delta, from masks and poses alone."""
    if not options.axis:
        return source.after(source.state, StageReport(stage, "skipped", "Source B is switched off."))
    began = time.perf_counter()
    fit = compensate(_dense(source.state), views, object_centre(source.state), AxisOptions(mode=options.mode))
    measures = {"iou": fit.iou_before}, {"iou": fit.iou_after}
    seconds = time.perf_counter() - began
    if not fit.accepted:
        return source.after(source.state, StageReport(stage, "rejected", fit.reason, *measures, seconds))
    report = StageReport(stage, "applied", fit.reason, *measures, seconds)
    return source.after(_moved(source.state, fit.apply), report)


def _fused(
    a: Reconstruction, b: Reconstruction, views: Views, fusion: FusionStrategy, options: BranchOptions
) -> _Source:
    """Fuse x_A and x_B by the strategy; theta_out = theta_A. Falls back to A when they do not match."""
    began = time.perf_counter()
    source = _Source(a)
    if not options.fusion:
        kept, which = (b, "B") if options.axis and not (options.prior or options.soft_hull) else (a, "A")
        return _Source(kept).after(
            kept, StageReport("fusion", "skipped", f"Switched off: source {which} is the output.")
        )
    mismatch = _mismatch(a, b)
    if mismatch:
        return source.after(a, StageReport("fusion", "fallback", f"{mismatch} Source A is the output."))

    def fuse(of_a: FloatArray, of_b: FloatArray) -> FloatArray:
        supports = [mask_support(points, views, compat=options.compat) for points in (of_a, of_b)]
        fused = np.asarray(fusion.fuse(of_a, of_b, *supports), dtype=np.float64)
        if fused.shape != of_a.shape or not np.isfinite(fused).all():
            raise GeometryError(
                f"The fusion strategy returned centres of shape {fused.shape}, or not finite ones."
            )
        return fused

    gaussians, mesh = a.gaussians, a.mesh
    try:
        if gaussians is not None and b.gaussians is not None:
            gaussians = gaussians.with_centres(fuse(_double(gaussians.centres), _double(b.gaussians.centres)))
        if mesh is not None and b.mesh is not None:
            mesh = mesh.with_vertices(fuse(mesh.vertices, b.mesh.vertices))
    except GeometryError as error:
        return source.after(a, StageReport("fusion", "fallback", f"{error} Source A is the output."))
    return _gated("fusion", source, replace(a, gaussians=gaussians, mesh=mesh), views, options, began)


def _better(out: _Source, b: Reconstruction, views: Views) -> _Source:
    """Source B, where it explains the masks clearly better than the fused geometry does."""
    began = time.perf_counter()
    iou, iou_b = _iou(out.state, views), _iou(b, views)
    if not iou_b > iou + CLEARLY:
        return out
    reason = f"Source B explains the masks better than the fusion: IoU {iou_b:.4f} against {iou:.4f}."
    measures = {"symmetric_iou": iou}, {"symmetric_iou": iou_b}
    report = StageReport("output", "fallback", reason, *measures, time.perf_counter() - began)
    return out.after(_with_geometry(out.state, b), report)


def _unless_refuted(out: _Source, g0: Reconstruction, views: Views, renderer: Renderer) -> _Source:
    """The last word of the input views: what explains the masks much worse than G0 did is not kept at all.

    Gaussians are judged by what they paint, a mesh without any by its silhouettes.
    """
    began = time.perf_counter()
    if out.state.gaussians is not None and g0.gaussians is not None:
        judges = largest(views)
        now, was = (alpha_iou(thing, judges, renderer) for thing in (out.state.gaussians, g0.gaussians))
    else:
        now, was = _iou(out.state, views), _iou(g0, views)
    if not now < was - MUCH:
        return out
    reason = f"The masks speak against the refinement: IoU {now:.4f}, {was:.4f} as it was. G0 is the output."
    seconds = time.perf_counter() - began
    return out.after(
        g0, StageReport("output", "fallback", reason, {"mask_iou": now}, {"mask_iou": was}, seconds)
    )


CLEARLY = 0.005
"""A difference of symmetric IoU that decides between two sources."""

MUCH = 0.03
"""A loss of agreement with the masks, against G0, that undoes everything. Each stage has its own gate, so this is a
safety net; a carved hull fits its masks to the pixel, and a truer shape than it may well fit them less."""


def _gated(
    stage: str, source: _Source, moved: Reconstruction, views: Views, options: BranchOptions, began: float
) -> _Source:
    """Keep ``moved`` where the views do not speak against it; always in paper mode, which has no gate."""
    (before, faces), (after, _) = _outline(source.state), _outline(moved)
    gate = accept(before, after, views, faces=faces)
    seconds = time.perf_counter() - began
    if gate.accepted or options.mode == "paper":
        return source.after(
            moved, StageReport(stage, "applied", gate.reason, gate.before, gate.after, seconds)
        )
    return source.after(
        source.state, StageReport(stage, "rejected", gate.reason, gate.before, gate.after, seconds)
    )


def _iou(thing: Reconstruction, views: Views) -> float:
    points, faces = _outline(thing)
    return symmetric_iou(points, views, faces=faces)


def _outline(thing: Reconstruction) -> tuple[FloatArray, NDArray[np.int64] | None]:
    """What casts the object's silhouettes: the mesh, which has no gaps, else the Gaussians' centres."""
    if thing.mesh is not None and len(thing.mesh.faces):
        return thing.mesh.vertices, thing.mesh.faces
    return _points(thing), None


def _dense(thing: Reconstruction) -> FloatArray:
    """(N, 3) points so close together that their outline is the object's: samples of the mesh where there is one."""
    if thing.mesh is not None and len(thing.mesh.faces) and thing.mesh.areas.sum() > 0:
        return thing.mesh.sample(DENSE, np.random.default_rng(0))[0]
    return _points(thing)


DENSE = 100_000


def _mismatch(a: Reconstruction, b: Reconstruction) -> str:
    """Why the two cannot be fused point by point, or ""."""
    if (a.gaussians is None) != (b.gaussians is None) or (a.mesh is None) != (b.mesh is None):
        return "One source has Gaussians or a mesh that the other lacks."
    if a.gaussians is not None and b.gaussians is not None and len(a.gaussians) != len(b.gaussians):
        return f"The sources have {len(a.gaussians)} and {len(b.gaussians)} Gaussians."
    if a.mesh is not None and b.mesh is not None and not np.array_equal(a.mesh.faces, b.mesh.faces):
        return "The sources' meshes differ in topology."
    return ""


def _with_geometry(attributes: Reconstruction, geometry: Reconstruction) -> Reconstruction:
    """Everything of ``attributes`` but the positions, which are those of ``geometry``."""
    gaussians, mesh = attributes.gaussians, attributes.mesh
    if gaussians is not None and geometry.gaussians is not None:
        gaussians = gaussians.with_centres(geometry.gaussians.centres)
    if mesh is not None and geometry.mesh is not None:
        mesh = mesh.with_vertices(geometry.mesh.vertices)
    return replace(attributes, gaussians=gaussians, mesh=mesh)


def _double(points: np.ndarray) -> FloatArray:
    return np.array(points, dtype=np.float64)


def _points(thing: Reconstruction) -> FloatArray:
    """The points that stand for the object: Gaussian centres, else mesh vertices, (N, 3)."""
    if thing.gaussians is not None and len(thing.gaussians.centres):
        return np.asarray(thing.gaussians.centres, dtype=np.float64)
    if thing.mesh is not None and len(thing.mesh.vertices):
        return np.asarray(thing.mesh.vertices, dtype=np.float64)
    raise GeometryError("The reconstruction is empty: it has neither Gaussians nor mesh vertices.")


def _moved(thing: Reconstruction, move: Move) -> Reconstruction:
    """The same motion for Gaussians and mesh."""
    gaussians: Gaussians | None = thing.gaussians
    mesh: Mesh | None = thing.mesh
    if gaussians is not None:
        gaussians = gaussians.with_centres(move(np.asarray(gaussians.centres, dtype=np.float64)))
    if mesh is not None:
        mesh = mesh.with_vertices(move(np.asarray(mesh.vertices, dtype=np.float64)))
    return replace(thing, gaussians=gaussians, mesh=mesh)


def object_centre(thing: Reconstruction) -> FloatArray:
    """(3,) centre c of the object's bounding box: one for Gaussians and mesh alike."""
    points = _points(thing)
    return np.asarray(0.5 * (points.min(axis=0) + points.max(axis=0)))
