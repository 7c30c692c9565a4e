"""An object's colours: per-view affines of appearance, one calibration of base colours, and colours of vertices."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates, minimum_filter
from scipy.spatial import cKDTree

from gvla2.geometry.compiled import fused
from gvla2.geometry.gaussians import SH_C0
from gvla2.geometry.mesh import TriangleMesh
from gvla2.geometry.transform import FloatArray
from gvla2.geometry.views import View, Views
from gvla2.reconstruction.contracts import Reconstruction, Renderer, StageReport
from gvla2.reconstruction.silhouette import Silhouette
from gvla2.reconstruction.support import mask_of

LEAST_PIXELS = 16
"""With fewer masked pixels, nothing is fitted."""
_ROUNDS = 60
_SHARPEST = 1e-5  # residuals below count as zero; a step of an 8-bit image is 4e-3


def fit_affine(
    rendered: NDArray[np.floating], observed: FloatArray, mask: FloatArray, beta: float = 0.01
) -> tuple[FloatArray, FloatArray] | None:
    """The gain (3,) and bias (3,) that minimise the paper's masked L1 with a ridge toward identity.

        sum_u M(u) |g I^(u) + b - I(u)| / sum_u M(u)  +  beta (g - 1)^2 + beta b^2     over M(u) > 0

    ``rendered``, ``observed`` (H, W, 3) in [0, 1]; ``mask`` (H, W) in [0, 1], whose values weigh the pixels. The data
    term is a mean, so that ``beta`` means the same at any resolution (the paper's beta is ours times sum M). Solved by
    iteratively reweighted least squares, 2 x 2 a channel and round. Pixels that are not finite are left out. None for
    fewer than 16 masked pixels, and where a channel's best gain is not positive: the two are not alike.
    """
    used = (mask > 0) & np.isfinite(rendered).all(axis=2) & np.isfinite(observed).all(axis=2)
    if used.sum() < LEAST_PIXELS:
        return None
    share = mask[used] / mask[used].sum()
    x, y = (np.ascontiguousarray(image[used].T, dtype=np.float64) for image in (rendered, observed))
    gain, bias = np.array([_solve(*each, share, beta) for each in zip(x, y, strict=True)]).T
    return (gain, bias) if (gain > 0).all() else None


@fused
def _solve(x: FloatArray, y: FloatArray, share: FloatArray, beta: float) -> tuple[float, float]:
    """The minimum of sum share |g x + b - y| + beta (g - 1)^2 + beta b^2 over (g, b); ``share`` sums to 1."""
    gain, bias = 1.0, 0.0
    sharp = 0.1
    for _ in range(_ROUNDS):
        sxx = sx = s = sxy = sy = 0.0
        for k in range(len(x)):
            w = 0.5 * share[k] / max(abs(gain * x[k] + bias - y[k]), sharp)
            sxx += w * x[k] * x[k]
            sx += w * x[k]
            s += w
            sxy += w * x[k] * y[k]
            sy += w * y[k]
        a, d = sxx + beta, s + beta
        determinant = a * d - sx * sx
        if determinant > 1e-10 * a * d:
            new_gain = (d * (sxy + beta) - sx * sy) / determinant
            new_bias = (a * sy - sx * (sxy + beta)) / determinant
        else:  # a constant render: gain and bias are indistinguishable
            new_gain = 1.0
            new_bias = (sy - sx) / d
        change = max(abs(new_gain - gain), abs(new_bias - bias))
        gain, bias = new_gain, new_bias
        if change < 1e-7 and sharp <= _SHARPEST:
            break
        # Sharpening step by step keeps early rounds from freezing at pixels that happen to fit.
        sharp = max(0.6 * sharp, _SHARPEST)
    return gain, bias


SOLID = 0.9
"""Pixels count where mask and rendered alpha are above this: silhouettes' edges are no evidence of colour."""

LEAST_GAIN = 0.10
"""The mean absolute error must fall by this share, or the colours stay as they are: colours that came from the inputs
themselves always leave a per cent or two to gain, at the cost of the views that nobody saw."""


def calibrate_colours(
    obj: Reconstruction, views: Views, renderer: Renderer
) -> tuple[Reconstruction, StageReport]:
    """The object with its base colours (SH-DC, mesh colours) under the median of the views' affines (g, b).

    Kept only when the renders come nearer to the inputs; geometry, opacity and higher harmonics are untouched.
    """
    if obj.gaussians is None:
        return obj, StageReport("appearance", "skipped", "There are no Gaussians to render.")
    shots = [(view, *renderer.render(obj.gaussians, view.camera)) for view in views]
    fits = [
        fit_affine(rendered, view.image / 255.0, _solid(view, alpha).astype(float))
        for view, rendered, alpha in shots
    ]
    clear = [fit for fit in fits if fit is not None]
    if not clear:
        reason = "No view shows enough of the object to compare colours."
        return obj, StageReport("appearance", "skipped", reason)
    before = float(np.nanmean([_error(*shot) for shot in shots]))
    gain, bias = np.median(clear, axis=0)
    # A picture of solid objects takes the affine as its Gaussians do: what cannot gain so is not rendered again.
    after = float(np.nanmean([_error(view, gain * image + bias, alpha) for view, image, alpha in shots]))
    calibrated = _recoloured(obj, gain, bias)
    if after <= (1 - LEAST_GAIN) * before:
        assert calibrated.gaussians is not None
        painted = ((view, *renderer.render(calibrated.gaussians, view.camera)) for view in views)
        after = float(np.nanmean([_error(*shot) for shot in painted]))
    measures = {"colour_error": before}, {"colour_error": after}
    if after > (1 - LEAST_GAIN) * before:
        reason = "An affine of the colours does not bring the renders nearer to the inputs."
        return obj, StageReport("appearance", "rejected", reason, *measures)
    reason = f"Gain {np.round(gain, 3).tolist()}, bias {np.round(bias, 3).tolist()}."
    return calibrated, StageReport("appearance", "applied", reason, *measures)


def _error(view: View, rendered: np.ndarray, alpha: np.ndarray) -> float:
    solid = _solid(view, alpha)
    error = np.abs(rendered[solid] - view.image[solid] / 255.0)
    return float(error.mean()) if error.size else float("nan")


def _solid(view: View, alpha: np.ndarray) -> np.ndarray:
    return np.asarray((mask_of(view) > SOLID) & (alpha > SOLID))


def _recoloured(obj: Reconstruction, gain: FloatArray, bias: FloatArray) -> Reconstruction:
    assert obj.gaussians is not None
    sh_dc = ((gain * obj.gaussians.rgb + bias - 0.5) / SH_C0).astype(np.float32)
    gaussians, mesh = replace(obj.gaussians, sh_dc=sh_dc), obj.mesh
    if mesh is not None and mesh.colours is not None:
        mesh = replace(mesh, colours=np.clip(gain * mesh.colours + bias, 0.0, 1.0))
    return replace(obj, gaussians=gaussians, mesh=mesh)


_VIEWS = 4  # a vertex listens to this many views at most, those that face it best
SLANT = 0.15
"""Cosine below which a view sees a surface too obliquely to say what is there."""
_SHARPNESS = 3.0  # power of the cosine in a view's weight: the best view leads, blending blurs
_DISAGREEMENT = 0.12  # colour difference at which a view loses half its say
_BESIDE = 0.02  # say of a view whose pixel touches something that stands in front
_NEIGHBOURS = 8


def vertex_colours(
    mesh: TriangleMesh,
    normals: FloatArray,
    silhouettes: Sequence[Silhouette],
    depths: Sequence[NDArray[np.float32]],
    tolerance: float,
) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Colours (V, 3) in [0, 1] and which vertices (V,) some view has seen.

    A view sees a vertex when its depth map of the mesh (one of ``depths`` (H, W), metres, inf for nothing) has
    nothing more than ``tolerance`` (metres) before it, when the surface faces it by ``normals`` (V, 3), and inside
    the mask by most of a pixel, since a silhouette's rim is mixed with the background. Of the views' colours the one
    nearest to all others leads; those that differ from it lose weight. Vertices that no view has seen take the mean
    of the nearest ones that were.
    """
    count = len(mesh.vertices)
    weights = np.zeros((len(silhouettes), count))
    colours = np.zeros((len(silhouettes), count, 3))
    for i, (s, depth) in enumerate(zip(silhouettes, depths, strict=True)):
        weights[i], colours[i] = _look(mesh.vertices, normals, s, depth, tolerance)
    if len(silhouettes) > _VIEWS:
        best = np.argpartition(-weights, _VIEWS - 1, axis=0)[:_VIEWS]
        weights = np.take_along_axis(weights, best, axis=0)
        colours = np.take_along_axis(colours, best[:, :, None], axis=0)
    agreed, seen = _agree(weights, colours)
    if not seen.any():
        # Seen by nobody, for example a mask of a few pixels: the masks' own mean colour is all there is.
        pixels = np.concatenate([s.image[s.inside] for s in silhouettes])
        return np.tile(pixels.mean(axis=0) / 255.0, (count, 1)), seen
    if not seen.all():
        near = min(_NEIGHBOURS, int(seen.sum()))
        gaps, index = cKDTree(mesh.vertices[seen]).query(mesh.vertices[~seen], k=np.arange(1, near + 1))
        share = 1.0 / np.maximum(gaps, 1e-9)
        share /= share.sum(axis=1, keepdims=True)
        agreed[~seen] = np.einsum("nk,nkc->nc", share, agreed[seen][index])
    return np.clip(agreed, 0.0, 1.0), seen


def _look(
    points: FloatArray, normals: FloatArray, s: Silhouette, depth: NDArray[np.float32], tolerance: float
) -> tuple[FloatArray, FloatArray]:
    """One view's weights (V,) and colours (V, 3) in [0, 1] of points (V, 3)."""
    uv, z = s.camera.project(points)
    towards = s.camera.position - points
    towards /= np.maximum(np.linalg.norm(towards, axis=1, keepdims=True), 1e-12)
    facing = np.einsum("ij,ij->i", normals, towards)
    weight, colour = np.zeros(len(points)), np.zeros((len(points), 3))
    index = np.flatnonzero(s.camera.inside(uv) & (facing > SLANT))
    pixel = uv[index].astype(np.intp)
    index = index[z[index] <= depth[pixel[:, 1], pixel[:, 0]] + tolerance]
    rim = np.clip((np.nan_to_num(s.sample(uv[index]), nan=0.0) - 0.75) / 1.5, 0.0, 1.0)
    index, rim = index[rim > 0], rim[rim > 0]
    pixel = uv[index].astype(np.intp)
    beside = minimum_filter(depth, 3)[pixel[:, 1], pixel[:, 0]]
    # Beside the rim of what stands in front, pixels are mixed with it, and the hull's rim is not quite the object's.
    rim = rim * np.where(z[index] <= beside + tolerance, 1.0, _BESIDE)
    weight[index] = rim * facing[index] ** _SHARPNESS
    where = uv[index, ::-1].T - 0.5
    for channel in range(3):
        values = map_coordinates(s.image[:, :, channel].astype(np.float32), where, order=1, mode="nearest")
        colour[index, channel] = values / 255.0
    return weight, colour


def _agree(weights: FloatArray, colours: FloatArray) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Colours (V, 3) that views' colours (S, V, 3) with weights (S, V) agree on, and where there are any (V,)."""
    gaps = np.linalg.norm(colours[:, None] - colours[None, :], axis=-1)  # (S, S, V)
    dissent = np.einsum("jv,ijv->iv", weights, gaps) + np.where(weights > 0, 0.0, np.inf)
    # Among equals, as with two views, the one that sees better leads.
    leader = np.argmin(dissent - 1e-3 * weights, axis=0)
    gap = np.take_along_axis(gaps, leader[None, None, :], axis=0)[0]
    say = weights / (1.0 + (gap / _DISAGREEMENT) ** 2)
    total = say.sum(axis=0)
    mean = np.einsum("sv,svc->vc", say, colours) / np.maximum(total, 1e-12)[:, None]
    return mean, total > 0
