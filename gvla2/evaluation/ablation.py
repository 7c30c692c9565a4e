"""The reconstruction suite: the rows of the ablation, measured on one object."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any, cast

import numpy as np
from PIL import Image

from gvla2.errors import Gvla2Error
from gvla2.evaluation.drift import DRIFTS, Drift
from gvla2.evaluation.judge import MEASURES, ReconstructionJudge
from gvla2.evaluation.protocol import ObjectViews
from gvla2.evaluation.results import Cell
from gvla2.evaluation.volume_baselines import aligned_tsdf, carved, dressed
from gvla2.geometry.mesh import TriangleMesh
from gvla2.geometry.views import Views
from gvla2.reconstruction.branch import BranchParts, refine_geometry
from gvla2.reconstruction.contracts import GeometryEstimate, Reconstruction, Reconstructor, Renderer
from gvla2.reconstruction.options import BranchOptions
from gvla2.record.drawing import png

SUITE = "reconstruction"
REFERENCE = "baseline"

VARIANTS: Mapping[str, Mapping[str, bool] | None] = MappingProxyType(
    {
        "baseline": None,
        "carving": None,
        "aligned_tsdf": None,
        "a_prior_appearance": {"soft_hull": False, "axis": False, "fusion": False},
        "a_soft_hull": {"axis": False, "fusion": False},
        "b_axis": {"prior": False, "appearance": False, "soft_hull": False, "fusion": False},
        "ab_fusion": {},
    }
)
"""The rows by name, with the stages that each disables; None means no branch: G0 itself, or a plain use of depth."""

PLAIN: Mapping[str, Callable[[Views, GeometryEstimate], TriangleMesh | None]] = MappingProxyType(
    {"carving": carved, "aligned_tsdf": aligned_tsdf}
)
"""Rows that use the branch's prior without the branch."""

PICTURED = ("baseline", "ab_fusion")
"""Rows with pictures in a report: the first target view, with the true view left of the reference's."""


@dataclass(frozen=True)
class AblationParts(BranchParts):
    """The components that a bench runs with: the branch's, and what makes G0."""

    reconstructor: Reconstructor


@dataclass(frozen=True)
class Wanted:
    """One cell to measure: its key and factors, among them ``drift``, ``variant`` and ``seed``."""

    key: str
    factors: Mapping[str, str | int]


@dataclass(frozen=True)
class Measured:
    """A measured cell; ``picture`` is a PNG of its first target view, if requested."""

    cell: Cell
    picture: bytes | None = None


def measure_object(
    views: ObjectViews,
    wanted: Sequence[Wanted],
    parts_for: Callable[[int, str], AblationParts],
    judge_for: Callable[[Renderer], ReconstructionJudge],
    options: BranchOptions,
) -> Iterator[Measured]:
    """Measure cells of one object and one baseline, in their order.

    ``parts_for(seed, noise)`` gives the components for a seed and a prior's noise; a reconstructor object shared by two
    of them is run once. The baseline row's seconds are the reconstruction's; any other row's are only its own. A
    :class:`Gvla2Error` becomes the cell's ``status``, with no measures.
    """
    judge: ReconstructionJudge | None = None
    first: dict[int, tuple[Reconstruction, float]] = {}
    pictured: set[tuple[str, ...]] = set()
    for want in wanted:
        drift, noise, variant = place = tuple(
            str(want.factors[name]) for name in ("drift", "noise", "variant")
        )
        seed, picture = int(want.factors["seed"]), None
        try:
            parts = parts_for(seed, noise)
            judge = judge or judge_for(parts.renderer)
            name = id(parts.reconstructor)
            if name not in first:
                first[name] = _reconstruct(parts, views)
            g0, seconds = first[name]
            size = DRIFTS[drift]
            start = g0 if size is None else Drift.drawn(size, views.name, seed).applied(g0)
            began = time.perf_counter()
            thing, notes = _made(variant, start, views.inputs, parts, options)
            if variant != REFERENCE:
                seconds = time.perf_counter() - began
            verdict = judge.measure(thing)
            if variant in PICTURED and place not in pictured and thing.gaussians is not None:
                pictured.add(place)
                picture = _png(judge.pictures(thing.gaussians, 1)[0], views if variant == REFERENCE else None)
        except Gvla2Error as error:
            yield Measured(failed(want, error))
            continue
        measures = {**verdict.measures, "seconds": seconds}
        told = {"status": "ok", "cd_points": verdict.cd_points, **notes}
        yield Measured(Cell(want.key, want.factors, measures, told), picture)


def _made(
    variant: str, g0: Reconstruction, views: Views, parts: AblationParts, options: BranchOptions
) -> tuple[Reconstruction, dict[str, Any]]:
    """A row's reconstruction, and its notes."""
    switches = VARIANTS[variant]
    if switches is not None:
        chosen = replace(options, **cast(dict[str, Any], switches))
        refined = refine_geometry(g0, views, parts, chosen)
        return refined.out, {"stages": [f"{stage.stage}: {stage.status}" for stage in refined.stages]}
    thing = _plain(variant, g0, views, parts) if variant in PLAIN else g0
    return thing, {"g0_status": g0.status}


def _plain(variant: str, g0: Reconstruction, views: Views, parts: AblationParts) -> Reconstruction:
    """The result of a plain use of the prior's depth, coloured from the views; G0 without a prior."""
    estimate = parts.prior.predict(views)
    if estimate is None:
        return g0
    mesh = PLAIN[variant](views, estimate)
    if mesh is None:
        raise Gvla2Error("Nothing is left of the object.")
    return dressed(mesh, views, 15_000 if g0.gaussians is None else len(g0.gaussians), parts.renderer)


def failed(want: Wanted, error: Exception) -> Cell:
    """The cell of a failed measurement."""
    return Cell(want.key, want.factors, dict.fromkeys((*MEASURES, "seconds")), {"status": f"failed: {error}"})


def _reconstruct(parts: AblationParts, views: ObjectViews) -> tuple[Reconstruction, float]:
    began = time.perf_counter()
    made = parts.reconstructor.reconstruct(views.inputs)
    if made is None:
        raise Gvla2Error("The reconstructor made nothing; choose baselines that reconstruct, such as hull.")
    return made, time.perf_counter() - began


def _png(image: np.ndarray, truth: ObjectViews | None) -> bytes:
    """PNG of a render in [0, 1], to the right of the true view if one is given."""
    picture = np.rint(255 * image).astype(np.uint8)
    if truth is not None:
        picture = np.hstack([truth.targets[0].image, picture])
    return png(Image.fromarray(picture))
