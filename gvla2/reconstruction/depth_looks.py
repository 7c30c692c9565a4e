"""What the joint solve of depth maps sees of each view: samples, smooth error terms, and pairs with other views."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import minimum_filter

from gvla2.geometry.camera import Camera
from gvla2.geometry.transform import FloatArray
from gvla2.geometry.views import View

SAMPLES = 300
"""Pixels of each view that are compared with every other view."""
LOW, KNOTS = 4, 5
"""Stiff terms (scale, two tilts, relief), and knots of the field along each side of the object's box."""
ALIKE = 0.8
"""Cosine between two normals of one surface, at least."""
STEEP = 0.3
"""Cosine below which a surface is too steep for its plane to be trusted to the noise alone."""
_FEWEST = 30


class Basis:
    """B_i(u): the columns by which one view's depth may be wrong."""

    def __init__(self, depth: FloatArray) -> None:
        rows, columns = np.nonzero(np.isfinite(depth))
        self._low = np.array([columns.min(), rows.min()]) + 0.5
        self._size = np.maximum(np.array([np.ptp(columns), np.ptp(rows)]), 1)
        self._middle = float(np.median(np.log(depth[rows, columns])))

    def at(self, uv: FloatArray, log_depth: FloatArray) -> FloatArray:
        """(N, P) at pixels (N, 2) of log depth (N,)."""
        t = np.clip((uv - self._low) / self._size, 0, 1)
        stiff = [np.ones(len(uv)), 2 * t[:, 0] - 1, 2 * t[:, 1] - 1, log_depth - self._middle]
        hats = [np.maximum(0, 1 - np.abs(t[:, a, None] * (KNOTS - 1) - np.arange(KNOTS))) for a in (0, 1)]
        across, down = (hat * hat * (3 - 2 * hat) for hat in hats)
        field = (across[:, :, None] * down[:, None, :]).reshape(len(uv), KNOTS * KNOTS)
        return np.concatenate([np.stack(stiff, axis=1), field], axis=1)


@dataclass(frozen=True)
class Look:
    """One view's solid depth and N samples of it.

    ``log_depth`` (H, W) NaN where not solid; ``rays`` (H, W, 3) of depth 1; ``normals`` (H, W, 3); of the samples
    ``pixels`` (N, 2), log depth ``at`` (N,), ``design`` (N, P), and log depth of the hull's front and back. ``capped``:
    log depth (M,), design (M, P) and log cap (M,) of the pixels behind whose cap nothing can lie.
    """

    camera: Camera
    basis: Basis
    log_depth: FloatArray
    rays: FloatArray
    normals: FloatArray
    pixels: NDArray[np.intp]
    at: FloatArray
    design: FloatArray
    nearest: FloatArray
    farthest: FloatArray
    capped: tuple[FloatArray, FloatArray, FloatArray]

    def picked(self, image: FloatArray) -> FloatArray:
        """An image's values (N, ...) at the samples."""
        return np.asarray(image[self.pixels[:, 1], self.pixels[:, 0]])

    def scale_within_hull(self) -> float:
        """The log scale that puts most of the depth into the hull, and near its front."""
        low, high = self.nearest - self.at, self.farthest - self.at
        tried = np.linspace(np.quantile(low, 0.02), np.quantile(high, 0.98), 200)
        outside = np.maximum(low - tried[:, None], 0) + np.maximum(tried[:, None] - high, 0)
        apart = np.abs(low - tried[:, None])
        cost = np.minimum(outside, 0.05).mean(axis=1) + 0.05 * np.minimum(apart, 0.1).mean(axis=1)
        return float(tried[int(np.argmin(cost))])


def look_at(
    view: View,
    depth: FloatArray,
    solid: NDArray[np.bool_],
    front: FloatArray,
    back: FloatArray,
    caps: FloatArray,
) -> Look | None:
    """A view's look; None where it shows too little of what the hull holds."""
    rows, columns = np.nonzero(solid & np.isfinite(depth) & np.isfinite(front) & np.isfinite(back))
    if len(rows) < _FEWEST:
        return None
    chosen = np.linspace(0, len(rows) - 1, min(SAMPLES, len(rows))).astype(int)
    rows, columns = rows[chosen], columns[chosen]
    pixels, basis = np.stack([columns, rows], axis=1), Basis(depth)
    at = np.log(depth[rows, columns])
    _, rays = view.camera.rays()
    under = np.argwhere(np.isfinite(depth) & np.isfinite(caps))
    nearby = np.where(solid, depth, minimum_filter(np.where(np.isfinite(depth), depth, np.inf), 3))
    below: FloatArray = np.log(nearby[under[:, 0], under[:, 1]].astype(np.float64))
    capped = (
        below,
        basis.at((under[:, ::-1] + 0.5).astype(np.float64), below),
        np.log(caps[under[:, 0], under[:, 1]]),
    )
    return Look(
        view.camera,
        basis,
        np.where(solid, np.log(depth), np.nan),
        rays,
        surface_normals(depth, rays),
        pixels,
        at,
        basis.at(pixels + 0.5, at),
        np.log(front[rows, columns]),
        np.log(back[rows, columns]),
        capped,
    )


def turned(look: Look, theta: FloatArray) -> Look:
    """The look with the normals of its corrected surface: a tilted map's own would find no partner."""
    known = np.isfinite(look.log_depth)
    log = look.log_depth[known]
    depth = np.full(known.shape, np.nan)
    depth[known] = np.exp(log + look.basis.at(look.camera.pixel_centres()[known], log) @ theta)
    return replace(look, normals=surface_normals(depth, look.rays))


def surface_normals(depth: FloatArray, rays: FloatArray) -> FloatArray:
    """(H, W, 3) unit normals towards the camera of depth (H, W) on ``rays`` (H, W, 3); NaN where there is none."""
    points = rays * depth[..., None]
    across, down = np.full_like(points, np.nan), np.full_like(points, np.nan)
    across[:, 1:-1] = points[:, 2:] - points[:, :-2]
    down[1:-1] = points[2:] - points[:-2]
    normals = np.cross(down, across)  # v points down: this one looks back at the camera
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(normals / np.linalg.norm(normals, axis=-1, keepdims=True))


@dataclass(frozen=True)
class Link:
    """Samples ``which`` (N,) of view i, and planes with ``normal`` (N, 3) through points of view j.

    The points lie on ``rays`` (N, 3) of j at log depth ``at`` (N,) with ``design`` (N, P).
    """

    i: int
    j: int
    look: Look
    which: NDArray[np.intp]
    at: FloatArray
    rays: FloatArray
    design: FloatArray
    normal: FloatArray
    between: FloatArray  # (3,) from j's camera to i's

    def _along(self, theta: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """How far both points lie along the normal, from their cameras, and the length of one relative error."""
        a = self.look
        far = np.exp(a.at[self.which] + a.design[self.which] @ theta[self.i])
        near = np.exp(self.at + self.design @ theta[self.j])
        of_i = np.einsum("nk,nk->n", self.normal, a.picked(a.rays)[self.which]) * far
        of_j = np.einsum("nk,nk->n", self.normal, self.rays) * near
        steep = np.maximum(of_i**2, (STEEP * far) ** 2) + np.maximum(of_j**2, (STEEP * near) ** 2)
        return of_i, of_j, np.sqrt(0.5 * steep)

    def gap(self, theta: FloatArray) -> FloatArray:
        """(N,) distances from the planes in units of relative depth."""
        of_i, of_j, unit = self._along(theta)
        return np.asarray((of_i - of_j + self.normal @ self.between) / unit)

    def slopes(self, theta: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Derivatives (N, P) of the gaps by theta_i and theta_j."""
        of_i, of_j, unit = self._along(theta)
        return (of_i / unit)[:, None] * self.look.design[self.which], -(of_j / unit)[:, None] * self.design


def linked(looks: Sequence[Look | None], theta: FloatArray, gate: float) -> list[Link]:
    """All pairs of views that see one surface: normals alike, and no more than ``gate`` apart."""
    links = []
    for i, a in enumerate(looks):
        for j, b in enumerate(looks):
            if i == j or a is None or b is None:
                continue
            link = _link(i, j, a, b, theta)
            alike = np.einsum("nk,nk->n", a.picked(a.normals)[link.which], link.normal)
            kept = (np.abs(link.gap(theta)) < gate) & (alike > ALIKE)
            if kept.any():
                names = ("which", "at", "rays", "design", "normal")
                links.append(replace(link, **{name: getattr(link, name)[kept] for name in names}))
    return links


def _link(i: int, j: int, a: Look, b: Look, theta: FloatArray) -> Link:
    """The pixels of b on which the samples of a fall."""
    points = a.camera.position + a.picked(a.rays) * np.exp(a.at + a.design @ theta[i])[:, None]
    uv, z = b.camera.project(points)
    inside = b.camera.inside(uv) & (z > 0)
    column, row = np.where(inside[:, None], np.nan_to_num(uv), 0).astype(np.intp).T
    known = inside & np.isfinite(b.log_depth[row, column]) & np.isfinite(b.normals[row, column, 0])
    known &= np.isfinite(a.picked(a.normals)[:, 0])
    row, column = row[known], column[known]
    at = b.log_depth[row, column]
    design = b.basis.at(np.stack([column, row], axis=1) + 0.5, at)
    between = a.camera.position - b.camera.position
    which = np.flatnonzero(known)
    return Link(i, j, a, which, at, b.rays[row, column], design, b.normals[row, column], between)
