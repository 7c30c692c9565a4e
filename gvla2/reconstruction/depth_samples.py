"""The terms of the joint solve of depth maps: each view's samples, smooth error terms, and pairs with other views."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import minimum_filter

from gvla2.geometry.camera import Camera
from gvla2.geometry.compiled import fused
from gvla2.geometry.transform import FloatArray
from gvla2.geometry.views import View
from gvla2.reconstruction.support import projection

SAMPLES = 300
"""Pixels of each view that are compared with every other view."""
LOW, KNOTS = 4, 5
"""Stiff terms (scale, two tilts, relief), and knots of the field along each side of the object's box."""
ALIKE = 0.8
"""Cosine between two normals of one surface, at least."""
STEEP = 0.3
"""Cosine below which a surface is too steep for its plane to be trusted to the noise alone."""
UNKNOWNS = LOW + KNOTS * KNOTS
"""Unknowns of each view."""
_FEWEST = 30


@dataclass(frozen=True)
class DesignRows:
    """N rows of a sparse matrix over all unknowns: ``values`` (N, K) in ``columns`` (N, K)."""

    columns: NDArray[np.intp]
    values: FloatArray

    def __matmul__(self, theta: FloatArray) -> FloatArray:
        return np.asarray(np.einsum("nk,nk->n", self.values, theta.ravel()[self.columns]))

    def scaled(self, factor: FloatArray) -> DesignRows:
        """Each row times its factor (N,)."""
        return DesignRows(self.columns, self.values * factor[:, None])


class Basis:
    """B_i(u): how one view's depth may be wrong; view ``number``'s unknowns stand behind those of the views before."""

    def __init__(self, depth: FloatArray, number: int) -> None:
        rows, columns = np.nonzero(np.isfinite(depth))
        self._low = np.array([columns.min(), rows.min()]) + 0.5
        self._size = np.maximum(np.array([np.ptp(columns), np.ptp(rows)]), 1)
        self._middle = float(np.median(np.log(depth[rows, columns])))
        self._first = number * UNKNOWNS

    def at(self, uv: FloatArray, log_depth: FloatArray) -> DesignRows:
        """N rows at pixels (N, 2) of log depth (N,): the stiff terms, and the four knots around each pixel."""
        t = np.clip((uv - self._low) / self._size, 0.0, 1.0)  # (N, 2)
        knot = np.minimum((t * (KNOTS - 1)).astype(np.intp), KNOTS - 2)
        p = t * (KNOTS - 1) - knot
        past = p * p * (3 - 2 * p)
        ends = [1 - past, past]
        corners = [(right, down) for right in range(2) for down in range(2)]
        field = [ends[right][:, 0] * ends[down][:, 1] for right, down in corners]
        values = np.column_stack([np.ones(len(t)), 2 * t - 1, log_depth - self._middle, *field])
        stiff = [np.full(len(t), k) for k in range(LOW)]
        knots = [LOW + (knot[:, 0] + right) * KNOTS + knot[:, 1] + down for right, down in corners]
        return DesignRows(self._first + np.column_stack([*stiff, *knots]), values)


@dataclass(frozen=True)
class DepthSamples:
    """One view's solid depth and N samples of it.

    ``log_depth`` (H, W) NaN where not solid; ``rays`` (H, W, 3) of depth 1; ``normals`` (H, W, 3); of the samples
    ``pixels`` (N, 2), log depth ``at`` (N,), ``design``, and log depth of the hull's front and back. ``capped``:
    log depth (M,), design and log cap (M,) of the pixels behind whose cap nothing can lie.
    """

    camera: Camera
    basis: Basis
    log_depth: FloatArray
    rays: FloatArray
    normals: FloatArray
    pixels: NDArray[np.intp]
    at: FloatArray
    design: DesignRows
    nearest: FloatArray
    farthest: FloatArray
    capped: tuple[FloatArray, DesignRows, FloatArray]

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


def sample_view(
    number: int,
    view: View,
    rays: FloatArray,
    depth: FloatArray,
    solid: NDArray[np.bool_],
    front: FloatArray,
    back: FloatArray,
    caps: FloatArray,
) -> DepthSamples | None:
    """A view's samples; None where it shows too little of what the hull holds."""
    rows, columns = np.nonzero(solid & np.isfinite(depth) & np.isfinite(front) & np.isfinite(back))
    if len(rows) < _FEWEST:
        return None
    chosen = np.linspace(0, len(rows) - 1, min(SAMPLES, len(rows))).astype(int)
    rows, columns = rows[chosen], columns[chosen]
    pixels, basis = np.stack([columns, rows], axis=1), Basis(depth, number)
    at = np.log(depth[rows, columns])
    under = np.argwhere(np.isfinite(depth) & np.isfinite(caps))
    nearby = np.where(solid, depth, minimum_filter(np.where(np.isfinite(depth), depth, np.inf), 3))
    below: FloatArray = np.log(nearby[under[:, 0], under[:, 1]].astype(np.float64))
    capped = (
        below,
        basis.at((under[:, ::-1] + 0.5).astype(float), below),
        np.log(caps[under[:, 0], under[:, 1]]),
    )
    return DepthSamples(
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


def with_corrected_normals(one: DepthSamples, theta: FloatArray) -> DepthSamples:
    """The samples with the normals of their corrected surface: those of a tilted map would find no partner."""
    known = np.isfinite(one.log_depth)
    log = one.log_depth[known]
    depth = np.full(known.shape, np.nan)
    depth[known] = np.exp(log + one.basis.at(one.camera.pixel_centres()[known], log) @ theta)
    return replace(one, normals=surface_normals(depth, one.rays))


def surface_normals(depth: FloatArray, rays: FloatArray) -> FloatArray:
    """(H, W, 3) unit normals towards the camera of depth (H, W) on ``rays`` (H, W, 3); NaN where there is none."""
    normals = np.full(rays.shape, np.nan)
    _cross(np.ascontiguousarray(depth, dtype=np.float64), np.ascontiguousarray(rays), normals)
    return normals


@fused
def _cross(depth: FloatArray, rays: FloatArray, normals: FloatArray) -> None:
    across, down = np.empty(3), np.empty(3)
    for i in range(1, depth.shape[0] - 1):
        for j in range(1, depth.shape[1] - 1):
            for k in range(3):
                across[k] = depth[i, j + 1] * rays[i, j + 1, k] - depth[i, j - 1] * rays[i, j - 1, k]
                down[k] = depth[i + 1, j] * rays[i + 1, j, k] - depth[i - 1, j] * rays[i - 1, j, k]
            # v points down: this normal points back at the camera.
            x = down[1] * across[2] - down[2] * across[1]
            y = down[2] * across[0] - down[0] * across[2]
            z = down[0] * across[1] - down[1] * across[0]
            length = np.sqrt(x * x + y * y + z * z)
            normals[i, j, 0], normals[i, j, 1], normals[i, j, 2] = x / length, y / length, z / length


@dataclass(frozen=True)
class Pairs:
    """N samples of views i, each with a point of another view j and the plane through it.

    Of both, i and j: log depth ``at`` (N, 2), ``design`` (the unknowns of i, then those of j), how far a point of depth
    1 lies ``along`` (N, 2) the plane's normal; ``between`` (N,) metres along it from j's camera to i's.
    """

    at: FloatArray
    design: DesignRows
    along: FloatArray
    between: FloatArray

    def gaps(self, theta: FloatArray) -> tuple[FloatArray, DesignRows]:
        """(N,) distances from the planes in units of relative depth, and their slopes."""
        count, width = len(self.at), self.design.columns.shape[1] // 2
        wrong = self.design.values * theta.ravel()[self.design.columns]
        depth = np.exp(self.at + wrong.reshape(count, 2, width).sum(axis=2))
        reach = self.along * depth
        unit = np.sqrt(0.5 * np.maximum(reach**2, (STEEP * depth) ** 2).sum(axis=1))
        by = np.repeat(reach * [1, -1] / unit[:, None], width, axis=1)
        slopes = DesignRows(self.design.columns, self.design.values * by)
        return (reach[:, 0] - reach[:, 1] + self.between) / unit, slopes


def matched_pairs(sampled: Sequence[DepthSamples | None], theta: FloatArray, gate: float) -> Pairs | None:
    """All samples that see a surface of another view, normals alike and no more than ``gate`` apart; None: none."""
    shown = [one for one in sampled if one is not None]
    found = []
    for a in shown:
        normals, rays = a.picked(a.normals), a.picked(a.rays)
        points = a.camera.position + rays * np.exp(a.at + a.design @ theta)[:, None]
        found += [_link(a, points, normals, rays, b) for b in shown if a is not b]
    if not found:
        return None
    at, columns, values, along, between = (np.concatenate(each) for each in zip(*found, strict=True))
    near = np.abs(Pairs(at, DesignRows(columns, values), along, between).gaps(theta)[0]) < gate
    pairs = Pairs(at[near], DesignRows(columns[near], values[near]), along[near], between[near])
    return pairs if near.any() else None


def _link(
    a: DepthSamples, points: FloatArray, normals: FloatArray, rays: FloatArray, b: DepthSamples
) -> tuple[NDArray[Any], ...]:
    """The pixels of b on which the samples of a fall, where both have the same normal: the arrays of :class:`Pairs`.

    Of the samples ``points``, ``normals`` and ``rays`` (N, 3), world.
    """
    P = projection(b.camera)
    image = points @ P[:, :3].T + P[:, 3]
    with np.errstate(invalid="ignore", divide="ignore"):
        uv = image[:, :2] / image[:, 2:]
    which = np.flatnonzero((image[:, 2] > 0) & b.camera.inside(uv))
    column, row = uv[which].astype(np.intp).T
    # A comparison with NaN, where one has no normal, is false.
    same = np.einsum("nk,nk->n", normals[which], b.normals[row, column]) > ALIKE
    same &= np.isfinite(b.log_depth[row, column])
    which, row, column = which[same], row[same], column[same]
    at, normal = b.log_depth[row, column], b.normals[row, column]
    theirs = b.basis.at(np.stack([column, row], axis=1) + 0.5, at)
    along = [np.einsum("nk,nk->n", normal, r) for r in (rays[which], b.rays[row, column])]
    return (
        np.stack([a.at[which], at], axis=1),
        np.concatenate([a.design.columns[which], theirs.columns], axis=1),
        np.concatenate([a.design.values[which], theirs.values], axis=1),
        np.stack(along, axis=1),
        normal @ (a.camera.position - b.camera.position),
    )
