"""Mask support of points and the soft visual hull that follows from it."""

from __future__ import annotations

from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gvla2.errors import GeometryError
from gvla2.geometry.camera import Camera
from gvla2.geometry.transform import FloatArray
from gvla2.geometry.views import View, Views
from gvla2.reconstruction.compiled import compiled, run_chunks

NEAR = 1e-6
"""Metres in front of a camera where projection begins."""
_BLOCK = 512  # points at a time: what is known of them stays in the nearest cache


def mask_support(points: ArrayLike, views: Views, *, compat: str = "none") -> FloatArray:
    """s(p) (N,) in [0, 1] of world points (N, 3), metres: the mean mask value where p projects.

    Paper, mask-consistency score: the mean of the bilinearly sampled masks over the views where p lies in front
    of the camera and inside the image; 0 where no view sees p. Pixel centres are at half integers, and outside
    the outermost centres the mask goes on as it is there. Points that are not finite have support 0.

    ``compat="official"`` follows the released code: samples at uv * (W - 1) / W instead of uv - 0.5, takes the
    image's far edge as inside, and calls points seen by fewer than 2 views supported (1).
    Raises :class:`GeometryError` for a view without a mask or with mask values outside [0, 1].
    """
    return MaskStack.of(views, compat).support(as_points(points))


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
    needs no clamping. Pixel u maps to the bordered mask's column u * ``zoom[s, 0]`` + ``offset``, v likewise to
    its row. Points seen by fewer than ``least_views`` views count as supported.
    """

    projections: FloatArray  # (S, 3, 4)
    texels: NDArray[np.float32]
    layout: NDArray[np.int64]  # (S, 2): start in texels, row length
    limits: FloatArray  # (S, 2): u and v of the image are below
    zoom: FloatArray  # (S, 2)
    offset: float
    least_views: int

    @classmethod
    def of(cls, views: Views, compat: str = "none") -> MaskStack:
        """Prepare views; errors as in :func:`mask_support`."""
        if compat not in ("none", "official"):
            raise GeometryError(f"No compat mode '{compat}'. Available: none, official.")
        official = compat == "official"
        padded = [np.pad(mask_of(view), 1, mode="edge") for view in views]
        sizes = np.array([[view.camera.width, view.camera.height] for view in views], dtype=np.float64)
        starts = np.cumsum([0] + [mask.size for mask in padded[:-1]])
        return cls(
            projections=np.stack([projection(view.camera) for view in views]),
            texels=np.concatenate([mask.ravel() for mask in padded]),
            layout=np.stack([starts, [mask.shape[1] for mask in padded]], axis=1).astype(np.int64),
            limits=np.nextafter(sizes, np.inf) if official else sizes,
            zoom=(sizes - 1) / sizes if official else np.ones_like(sizes),
            # The border shifts everything by one texel.
            offset=1.0 if official else 0.5,
            least_views=2 if official else 0,
        )

    def support(self, points: FloatArray) -> FloatArray:
        """S (N,) of contiguous float64 points (N, 3)."""
        out = np.empty(len(points))
        run_chunks(partial(_score, points, self, out), len(points))
        return out


@compiled
def _score(
    points: FloatArray,
    stack: MaskStack,
    out: FloatArray,
    start: int,
    stop: int,
) -> None:
    projections, texels, layout, limits, zoom, offset, least_views = stack
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
            most_u, most_v, zoom_u, zoom_v = limits[s, 0], limits[s, 1], zoom[s, 0], zoom[s, 1]
            begin, width = layout[s, 0], layout[s, 1]
            stride, one = np.uint64(width), np.uint64(1)
            for k in range(count):
                depth = wx * x[k] + wy * y[k] + wz * z[k] + w1
                inverse = 1.0 / depth
                u = (ux * x[k] + uy * y[k] + uz * z[k] + u1) * inverse
                v = (vx * x[k] + vy * y[k] + vz * z[k] + v1) * inverse
                seen = (depth > NEAR) & (u >= 0.0) & (v >= 0.0) & (u < most_u) & (v < most_v)
                u = u * zoom_u + offset if seen else 0.0
                v = v * zoom_v + offset if seen else 0.0
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
            out[first + k] = (1.0 if views[k] < least_views else mean) if known else 0.0


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


def released_centre(points: ArrayLike) -> FloatArray:
    """(3,) mean of points (N, 3), in single precision: the centre of the released code, another one for each file."""
    return np.asarray(_finite(points).astype(np.float32).mean(axis=0), dtype=np.float64)


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
    array = as_points(points)
    s = np.ascontiguousarray(support, dtype=np.float64)
    if not (eta > 0 and 0 <= lambda_max <= 1 and np.isfinite(tau)):
        raise GeometryError(
            f"Soft hull: eta must be > 0, lambda_max in [0, 1] and tau finite; "
            f"got eta={eta}, lambda_max={lambda_max}, tau={tau}."
        )
    if s.shape != (len(array),):
        raise GeometryError(f"Soft hull: {len(array)} points but support of shape {s.shape}.")
    if len(array) == 0:
        return array
    c = object_centre(array) if centre is None else np.asarray(centre, dtype=np.float64)
    if c.shape != (3,) or not np.isfinite(c).all():
        raise GeometryError(f"Soft hull: the centre must be three finite numbers, got {c}.")
    moved, wrong = np.empty_like(array), np.zeros(2, dtype=np.int64)
    run_chunks(partial(_shrink, array, s, c, tau, eta, lambda_max, moved, wrong), len(array))
    if wrong[0]:
        raise GeometryError(f"Soft hull: points must be finite; at least {wrong[0]} of {len(array)} are not.")
    if wrong[1]:
        raise GeometryError("Soft hull: support must lie in [0, 1].")
    return moved


@compiled
def _shrink(
    points: FloatArray,
    support: FloatArray,
    c: FloatArray,
    tau: float,
    eta: float,
    lambda_max: float,
    moved: FloatArray,
    wrong: NDArray[np.int64],
    start: int,
    stop: int,
) -> None:
    for n in range(start, stop):
        s, x, y, z = support[n], points[n, 0], points[n, 1], points[n, 2]
        wrong[0] += not np.isfinite(x + y + z)
        wrong[1] += not (s >= 0.0 and s <= 1.0)
        # A huge exponent would only make the sigmoid 0, as it should be.
        sigmoid = 1.0 / (1.0 + np.exp(min((s - tau) / eta, 700.0)))
        strength = lambda_max * sigmoid * sigmoid
        moved[n, 0] = x - (x - c[0]) * strength
        moved[n, 1] = y - (y - c[1]) * strength
        moved[n, 2] = z - (z - c[2]) * strength
