"""Mask support: how far the input masks agree that a point belongs to the object."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gvla2.errors import GeometryError
from gvla2.geometry.camera import Camera
from gvla2.geometry.transform import FloatArray
from gvla2.geometry.views import View, Views
from gvla2.reconstruction.compiled import compiled, run_chunks

Compat = Literal["none", "official"]
NEAR = 1e-6
"""Metres in front of a camera where projection begins."""


def mask_support(points: ArrayLike, views: Views, *, compat: Compat = "none") -> FloatArray:
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


@dataclass(frozen=True)
class MaskStack:
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
    def of(cls, views: Views, compat: Compat = "none") -> MaskStack:
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

        def body(start: int, stop: int) -> None:
            _score(
                points,
                self.projections,
                self.texels,
                self.layout,
                self.limits,
                self.zoom,
                self.offset,
                self.least_views,
                out,
                start,
                stop,
            )

        run_chunks(body, len(points))
        return out


@compiled
def _score(
    points: FloatArray,
    projections: FloatArray,
    texels: NDArray[np.float32],
    layout: NDArray[np.int64],
    limits: FloatArray,
    zoom: FloatArray,
    offset: float,
    least_views: int,
    out: FloatArray,
    start: int,
    stop: int,
) -> None:
    for n in range(start, stop):
        x, y, z = points[n, 0], points[n, 1], points[n, 2]
        if not np.isfinite(x + y + z):
            out[n] = 0.0
            continue
        total, seen = 0.0, 0
        for s in range(len(projections)):
            P = projections[s]
            depth = P[2, 0] * x + P[2, 1] * y + P[2, 2] * z + P[2, 3]
            if not depth > NEAR:
                continue
            inverse = 1.0 / depth
            u = (P[0, 0] * x + P[0, 1] * y + P[0, 2] * z + P[0, 3]) * inverse
            v = (P[1, 0] * x + P[1, 1] * y + P[1, 2] * z + P[1, 3]) * inverse
            if not (u >= 0.0 and v >= 0.0 and u < limits[s, 0] and v < limits[s, 1]):
                continue
            u = u * zoom[s, 0] + offset
            v = v * zoom[s, 1] + offset
            column, row = int(u), int(v)
            right, down = u - column, v - row
            width = layout[s, 1]
            corner = layout[s, 0] + row * width + column
            above = texels[corner] + right * (texels[corner + 1] - texels[corner])
            corner += width
            below = texels[corner] + right * (texels[corner + 1] - texels[corner])
            total += above + down * (below - above)
            seen += 1
        if seen < least_views:
            out[n] = 1.0
        else:
            out[n] = min(max(total / max(seen, 1), 0.0), 1.0)
