"""A short 3D Gaussian splatting optimisation (Kerbl et al. 2023) that starts from a reconstruction.

A handful of views leaves most of what Gaussians can do undetermined: without constraints they overfit the inputs, and
other views get worse. Two smoothness terms prevent this, both on the *change* since the start and over a graph of
neighbours: centres move together (unseen ones follow seen ones), and colours shift together. There is no densification:
the start already covers the surface.

A low-pass widens every silhouette by more than half a pixel, and Gaussians shrink to compensate. So for the shape
(:func:`carry`) fit with hardly any low-pass first, then for the pictures with the renderer's own.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.sparse import csr_array
from scipy.spatial import cKDTree

from gvla2.geometry.camera import Camera
from gvla2.geometry.gaussians import Gaussians
from gvla2.geometry.mesh import TriangleMesh
from gvla2.geometry.transform import FloatArray
from gvla2.geometry.views import View, Views
from gvla2.reconstruction.compiled import Floats
from gvla2.reconstruction.contracts import StageReport
from gvla2.reconstruction.rasteriser import Frame, Rasteriser, backward, forward

if TYPE_CHECKING:
    from gvla2_plugins.splat import SplatConfig

MARGIN = 8
"""Pixels of background kept around a mask, so that spill-over is penalised."""
LEAST_PIXELS = 16
"""A mask with fewer pixels counts as empty."""

_WHITE_ENOUGH = 0.98


@dataclass(frozen=True)
class Target:
    """One view cut to the object: ``image`` (h, w, 3) and ``mask`` (h, w) float32 in [0, 1].

    ``image`` has white where the mask is 0. ``weight`` (h, w) is 0 where the view is uninformative (the robot hides the
    object); it is divided by the mask's pixels, so that views of any size count alike.
    """

    camera: Camera
    image: Floats
    mask: Floats
    weight: Floats


def targets(views: Views) -> tuple[Target, ...]:
    """One target per view; views without a mask, or with an empty one, give none."""
    masked = [(view, view.mask) for view in views if view.mask is not None]
    return tuple(_cut(view, mask) for view, mask in masked if (mask > 0.5).sum() >= LEAST_PIXELS)


def _cut(view: View, mask: Floats) -> Target:
    rows, columns = np.flatnonzero((mask > 0).any(axis=1)), np.flatnonzero((mask > 0).any(axis=0))
    top, left = max(rows[0] - MARGIN, 0), max(columns[0] - MARGIN, 0)
    bottom = min(rows[-1] + 1 + MARGIN, view.camera.height)
    right = min(columns[-1] + 1 + MARGIN, view.camera.width)
    window = np.s_[top:bottom, left:right]
    K = view.camera.K.copy()
    K[0, 2] -= left
    K[1, 2] -= top
    camera = Camera(K, view.camera.world_from_camera, int(right - left), int(bottom - top), view.name)
    part = np.clip(mask[window], 0.0, 1.0).astype(np.float32)
    image = view.image[window].astype(np.float32) / np.float32(255)
    outside = part == 0
    if not outside.any() or image[outside].mean() < _WHITE_ENOUGH:
        # Pixels on the rim hold some of an unknown background: white takes its place as far as the mask says.
        image = image * part[..., None] + (1 - part[..., None])
    weight = np.full(part.shape, 1 / float((mask > 0.5).sum()), dtype=np.float32)
    if view.robot_mask is not None:
        weight[view.robot_mask[window]] = 0.0
    return Target(camera, np.ascontiguousarray(image), np.ascontiguousarray(part), weight)


_FITTED = ("centres", "log_scales", "rotations", "opacity_logits", "sh_dc")
_RATE_CENTRES, _RATES, _FINAL_RATE = 0.15, (0.01, 0.005, 0.02, 0.02), 0.1
"""Adam's first step sizes: of centres in spacings of the Gaussians, of the others in their own units; and the share of
themselves that all fall to."""
_WEIGHT_ALPHA = 0.5  # of the silhouette's L1 against the colour's
_NEIGHBOURS = 8
_MOMENTUM, _SQUARES = 0.9, 0.999  # Adam's
_ALPHA_SLACK = 0.02  # an alpha this near to the mask is right
_IOU_TOLERANCE = 0.01


def optimise(
    gaussians: Gaussians, views: Views, config: SplatConfig, iterations: int, low_pass: float = 0.3
) -> tuple[Gaussians, StageReport]:
    """Fit Gaussians to the views' colours and masks, in ``iterations`` of one view each.

    ``gaussians`` in the world frame, near the object; higher harmonics are kept as they are. ``low_pass`` is the
    renderer's, square pixels. The report's measures are ``psnr`` of the inputs (dB, the object's window on white) and
    ``iou`` of rendered alpha with the masks. If either got worse the original Gaussians are returned, status
    ``rejected``; with nothing to fit, ``skipped``. Deterministic for a seed.
    """
    start, shown = time.perf_counter(), targets(views)
    if len(gaussians) == 0 or not shown or iterations == 0:
        return gaussians, StageReport("splat", "skipped", "There is nothing to fit.")
    raster = Rasteriser(low_pass=low_pass)
    before = _measure(gaussians, shown, raster)
    fitted = _fit(gaussians, shown, config, iterations, raster)
    after = _measure(fitted, shown, raster)
    worse = after["psnr"] < before["psnr"] or after["iou"] < before["iou"] - _IOU_TOLERANCE
    return gaussians if worse else fitted, StageReport(
        "splat",
        "rejected" if worse else "applied",
        "The fit to the inputs got worse." if worse else f"{len(shown)} views, {len(gaussians)} Gaussians.",
        before,
        after,
        time.perf_counter() - start,
    )


def carry(mesh: TriangleMesh, before: Gaussians, after: Gaussians) -> TriangleMesh:
    """A mesh whose vertices move as the Gaussians around them did; faces and colours are kept.

    ``before`` and ``after`` are the same Gaussians at both times; a vertex takes the mean displacement of the
    nearest, weighted by closeness.
    """
    if len(before) == 0 or len(mesh.vertices) == 0:
        return mesh
    near = min(_NEIGHBOURS, len(before))
    distance, row = _nearest(before.centres, mesh.vertices, near)
    moved = after.centres.astype(np.float64) - before.centres
    width = np.maximum(distance[:, -1:], 1e-12)
    weight = np.exp(-4 * (distance / width) ** 2)
    shift = np.einsum("vk,vkc->vc", weight / weight.sum(axis=1, keepdims=True), moved[row])
    return TriangleMesh(mesh.vertices + shift, mesh.faces, mesh.colours)


def _fit(
    gaussians: Gaussians, shown: tuple[Target, ...], config: SplatConfig, iterations: int, raster: Rasteriser
) -> Gaussians:
    first = {name: getattr(gaussians, name) for name in _FITTED}
    now = {name: np.array(array) for name, array in first.items()}
    graph, spacing = neighbour_graph(gaussians.centres)
    pull_centres = np.float32(2 * config.smooth_centres / (spacing**2 * len(gaussians)))
    pull_colours = np.float32(2 * config.smooth_colours / len(gaussians))
    rates = (_RATE_CENTRES * spacing, *_RATES)
    adam = {name: _Adam(now[name], rate) for name, rate in zip(_FITTED, rates, strict=True)}
    rng = np.random.default_rng(config.seed)
    rounds = [rng.permutation(len(shown)) for _ in range(-(-iterations // len(shown)))]
    for step, index in enumerate(np.concatenate(rounds)[:iterations]):
        target = shown[index]
        frame = forward(Gaussians(**now, sh_rest=gaussians.sh_rest), target.camera, rasteriser=raster)
        found = backward(frame, *_slopes(frame, target))
        gradients = {name: getattr(found, name) for name in _FITTED}
        gradients["centres"] += pull_centres * (graph @ (now["centres"] - first["centres"]))
        gradients["sh_dc"] += pull_colours * (graph @ (now["sh_dc"] - first["sh_dc"]))
        for name in _FITTED:
            adam[name].step(gradients[name], _FINAL_RATE ** (step / iterations))
    return Gaussians(**now, sh_rest=gaussians.sh_rest)


def _slopes(frame: Frame, target: Target) -> tuple[Floats, Floats]:
    """Gradients of the loss at image and alpha: L1 of both, weighted; alphas near enough to the mask are right."""
    off = frame.alpha - target.mask
    to_image = np.sign(frame.image - target.image) * (target.weight / np.float32(3))[..., None]
    to_alpha = np.float32(_WEIGHT_ALPHA) * np.sign(off) * target.weight * (np.abs(off) > _ALPHA_SLACK)
    return to_image, to_alpha


class _Adam:
    """Adam (Kingma and Ba 2015) on one array, in place."""

    def __init__(self, array: Floats, rate: float) -> None:
        self._array, self._rate, self._steps = array, rate, 0
        self._mean, self._square = np.zeros_like(array), np.zeros_like(array)

    def step(self, gradient: Floats, decay: float) -> None:
        self._steps += 1
        self._mean += np.float32(1 - _MOMENTUM) * (gradient - self._mean)
        self._square += np.float32(1 - _SQUARES) * (gradient * gradient - self._square)
        rate = self._rate * decay / (1 - _MOMENTUM**self._steps)
        size = np.sqrt(self._square) * np.float32((1 - _SQUARES**self._steps) ** -0.5) + np.float32(1e-15)
        self._array -= np.float32(rate) * self._mean / size


def neighbour_graph(points: Floats) -> tuple[Any, float]:
    """The Laplacian of the graph of nearest neighbours, a sparse (N, N), and their typical distance in metres.

    Row i of its product with values (N, 3) is how far i's value is from its neighbours' mean, about; half the
    values' product with it is the energy that smoothness costs.
    """
    count = len(points)
    near = min(_NEIGHBOURS, count - 1)
    if near == 0:
        return csr_array((1, 1), dtype=np.float32), 1e-3
    distance, row = _nearest(points, points, near + 1)
    ends = (np.repeat(np.arange(count), near), row[:, 1:].ravel())
    one_way = csr_array((np.full(count * near, 0.5 / near, np.float32), ends), shape=(count, count))
    weights: Any = one_way + one_way.T
    degree = csr_array((np.asarray(weights.sum(axis=1), np.float32).ravel(), (np.arange(count),) * 2))
    spread = float(np.median(distance[:, 1:].mean(axis=1)))
    return csr_array(degree - weights), max(spread, 1e-6)


def _nearest(points: FloatArray | Floats, to: FloatArray | Floats, near: int) -> tuple[FloatArray, Any]:
    """Distances and rows (M, near) of the ``near`` of ``points`` (N, 3) that lie nearest to each of ``to`` (M, 3)."""
    distance, row = cKDTree(points).query(to, k=near)
    return np.asarray(distance).reshape(-1, near), np.asarray(row).reshape(-1, near)


def _measure(gaussians: Gaussians, shown: tuple[Target, ...], raster: Rasteriser) -> dict[str, float]:
    """Mean PSNR in dB and mean IoU of alpha and mask over the targets."""
    psnr, iou = [], []
    for target in shown:
        frame = forward(gaussians, target.camera, rasteriser=raster)
        known = target.weight > 0
        error = float(np.mean((np.clip(frame.image, 0, 1) - target.image)[known] ** 2))
        psnr.append(-10 * np.log10(max(error, 1e-10)))
        iou.append(
            float(np.minimum(frame.alpha, target.mask)[known].sum())
            / max(float(np.maximum(frame.alpha, target.mask)[known].sum()), 1e-9)
        )
    return {"psnr": float(np.mean(psnr)), "iou": float(np.mean(iou))}
