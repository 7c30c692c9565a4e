"""A prior's depth, brought to the calibrated cameras and weighed pixel by pixel."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_erosion, distance_transform_edt

from gvla2.errors import GeometryError
from gvla2.geometry.transform import FloatArray
from gvla2.geometry.views import Views
from gvla2.reconstruction.contracts import GeometryEstimate
from gvla2.reconstruction.sim3 import align_cameras
from gvla2.reconstruction.support import mask_of
from gvla2.reconstruction.visibility import depth_of_points

_CENTRES_OFF, _AXES_OFF = 0.15, 0.25
"""Largest residual of aligned cameras: a share of the baseline, and radians."""
_LEAST_COVERAGE = 0.25
"""Least share of the masks' pixels that must have depth."""
_LEAST_SMOOTH = 0.5
"""Least share of the known depth that must be free of jumps."""
_STEEPEST = 4.0
"""Tangent of the angle at which a rim pixel may fall away from the surface next to it."""
_LEAST_COSINE = 0.05
"""Depth seen at a grazing angle is trusted this much at least."""
_RIM = 0.2
"""Pixels on a silhouette or depth edge may be flying pixels: trust them this much."""


class UnusablePriorError(GeometryError):
    """A prior's estimate cannot guide; ``code`` is its type, the message says why. Guidance reports it."""

    def __init__(self, code: str, message: str) -> None:
        super().__init__(f"{code}: {message}")
        self.code = code


@dataclass(frozen=True)
class PriorDepth:
    """Metric depth of S views along the calibrated cameras' z.

    ``depth`` (S, H, W) metres, 0 where unknown; ``weight`` (S, H, W) in [0, 1], 0 where unknown or outside the
    mask: confidence x mask x cosine of incidence, less on edges. ``solid`` (S, H, W) is the depth without pixels
    of edges and silhouettes that fly between two surfaces. ``normals`` (S, H, W, 3) world, unit,
    towards the view's camera, NaN where there is none. ``jump`` is the step in metres between
    neighbouring pixels that counts as an edge; ``coverage`` the share of mask pixels with depth; ``notes`` what
    was done to bring the prior here.
    """

    depth: FloatArray
    weight: FloatArray
    solid: FloatArray
    normals: FloatArray
    jump: float
    coverage: float
    notes: tuple[str, ...] = ()

    def scaled(self, factor: float, note: str) -> PriorDepth:
        """The same surfaces nearer to or farther from their cameras."""
        return replace(self, depth=self.depth * factor, solid=self.solid * factor, notes=(*self.notes, note))


def calibrate_prior(
    estimate: GeometryEstimate,
    views: Views,
    points: FloatArray,
    *,
    size: float,
    spacing: float,
    edge: float = 0.025,
) -> PriorDepth:
    """Depth x scale for the given cameras, and how far to trust each pixel.

    An estimate with poses is aligned to the calibrated cameras by Sim(3); only the scale is kept, its poses are
    dropped (VGGT's depth x scale is nearer than its point map). Where the poses leave the scale open (one view),
    the depth of the ``points`` (N, 3) of the object serves. ``size`` is the object's diameter and ``spacing`` the
    points' distance, metres; ``edge`` the step in depth that counts as an edge, as a share of the size.
    Raises :class:`UnusablePriorError` with a typed code; :class:`GeometryError` for views without masks.
    """
    masks = [mask_of(view) for view in views]
    depth, confidence = _checked(estimate, views)
    notes: list[str] = []
    scale = 1.0
    if estimate.world_from_camera is not None:
        scale = _scale_of(estimate, depth, views, points, spacing, masks, notes)
    inside = np.stack(masks) > 0.5
    depth = np.where(np.isfinite(depth) & (depth > 0) & (confidence > 0), depth * scale, np.nan)
    known = np.isfinite(depth) & inside
    coverage = float(known.sum() / max(int(inside.sum()), 1))
    if coverage < _LEAST_COVERAGE:
        raise UnusablePriorError(
            "too_little_depth", f"the prior has depth for {coverage:.0%} of the masks' pixels."
        )
    typical = float(np.median(confidence[known]))
    weight, solid = np.zeros_like(depth), np.zeros_like(depth)
    normals = np.full((*depth.shape, 3), np.nan)
    flat = 0
    for s, view in enumerate(views):
        trust = np.clip(confidence[s] / typical, 0.0, 1.0) * masks[s]
        smooth, normals[s], cosine = _surface(
            view.camera.backproject(depth[s]), depth[s], view.camera.position, edge * size
        )
        flat += int((smooth & known[s]).sum())
        inner = binary_erosion(known[s], np.ones((3, 3), dtype=np.bool_)) & smooth
        weight[s] = np.where(known[s], trust * cosine * np.where(inner, 1.0, _RIM), 0.0)
        steady = inner | (smooth & _goes_on(depth[s], inner, view.camera.K[0, 0]))
        solid[s] = np.where(steady & known[s], depth[s], 0.0)
    if flat < _LEAST_SMOOTH * known.sum():
        raise UnusablePriorError(
            "too_rough",
            f"only {flat / known.sum():.0%} of the prior's depth is free of jumps from pixel to pixel.",
        )
    return PriorDepth(
        np.where(known, depth, 0.0), weight, solid, normals, edge * size, coverage, tuple(notes)
    )


def _checked(estimate: GeometryEstimate, views: Views) -> tuple[FloatArray, FloatArray]:
    """Depth and confidence as float64 (S, H, W); confidence 0 where it is not a number > 0."""
    depth = np.asarray(estimate.depth, dtype=np.float64)
    confidence = np.asarray(estimate.confidence, dtype=np.float64)
    if depth.ndim != 3 or len(depth) != len(views):
        raise UnusablePriorError(
            "wrong_view_count", f"the prior's depth has shape {depth.shape}, there are {len(views)} views."
        )
    sizes = {(view.camera.height, view.camera.width) for view in views}
    if sizes != {depth.shape[1:]} or confidence.shape != depth.shape:
        raise UnusablePriorError(
            "wrong_size",
            f"the prior's depth has shape {depth.shape} and its confidence {confidence.shape}, "
            f"the views are (height, width) {sorted(sizes)}.",
        )
    confidence = np.where(np.isfinite(confidence) & (confidence > 0), confidence, 0.0)
    if not confidence.any():
        raise UnusablePriorError("no_confidence", "the prior's confidence is nowhere above 0.")
    if not (np.isfinite(depth) & (depth > 0)).any():
        raise UnusablePriorError("no_depth", "the prior's depth is nowhere a number above 0.")
    return depth, confidence


def _scale_of(
    estimate: GeometryEstimate,
    depth: FloatArray,
    views: Views,
    points: FloatArray,
    spacing: float,
    masks: list[NDArray[np.float32]],
    notes: list[str],
) -> float:
    """Calibrated metres a unit of the prior's depth."""
    try:
        fit = align_cameras(
            np.asarray(estimate.world_from_camera), np.stack([v.camera.world_from_camera for v in views])
        )
    except GeometryError as error:
        raise UnusablePriorError("bad_cameras", str(error)) from error
    if fit.status == "ok":
        if fit.centre_residual > _CENTRES_OFF * fit.baseline or fit.rotation_residual > _AXES_OFF:
            raise UnusablePriorError(
                "cameras_disagree",
                f"the prior's cameras lie {fit.centre_residual / fit.baseline:.0%} of the baseline and "
                f"{np.degrees(fit.rotation_residual):.0f} degrees off the calibrated ones.",
            )
        notes.append(
            f"Sim(3): scale {fit.sim3.scale:.4g}, cameras {fit.centre_residual / fit.baseline:.1%} of the "
            f"baseline and {np.degrees(fit.rotation_residual):.1f} degrees off"
        )
        return fit.sim3.scale
    ratios = []
    for s, view in enumerate(views):
        front = depth_of_points(points, view.camera, spacing)
        both = np.isfinite(front) & (masks[s] > 0.5) & np.isfinite(depth[s]) & (depth[s] > 0)
        ratios.append(front[both] / depth[s][both])
    found = np.concatenate(ratios)
    if not len(found):
        raise UnusablePriorError("scale_undetermined", "no depth of the prior falls on the object.")
    notes.append("the cameras' centres coincide: scale from the object's own depth")
    # A hull lies before the surface, never behind it: the ratio is right where the two touch.
    return float(np.quantile(found, 0.9))


def _goes_on(depth: FloatArray, inner: NDArray[np.bool_], focal: float) -> NDArray[np.bool_]:
    """Where the depth (H, W) goes on from the nearest inner pixel no steeper than a surface would."""
    if not inner.any():
        return np.zeros_like(inner)
    apart, nearest = distance_transform_edt(~inner, return_indices=True)
    with np.errstate(invalid="ignore"):
        step = np.abs(depth - depth[tuple(nearest)])
        return np.asarray(step <= _STEEPEST * apart * depth / focal)


def _surface(
    world: FloatArray, depth: FloatArray, origin: FloatArray, jump: float
) -> tuple[NDArray[np.bool_], FloatArray, FloatArray]:
    """Where the depth (H, W) has no edge, normals (H, W, 3), and cosines of incidence (H, W), of points (H, W, 3)."""
    # A slope has no second difference, however steep; an edge and a flying pixel have.
    bend = np.zeros_like(depth)
    bend[:, 1:-1] = np.abs(depth[:, 2:] + depth[:, :-2] - 2 * depth[:, 1:-1])
    bend[1:-1] = np.fmax(bend[1:-1], np.abs(depth[2:] + depth[:-2] - 2 * depth[1:-1]))
    smooth = np.isfinite(depth) & ~(bend >= jump)
    with np.errstate(invalid="ignore", divide="ignore"):
        across, down = np.full_like(world, np.nan), np.full_like(world, np.nan)
        across[:, 1:-1] = world[:, 2:] - world[:, :-2]
        down[1:-1] = world[2:] - world[:-2]
        normal = np.cross(down, across)  # v points down: this one looks back at the camera
        normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
        ray = world - origin
        cosine = -(normal * ray).sum(axis=-1) / np.linalg.norm(ray, axis=-1)
    return smooth, normal, np.clip(np.nan_to_num(cosine, nan=_LEAST_COSINE), _LEAST_COSINE, 1.0)
