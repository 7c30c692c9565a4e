"""The GeoFuse-MV3D branch: two geometry sources, checked against the views, and a geometry-only fusion.

    views (I, M, K, T) + G0 --+-> source A: prior guidance -> appearance affine -> soft visual hull --+
                              +-> source B: axis compensation (no prior) ----------------------------+-> fusion -> out

Only x, y, z of Gaussian centres and mesh vertices change (and, in source A, one global affine of the base colours).
Each stage reports what it did and why; a stage that the views speak against is undone.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from gvla2.errors import GeometryError
from gvla2.geometry.gaussians import Gaussians
from gvla2.geometry.mesh import Mesh
from gvla2.geometry.transform import FloatArray
from gvla2.geometry.views import Views
from gvla2.reconstruction.contracts import (
    FusionStrategy,
    GeometryPrior,
    Reconstruction,
    Renderer,
    StageReport,
)

Move = Callable[[FloatArray], FloatArray]
"""Takes points (N, 3) of the object to where a stage puts them; serves Gaussians and mesh alike."""


@dataclass(frozen=True)
class BranchOptions:
    """Which stages run, and how; each switch is one column of the ablation.

    ``mode``: ``paper`` follows the published formulas to the letter, ``default`` takes the better ones: an axis
    compensation on silhouette contours, applied after source A instead of beside it, and gates on every stage.
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
    a = _source_a(g0, views, prior, renderer, options)
    b = _source_b(_Source(g0), views, options)
    out, fused = _fuse(a.state, b, views, fusion, options)
    return BranchResult(g0, a.state, b.state, out, (*a.stages, *b.stages, *fused))


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
    return 0.5 * (points.min(axis=0) + points.max(axis=0))
