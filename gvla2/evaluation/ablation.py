"""The ablation of the reconstruction branch on one object: its rows, the planted drift and the prior's noise.

Carving from calibrated views has no drift of its own; reconstructions of generative models do. Rows made with a planted
drift are labelled as such and never mixed with others.
"""

from __future__ import annotations

import hashlib
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any, cast

import numpy as np
from PIL import Image
from scipy.spatial.transform import Rotation

from gvla2.errors import Gvla2Error
from gvla2.evaluation.metrics import MEASURES, ReconstructionJudge
from gvla2.evaluation.protocol import ObjectViews
from gvla2.evaluation.results import Cell
from gvla2.evaluation.volume_baselines import aligned_tsdf, carved, dressed
from gvla2.geometry.gaussians import Gaussians
from gvla2.geometry.mesh import TriangleMesh
from gvla2.geometry.transform import FloatArray
from gvla2.geometry.views import Views
from gvla2.reconstruction.branch import BranchParts, refine_geometry
from gvla2.reconstruction.contracts import GeometryEstimate, Reconstruction, Reconstructor, Renderer
from gvla2.reconstruction.options import BranchOptions
from gvla2.record.drawing import png

REFERENCE = "baseline"
VARIANTS: Mapping[str, Mapping[str, bool] | None] = MappingProxyType(
    {
        REFERENCE: None,
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
PICTURED = (REFERENCE, "ab_fusion")
"""Rows with pictures in a report: the first target view, with the true view left of the reference's."""
SURFELS = 15_000
"""Gaussians of a plain row where G0 has none."""


def _learned(**errors: float) -> Mapping[str, Any]:
    """A learned prior's errors; those that are not named are zero."""
    none = {
        "global_scale": 0.0, "view_scale": 0.0, "view_shift": 0.0, "low_frequency": 0.0, "slope": 0.0,
        "pose_degrees": 0.0, "pose_shift": 0.0, "edge_blur": 0.0, "outliers": 0.0, "confidence": 0.5,
    }  # fmt: skip
    return {"noise": "learned", "learned": {**none, **errors}}


NOISES: Mapping[str, Mapping[str, Any]] = MappingProxyType(
    {
        "exact": {"noise": "exact"},
        "sensor": {"noise": "sensor"},
        "low0.5": _learned(low_frequency=0.005),
        "low1": _learned(low_frequency=0.01),
        "low2": _learned(low_frequency=0.02),
        "low4": _learned(low_frequency=0.04),
        "view3": _learned(view_scale=0.03),
        "view10": _learned(view_scale=0.10),
        "slope20": _learned(slope=0.20),
        "vggt": {"noise": "learned"},
        "vggt_outliers": _learned(
            global_scale=0.3,
            low_frequency=0.01,
            pose_degrees=1.0,
            pose_shift=0.01,
            edge_blur=1.0,
            outliers=0.03,
        ),
    }
)
"""Errors of the prior's depth by name: options of ``prior=depth``. A sensor is an L515."""


@dataclass(frozen=True)
class DriftSize:
    """How large a drift may be: each is drawn uniformly up to this bound, both ways.

    ``axes``: scale of each axis by itself; ``scale``: of all together; ``degrees``: the turn about a random axis;
    ``shift``: along each axis, as a share of the object's longest side.
    """

    axes: float = 0.0
    scale: float = 0.0
    degrees: float = 0.0
    shift: float = 0.0


DRIFTS: Mapping[str, DriftSize | None] = MappingProxyType(
    {"none": None, "planted": DriftSize(axes=0.04, scale=0.02, degrees=2.0, shift=0.02)}
)
"""The drifts by name; ``planted`` is a Sim(3) and an axis drift at once."""


@dataclass(frozen=True)
class Drift:
    """p' = c + R diag(a) (p - c) + t about an object's centre c.

    ``scale`` a (3,), ``rotation`` R (3, 3), ``shift`` t (3,) for a longest side of 1.
    """

    scale: FloatArray
    rotation: FloatArray
    shift: FloatArray

    @classmethod
    def drawn(cls, size: DriftSize, name: str, seed: int) -> Drift:
        """The drift of an object and a seed; the same everywhere."""
        number = int.from_bytes(hashlib.sha256(name.encode()).digest()[:8], "big")
        rng = np.random.default_rng([number, seed])
        scale = (1 + rng.uniform(-size.axes, size.axes, 3)) * (1 + rng.uniform(-size.scale, size.scale))
        axis = rng.normal(size=3)
        angle = np.radians(rng.uniform(-size.degrees, size.degrees))
        turn = Rotation.from_rotvec(angle * axis / np.linalg.norm(axis))
        return cls(scale, turn.as_matrix(), rng.uniform(-size.shift, size.shift, 3))

    def move(self, points: FloatArray, centre: FloatArray) -> FloatArray:
        """Drifted points (N, 3)."""
        return np.asarray(centre + (points - centre) * self.scale @ self.rotation.T + self.shift)

    def applied(self, g0: Reconstruction) -> Reconstruction:
        """The reconstruction, drifted about the centre of its bounding box: one for Gaussians and mesh.

        Gaussians turn with R and grow by the geometric mean of the scales; their view-dependent colour stays.
        """
        gaussians, mesh = g0.gaussians, g0.mesh
        if gaussians is not None and len(gaussians):
            points = gaussians.centres.astype(np.float64)
        elif mesh is not None and len(mesh.vertices):
            points = mesh.vertices
        else:
            return g0
        centre = 0.5 * (points.min(axis=0) + points.max(axis=0))
        if gaussians is not None and len(gaussians):
            own = Rotation.from_quat(gaussians.rotations.astype(np.float64), scalar_first=True)
            turned = (Rotation.from_matrix(self.rotation) * own).as_quat(scalar_first=True)
            gaussians = replace(
                gaussians.with_centres(self.move(points, centre)),
                log_scales=gaussians.log_scales + np.float32(np.log(self.scale).mean()),
                rotations=turned.astype(np.float32),
            )
        if mesh is not None:
            mesh = mesh.with_vertices(self.move(mesh.vertices, centre))
        return replace(g0, gaussians=gaussians, mesh=mesh)


@dataclass(frozen=True)
class AblationParts(BranchParts):
    """The components that a bench runs with: the branch's, and what makes G0."""

    reconstructor: Reconstructor


@dataclass(frozen=True)
class Wanted:
    """One cell to measure: its key and factors, among them ``drift``, ``noise``, ``variant`` and ``seed``."""

    key: str
    factors: Mapping[str, str | int]

    def failed(self, error: Exception) -> Cell:
        """The cell of a failed measurement."""
        empty = dict.fromkeys((*MEASURES, "seconds"))
        return Cell(self.key, self.factors, empty, {"status": f"failed: {error}"})


def measure_object(
    views: ObjectViews,
    wanted: Sequence[Wanted],
    parts_for: Callable[[int, str], AblationParts],
    judge_for: Callable[[Renderer], ReconstructionJudge],
    options: BranchOptions,
) -> Iterator[tuple[Cell, bytes | None]]:
    """Measure cells of one object and one baseline, in their order, some with a PNG of the first target view.

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
            if id(parts.reconstructor) not in first:
                first[id(parts.reconstructor)] = _reconstruct(parts, views)
            g0, seconds = first[id(parts.reconstructor)]
            size = DRIFTS[drift]
            start = g0 if size is None else Drift.drawn(size, views.name, seed).applied(g0)
            began = time.perf_counter()
            made, notes = _made(variant, start, views.inputs, parts, options)
            if variant != REFERENCE:
                seconds = time.perf_counter() - began
            scores = judge.measure(made)
            if variant in PICTURED and place not in pictured and made.gaussians is not None:
                pictured.add(place)
                picture = _picture(judge, made.gaussians, views, beside_truth=variant == REFERENCE)
        except Gvla2Error as error:
            yield want.failed(error), None
            continue
        measures = {**scores.measures, "seconds": seconds}
        notes = {"status": "ok", "cd_points": scores.cd_points, **notes}
        yield Cell(want.key, want.factors, measures, notes), picture


def _made(
    variant: str, g0: Reconstruction, views: Views, parts: AblationParts, options: BranchOptions
) -> tuple[Reconstruction, dict[str, Any]]:
    """A row's reconstruction, and its notes."""
    switches = VARIANTS[variant]
    if switches is not None:
        chosen = replace(options, **cast(dict[str, Any], switches))
        refined = refine_geometry(g0, views, parts, chosen)
        return refined.out, {"stages": [f"{stage.stage}: {stage.status}" for stage in refined.stages]}
    made = _plain(variant, g0, views, parts) if variant in PLAIN else g0
    return made, {"g0_status": g0.status}


def _plain(variant: str, g0: Reconstruction, views: Views, parts: AblationParts) -> Reconstruction:
    """The result of a plain use of the prior's depth, coloured from the views; G0 without a prior."""
    estimate = parts.prior.predict(views)
    if estimate is None:
        return g0
    mesh = PLAIN[variant](views, estimate)
    if mesh is None:
        raise Gvla2Error("Nothing is left of the object.")
    return dressed(mesh, views, SURFELS if g0.gaussians is None else len(g0.gaussians), parts.renderer)


def _reconstruct(parts: AblationParts, views: ObjectViews) -> tuple[Reconstruction, float]:
    began = time.perf_counter()
    made = parts.reconstructor.reconstruct(views.inputs)
    if made is None:
        raise Gvla2Error("The reconstructor made nothing; choose baselines that reconstruct, such as hull.")
    return made, time.perf_counter() - began


def _picture(
    judge: ReconstructionJudge, gaussians: Gaussians, views: ObjectViews, *, beside_truth: bool
) -> bytes:
    """PNG of the first target view as rendered, to the right of the true view if asked for."""
    picture = np.rint(255 * judge.pictures(gaussians, 1)[0]).astype(np.uint8)
    if beside_truth:
        picture = np.hstack([views.targets[0].image, picture])
    return png(Image.fromarray(picture))
