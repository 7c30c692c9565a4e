"""The fit of a reconstruction to its input views, held-out views and a true mesh, before and after the branch; and the
pictures of it, as files' bytes.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from gvla2.errors import GeometryError
from gvla2.evaluation import metrics
from gvla2.evaluation.metrics import ReconstructionJudge
from gvla2.evaluation.protocol import ObjectViews
from gvla2.geometry.gaussians import Gaussians
from gvla2.geometry.mesh import TriangleMesh
from gvla2.geometry.views import View, Views
from gvla2.io.foreign import png_bytes
from gvla2.reconstruction.branch import BranchResult
from gvla2.reconstruction.contracts import Reconstruction, Renderer
from gvla2.reconstruction.silhouette import silhouettes
from gvla2.reconstruction.support import mask_of
from gvla2.reconstruction.surfels import surfels
from gvla2.reconstruction.view_set import outlined
from gvla2.record.drawing import Colour, Rect, enlarged, part_about

MISSED: Colour = (230, 97, 1)
EXCESS: Colour = (44, 96, 214)
AGREED: Colour = (186, 198, 208)
PAPER = 246
WIDTH = 360
"""Approximate width of a view's pictures in pixels."""
MOST_VIEWS = 12
"""Maximum number of views on the page, spread over all."""

Floats = NDArray[np.float32]


@dataclass(frozen=True)
class ViewFit:
    """One input view against the reconstruction.

    ``image`` (H, W, 3) is rendered; ``silhouette`` (H, W) bool. ``iou`` and ``psnr`` (dB, against the picture laid on
    white by its mask) are NaN for an empty mask.
    """

    image: Floats
    silhouette: NDArray[np.bool_]
    iou: float
    psnr: float


@dataclass(frozen=True)
class ReconstructionFit:
    """A reconstruction against all input views, with its drawn ``gaussians``."""

    gaussians: Gaussians
    views: tuple[ViewFit, ...]

    def numbers(self) -> dict[str, float]:
        """The means over the views, except those with an empty mask."""
        known = [(view.iou, view.psnr) for view in self.views if np.isfinite(view.iou)]
        iou, psnr = np.mean(known, axis=0) if known else (np.nan, np.nan)
        return {"symmetric_iou": float(iou), "psnr": float(psnr)}


@dataclass(frozen=True)
class Measures:
    """Before and after the branch: ``before`` and ``after`` in detail, and all numbers by group and name.

    ``groups``: ``inputs`` (the fit to the input views: not a measure of quality), ``held_out`` (PSNR and SSIM in
    unused views) and ``truth`` (Chamfer distances x 1000); each (before, after).
    """

    before: ReconstructionFit
    after: ReconstructionFit
    groups: Mapping[str, tuple[Mapping[str, float], Mapping[str, float]]]
    held_out: tuple[str, ...] = ()

    def summary(self) -> dict[str, Any]:
        """Plain numbers; a group that was not measured is None."""
        measured = {
            group: {"before": dict(before), "after": dict(after)}
            for group, (before, after) in self.groups.items()
        }
        groups = {group: measured.get(group) for group in ("inputs", "held_out", "truth")}
        return {**groups, "held_out_views": list(self.held_out)}


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
    whitened = Views(tuple(replace(v, image=as_bytes(on_white(v))) for v in targets))
    judge = ReconstructionJudge(ObjectViews("", views, whitened, truth), renderer)
    pair = [judge.measure(replace(end, gaussians=drawable(end)))[0] for end in ends]
    for group, named, asked in (
        ("held_out", ("psnr", "ssim"), held_out),
        ("truth", ("cd_surface", "cd_official"), truth),
    ):
        if asked is not None:
            kept = [{n: v for n in named if (v := numbers.get(n)) is not None} for numbers in pair]
            groups[group] = kept[0], kept[1]
    return Measures(before, after, groups, tuple(view.name for view in held_out or ()))


def fit(made: Reconstruction, views: Views, renderer: Renderer) -> ReconstructionFit:
    """A reconstruction against the input views; silhouettes are the mesh's, as in the branch, else the Gaussians'."""
    gaussians = drawable(made)
    points, faces = outlined(made)
    rows = []
    for view, silhouette in zip(views, silhouettes(points, views, faces=faces), strict=True):
        image, mask = renderer.render(gaussians, view.camera)[0], mask_of(view) > 0.5
        iou = psnr = float("nan")
        if mask.any():
            iou = float((mask & silhouette).sum() / (mask | silhouette).sum())
            psnr = metrics.psnr(image, on_white(view))
        rows.append(ViewFit(image, silhouette, iou, psnr))
    return ReconstructionFit(gaussians, tuple(rows))


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


def as_bytes(image: Floats) -> NDArray[np.uint8]:
    """A picture with values in [0, 1] as uint8."""
    return np.rint(255 * np.clip(image, 0, 1)).astype(np.uint8)


@dataclass(frozen=True)
class ViewPictures:
    """The part of one input view with the object, as PNG files; pairs are (before, after).

    ``index`` is the view's place among the inputs.
    """

    index: int
    name: str
    photo: bytes
    renders: list[bytes]
    residuals: list[bytes]


def view_pictures(views: Views, measures: Measures) -> tuple[ViewPictures, ...]:
    """The pictures of the shown views."""
    count = len(views)
    made = []
    for k in sorted({int(k) for k in np.linspace(0, count - 1, min(count, MOST_VIEWS)).round()}):
        view, fits = views[k], [end.views[k] for end in (measures.before, measures.after)]
        box = part_of(view, [one.silhouette for one in fits])
        shown = ViewPictures(
            k,
            view.name,
            photo=_photograph(on_white(view), box),
            renders=[_photograph(one.image, box) for one in fits],
            residuals=[png_bytes(residual_picture(one.silhouette, view, box)) for one in fits],
        )
        made.append(shown)
    return tuple(made)


def part_of(view: View, shapes: Iterable[NDArray[np.bool_]]) -> Rect:
    """A square part of the image with the mask, the silhouettes and some margin; at least 48 pixels."""
    shown = np.argwhere(np.any([mask_of(view) > 0.5, *shapes], axis=0))[:, ::-1]
    corners = np.concatenate([shown, shown + 1]).astype(np.float64)
    return part_about(corners, (view.camera.width, view.camera.height), grow=1.24, least=48)


def _photograph(image: Floats, box: Rect) -> bytes:
    return png_bytes(enlarged(Image.fromarray(np.ascontiguousarray(as_bytes(image))), WIDTH, box))


def residual_picture(silhouette: NDArray[np.bool_], view: View, box: Rect, width: int = WIDTH) -> Image.Image:
    """Silhouette against mask, pixel by pixel: agreed grey, missed orange, excess blue."""
    mask = mask_of(view) > 0.5
    grey = view.image.astype(np.float32).mean(axis=-1, keepdims=True)
    picture = np.full(view.image.shape, PAPER, dtype=np.float32)
    picture[mask & silhouette] = (0.78 * np.array(AGREED) + 0.22 * grey)[mask & silhouette]
    picture[mask & ~silhouette] = MISSED
    picture[silhouette & ~mask] = EXCESS
    return enlarged(Image.fromarray(picture.astype(np.uint8)), width, box, Image.Resampling.NEAREST)
