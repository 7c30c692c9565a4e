"""The fit of a reconstruction to its input views, held-out views and a true mesh, before and after the branch."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gvla2.errors import GeometryError, MissingDependencyError
from gvla2.evaluation import metrics
from gvla2.evaluation.metrics import ReconstructionJudge
from gvla2.evaluation.protocol import ObjectViews
from gvla2.geometry.gaussians import Gaussians
from gvla2.geometry.mesh import TriangleMesh
from gvla2.geometry.views import View, Views
from gvla2.reconstruction.branch import BranchResult
from gvla2.reconstruction.contracts import Reconstruction, Renderer
from gvla2.reconstruction.silhouette import silhouettes
from gvla2.reconstruction.support import mask_of, mask_support
from gvla2.reconstruction.surfels import surfels
from gvla2.reconstruction.view_set import outlined

Floats = NDArray[np.float32]


@dataclass(frozen=True)
class ViewFit:
    """One input view against the reconstruction.

    ``image`` (H, W, 3) is rendered; ``silhouette`` (H, W) bool. ``missed`` counts mask pixels outside the silhouette,
    ``excess`` silhouette pixels beyond the mask; ``iou`` is NaN for an empty mask. ``psnr`` in dB is against the
    picture laid on white by its mask.
    """

    image: Floats
    silhouette: NDArray[np.bool_]
    iou: float
    missed: int
    excess: int
    psnr: float


@dataclass(frozen=True)
class ReconstructionFit:
    """A reconstruction against all input views; ``support`` is the mean s(p) of the drawn ``gaussians``."""

    gaussians: Gaussians
    support: float
    views: tuple[ViewFit, ...]

    def numbers(self) -> dict[str, float]:
        """The means over views, except those with an empty mask, and over points."""
        return {
            "symmetric_iou": _mean([view.iou for view in self.views]),
            "mask_support": self.support,
            "psnr": _mean([view.psnr for view in self.views]),
        }


@dataclass(frozen=True)
class Measures:
    """Before and after the branch: ``before`` and ``after`` in detail, and all numbers by group and name.

    ``groups``: ``inputs`` (the fit to the input views: not a measure of quality), ``held_out`` (PSNR, SSIM, LPIPS in
    unused views) and ``truth`` (Chamfer distances x 1000); each (before, after). ``unmeasured`` says why a number is
    missing, by its name.
    """

    before: ReconstructionFit
    after: ReconstructionFit
    groups: Mapping[str, tuple[Mapping[str, float], Mapping[str, float]]]
    held_out: tuple[str, ...] = ()
    unmeasured: Mapping[str, str] = field(default_factory=dict)

    def summary(self) -> dict[str, Any]:
        """Plain numbers; a group that was not measured is None."""
        ends = ("before", "after")
        measured = {
            group: dict(zip(ends, map(dict, pair), strict=True)) for group, pair in self.groups.items()
        }
        groups = {group: measured.get(group) for group in ("inputs", "held_out", "truth")}
        return {**groups, "held_out_views": list(self.held_out), "unmeasured": dict(self.unmeasured)}


def measure(
    result: BranchResult,
    views: Views,
    renderer: Renderer,
    held_out: Views | None = None,
    truth: TriangleMesh | None = None,
) -> Measures:
    """Everything that can be measured of a branch's first and last reconstruction.

    ``truth`` lies in the views' frame. Raises :class:`GeometryError` if the renderer refuses the geometry.
    """
    ends = (result.g0, result.out)
    before, after = (fit(end, views, renderer) for end in ends)
    groups: dict[str, tuple[Mapping[str, float], Mapping[str, float]]] = {
        "inputs": (before.numbers(), after.numbers())
    }
    if held_out is None and truth is None:
        return Measures(before, after, groups)
    targets = views if held_out is None else held_out
    judge, why = _judge(ObjectViews("", views, _on_white(targets), truth), renderer)
    pair = [judge.measure(replace(end, gaussians=drawable(end))).measures for end in ends]
    for group, named, asked in (
        ("held_out", ("psnr", "ssim", "lpips"), held_out),
        ("truth", ("cd_surface", "cd_official"), truth),
    ):
        if asked is not None:
            kept = [{n: v for n in named if (v := numbers.get(n)) is not None} for numbers in pair]
            groups[group] = kept[0], kept[1]
    names = () if held_out is None else tuple(view.name for view in held_out)
    return Measures(before, after, groups, names, {"lpips": why} if why and names else {})


def fit(made: Reconstruction, views: Views, renderer: Renderer) -> ReconstructionFit:
    """A reconstruction against the input views; silhouettes are the mesh's, as in the branch, else the Gaussians'."""
    gaussians = drawable(made)
    points, faces = outlined(made)
    rows = []
    for view, silhouette in zip(views, silhouettes(points, views, faces=faces), strict=True):
        image, mask = renderer.render(gaussians, view.camera)[0], mask_of(view) > 0.5
        missed, excess = int((mask & ~silhouette).sum()), int((silhouette & ~mask).sum())
        iou = psnr = float("nan")
        if mask.any():
            union = int((mask | silhouette).sum())
            iou, psnr = (union - missed - excess) / union, metrics.psnr(image, on_white(view))
        rows.append(ViewFit(image, silhouette, iou, missed, excess, psnr))
    support = float(mask_support(gaussians.centres, views).mean())
    return ReconstructionFit(gaussians, support, tuple(rows))


def drawable(made: Reconstruction) -> Gaussians:
    """The drawable form: the Gaussians, or flat ones on the mesh."""
    if made.gaussians is not None and len(made.gaussians):
        return made.gaussians
    if made.mesh is None:
        raise GeometryError("The reconstruction is empty: there is nothing to draw.")
    return surfels(made.mesh)


def on_white(view: View) -> Floats:
    """The picture (H, W, 3) in [0, 1] white outside the mask, like renders."""
    image = view.image.astype(np.float32) / np.float32(255)
    if view.mask is None:
        return image
    # Inside a soft edge the picture already has a background; only pixels beyond the mask are replaced.
    return np.asarray(np.where(view.mask[..., None] > 0, image, np.float32(1.0)))


def _on_white(views: Views) -> Views:
    """The views laid on white by their masks."""
    return Views(tuple(replace(v, image=np.rint(255 * on_white(v)).astype(np.uint8)) for v in views))


def _judge(views: ObjectViews, renderer: Renderer) -> tuple[ReconstructionJudge, str]:
    """The judge of a bench, with LPIPS if it can be measured, else the reason why not."""
    from gvla2.evaluation.lpips import Lpips

    try:
        return ReconstructionJudge(views, renderer, Lpips()), ""
    except (MissingDependencyError, GeometryError) as error:
        return ReconstructionJudge(views, renderer), str(error)


def _mean(values: Sequence[float]) -> float:
    known = [value for value in values if np.isfinite(value)]
    return float(np.mean(known)) if known else float("nan")
