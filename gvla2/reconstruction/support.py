"""Mask support of points and the soft visual hull that follows from it."""

from __future__ import annotations

from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import expit

from gvla2.errors import GeometryError
from gvla2.geometry.camera import Camera
from gvla2.geometry.compiled import fused, run_chunks
from gvla2.geometry.transform import FloatArray
from gvla2.geometry.views import View, Views

NEAR = 1e-6
"""Metres in front of a camera where projection begins."""
_BLOCK = 512  # points at a time: what is known of them stays in the nearest cache


def mask_support(points: ArrayLike, views: Views) -> FloatArray:
    """s(p) (N,) in [0, 1] of world points (N, 3), metres: the mean mask value where p projects.

    Paper, mask-consistency score: the mean of the bilinearly sampled masks over the views where p lies in front
    of the camera and inside the image; 0 where no view sees p. Pixel centres are at half integers, and outside
    the outermost centres the mask goes on as it is there. Points that are not finite have support 0.
    Raises :class:`GeometryError` for a view without a mask or with mask values outside [0, 1].
    """
    return MaskStack.of(views).support(as_points(points))


def as_points(points: ArrayLike, what: str = "points") -> FloatArray:
    """The points as a contiguous float64 (N, 3) array; :class:`GeometryError` for another shape."""
    array = np.ascontiguousarray(points, dtype=np.float64)
    if array.ndim != 2 or array.shape[1] != 3:
        raise GeometryError(f"{what} must be (N, 3), got shape {array.shape}.")
    return array


def mask_of(view: View) -> NDArray[np.float32]:
    """The view's mask (H, W), checked to be there and within [0, 1]."""
    if view.mask is None:
        raise GeometryError(
            f"View '{view.name}' has no mask: the object's silhouette is needed in every input view."
        )
    mask = np.asarray(view.mask, dtype=np.float32)
    if not (mask.min() >= 0 and mask.max() <= 1):
        raise GeometryError(
            f"View '{view.name}': mask values must lie in [0, 1], got {mask.min():g} to {mask.max():g}."
        )
    return mask


def projection(camera: Camera) -> FloatArray:
    """K T (3, 4): from homogeneous world points to homogeneous pixels, whose third entry is the depth."""
    return np.ascontiguousarray(camera.K @ camera.camera_from_world[:3])


class MaskStack(NamedTuple):
    """The views' projections and masks, laid out for the loop below; make one when scoring many times.

    ``texels`` holds all masks one after the other, each with a border of one repeated pixel, so that sampling
    needs no clamping.
    """

    projections: FloatArray  # (S, 3, 4)
    texels: NDArray[np.float32]
    layout: NDArray[np.int64]  # (S, 2): start in texels, row length
    limits: FloatArray  # (S, 2): u and v of the image are below

    @classmethod
    def of(cls, views: Views) -> MaskStack:
        """Prepare views; errors as in :func:`mask_support`."""
        padded = [np.pad(mask_of(view), 1, mode="edge") for view in views]
        starts = np.cumsum([0] + [mask.size for mask in padded[:-1]])
        return cls(
            projections=np.stack([projection(view.camera) for view in views]),
            texels=np.concatenate([mask.ravel() for mask in padded]),
            layout=np.stack([starts, [mask.shape[1] for mask in padded]], axis=1).astype(np.int64),
            limits=np.array([[view.camera.width, view.camera.height] for view in views], dtype=np.float64),
        )

    def support(self, points: FloatArray) -> FloatArray:
        """S (N,) of contiguous float64 points (N, 3)."""
        out = np.empty(len(points))
        run_chunks(partial(_score, points, self, out), len(points))
        return out


@fused
def _score(points: FloatArray, stack: MaskStack, out: FloatArray, start: int, stop: int) -> None:
    projections, texels, layout, limits = stack
    # Blocks of points, and no branches within a loop: so that the compiler takes several points at once.
    x, y, z = np.empty(_BLOCK), np.empty(_BLOCK), np.empty(_BLOCK)
    right, down = np.empty(_BLOCK), np.empty(_BLOCK)
    corner = np.empty(_BLOCK, dtype=np.uint64)  # unsigned: an index that needs no test for below 0
    total, views, shown = np.empty(_BLOCK), np.empty(_BLOCK), np.empty(_BLOCK)
    for first in range(start, stop, _BLOCK):
        count = min(_BLOCK, stop - first)
        for k in range(count):
            x[k], y[k], z[k] = points[first + k, 0], points[first + k, 1], points[first + k, 2]
            total[k], views[k] = 0.0, 0.0
        for s in range(len(projections)):
            P = projections[s]
            ux, uy, uz, u1 = P[0, 0], P[0, 1], P[0, 2], P[0, 3]
            vx, vy, vz, v1 = P[1, 0], P[1, 1], P[1, 2], P[1, 3]
            wx, wy, wz, w1 = P[2, 0], P[2, 1], P[2, 2], P[2, 3]
            most_u, most_v = limits[s, 0], limits[s, 1]
            begin, width = layout[s, 0], layout[s, 1]
            stride, one = np.uint64(width), np.uint64(1)
            for k in range(count):
                depth = wx * x[k] + wy * y[k] + wz * z[k] + w1
                inverse = 1.0 / depth
                u = (ux * x[k] + uy * y[k] + uz * z[k] + u1) * inverse
                v = (vx * x[k] + vy * y[k] + vz * z[k] + v1) * inverse
                seen = (depth > NEAR) & (u >= 0.0) & (v >= 0.0) & (u < most_u) & (v < most_v)
                u = u + 0.5 if seen else 0.0  # half a pixel for the centre, and one for the border
                v = v + 0.5 if seen else 0.0
                column, row = np.int32(u), np.int32(v)
                right[k], down[k] = u - column, v - row
                corner[k] = np.uint64(begin + row * width + column)
                shown[k] = 1.0 if seen else 0.0
            for k in range(count):
                at = corner[k]
                above = texels[at] + right[k] * (texels[at + one] - texels[at])
                at += stride
                below = texels[at] + right[k] * (texels[at + one] - texels[at])
                total[k] += shown[k] * (above + down[k] * (below - above))
                views[k] += shown[k]
        for k in range(count):
            mean = min(max(total[k] / max(views[k], 1.0), 0.0), 1.0)
            known = np.isfinite(x[k] + y[k] + z[k])
            out[first + k] = mean if known else 0.0


TAU, ETA, LAMBDA_MAX = 0.45, 0.12, 0.008
"""The released constants: support threshold, softness, greatest shrink ratio."""


def object_centre(points: ArrayLike) -> FloatArray:
    """(3,) centre of the bounding box of points (N, 3): the paper's object centre c.

    The box's, not the mean: Gaussians and mesh vertices of one object are spread differently over it, yet must
    move alike. Take it once an object, from either, and pass it on to both.
    Raises :class:`GeometryError` for no points, and for any that is not finite.
    """
    array = _finite(points)
    if len(array) == 0:
        raise GeometryError("No points: the object has no centre.")
    columns = np.ascontiguousarray(array.T)  # whose ends are found ten times as fast
    return np.asarray(0.5 * (columns.min(axis=1) + columns.max(axis=1)))


def _finite(points: ArrayLike) -> FloatArray:
    array = as_points(points)
    if not np.isfinite(array).all():
        lost = int((~np.isfinite(array)).any(axis=1).sum())
        raise GeometryError(f"{lost} of {len(array)} points are not finite: drop them first.")
    return array


def soft_hull(
    points: ArrayLike,
    support: ArrayLike,
    centre: ArrayLike | None = None,
    tau: float = TAU,
    eta: float = ETA,
    lambda_max: float = LAMBDA_MAX,
) -> FloatArray:
    """P' = c + (p - c) (1 - lambda(p)) (N, 3) of world points (N, 3) with support s (N,).

    lambda(p) = lambda_max * sigmoid((tau - s(p)) / eta)^2, in [0, lambda_max] (paper, shrink strength).
    ``centre`` (3,) is :func:`object_centre` of these points by default; give one centre for Gaussians and mesh
    alike. Raises :class:`GeometryError` for points that are not finite, shapes that do not match, support outside
    [0, 1], eta <= 0 and lambda_max outside [0, 1].
    """
    array, s = _finite(points), np.asarray(support, dtype=np.float64)
    if not (eta > 0 and 0 <= lambda_max <= 1 and np.isfinite(tau)):
        raise GeometryError(
            f"Soft hull: eta must be > 0, lambda_max in [0, 1] and tau finite; "
            f"got eta={eta}, lambda_max={lambda_max}, tau={tau}."
        )
    if s.shape != (len(array),) or not ((s >= 0) & (s <= 1)).all():
        raise GeometryError(f"Soft hull: support must be ({len(array)},) in [0, 1], got shape {s.shape}.")
    if len(array) == 0:
        return array
    c = object_centre(array) if centre is None else np.asarray(centre, dtype=np.float64)
    if c.shape != (3,) or not np.isfinite(c).all():
        raise GeometryError(f"Soft hull: the centre must be three finite numbers, got {c}.")
    strength = lambda_max * expit((tau - s) / eta) ** 2
    return np.asarray(array - strength[:, None] * (array - c))
