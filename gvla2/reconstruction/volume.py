"""One volume for all evidence: masks, free space and surface from each depth map, and G0 where nobody looked.

Each depth map says of a voxel how far it lies behind the surface. Maps that see one surface, by their normals, are
averaged; what different surfaces say is cut: solid is what lies behind all of them (a directional TSDF, Splietker and
Behnke 2019, taken pairwise). A mean over all maps would let the front of a thin object meet its back; a cut of single
maps, which is carving, would take the worst error of all. With exact depth the two are the same and this is carving.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation, binary_erosion, label
from scipy.spatial import cKDTree

from gvla2.geometry.compiled import cores, fused, run_chunks
from gvla2.geometry.mesh import TriangleMesh
from gvla2.geometry.transform import FloatArray
from gvla2.reconstruction.carving import Field
from gvla2.reconstruction.depth_evidence import DepthEvidence
from gvla2.reconstruction.support import mask_of, projection
from gvla2.reconstruction.view_set import ViewSet

_SAMPLES = 60_000


def mesh_field(mesh: TriangleMesh, grid: Field, where: NDArray[np.bool_]) -> NDArray[np.float32]:
    """(X, Y, Z) float32 metres inside ``mesh`` at the grid's voxels, negative outside.

    Exact at voxels of ``where`` that lie beside the surface, +- two steps elsewhere. Inside is where lines along z
    enter more often than they leave, whichever way the faces are wound, so that small gaps do little harm.
    """
    crossings = np.zeros((*grid.values.shape[:2], grid.values.shape[2] + 1), dtype=np.int32)
    local = (mesh.vertices - grid.origin) / grid.step
    _cross(local, mesh.faces, crossings)
    # Counted from below up: faces that look down begin the inside, those that look up end it.
    inside = np.cumsum(crossings, axis=2)[:, :, :-1] != 0
    values = np.where(inside, 2 * grid.step, -2 * grid.step).astype(np.float32)
    rim = binary_dilation(inside, iterations=2) & ~binary_erosion(inside, iterations=2) & where
    index = np.argwhere(rim)
    if len(index) and mesh.areas.sum() > 0:
        surface = mesh.sample(_SAMPLES, np.random.default_rng(0))[0]
        distance, _ = cKDTree(surface).query(grid.points(index), workers=cores())
        values[rim] = np.where(inside[rim], distance, -distance)
    return values


@fused
def _cross(vertices: FloatArray, faces: NDArray[np.int64], crossings: NDArray[np.int32]) -> None:
    """Add each face's crossing of every vertical grid line to the first voxel above it."""
    nx, ny, nz = crossings.shape
    for f in range(len(faces)):
        a, b, c = vertices[faces[f, 0]], vertices[faces[f, 1]], vertices[faces[f, 2]]
        area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
        if area == 0.0:
            continue
        sign = 1 if area < 0 else -1
        # A hair's breadth off the lines: vertices of marching cubes lie on them.
        for i in range(
            max(int(np.ceil(min(a[0], b[0], c[0]))) - 1, 0),
            min(int(np.floor(max(a[0], b[0], c[0]))) + 1, nx - 1) + 1,
        ):
            x = i + 1.234e-5
            for j in range(
                max(int(np.ceil(min(a[1], b[1], c[1]))) - 1, 0),
                min(int(np.floor(max(a[1], b[1], c[1]))) + 1, ny - 1) + 1,
            ):
                y = j + 2.345e-5
                p = ((b[0] - x) * (c[1] - y) - (b[1] - y) * (c[0] - x)) / area
                q = ((c[0] - x) * (a[1] - y) - (c[1] - y) * (a[0] - x)) / area
                r = 1.0 - p - q
                if p >= 0 and q >= 0 and r >= 0:
                    k = int(np.ceil(p * a[2] + q * b[2] + r * c[2]))
                    if k <= nz - 1:
                        crossings[i, j, max(k, 0)] += sign


BAND = 3.0
"""Voxels on either side of a depth map's surface within which it measures their distance."""
SURE = 3.0
"""Standard deviations of depth that this band is wide at least."""
SOLID = 0.75
"""Mask value from which on something must lie on a pixel's ray."""


@dataclass(frozen=True)
class Posterior:
    """``field``: metres inside the object; ``confidence`` (X, Y, Z) float32: the summed weight of the depth pixels
    measured at each voxel, 0 where the masks and G0 alone speak. ``needed`` (N, 3): points that depth had cut away,
    and some mask's ray found nothing else.
    """

    field: Field
    confidence: NDArray[np.float32]
    needed: FloatArray


def fuse_volume(seen: ViewSet, evidence: DepthEvidence, g0: TriangleMesh | None) -> Posterior:
    """The object within its masks' visual hull as the depth maps see it.

    Voxels that no map measures are G0's, or the hull's where G0 has no mesh. Where a solid pixel of a mask would be
    left without anything on its ray, the likeliest voxel of the ray is filled: thin objects stay whole.
    """
    hull, views = seen.hull, seen.views
    usual = float(np.nanmedian(evidence.depth) * np.nanmedian(evidence.std))
    band = max(BAND * hull.step, SURE * usual)
    values, confidence = hull.values.copy(), np.zeros(hull.values.shape, dtype=np.float32)
    arrays = (
        hull.origin,
        hull.step,
        np.stack([projection(view.camera) for view in views]),
        np.stack([view.camera.position for view in views]),
        np.nan_to_num(evidence.depth),
        evidence.normals,
        evidence.weight,
        band,
        8 * hull.step,
    )

    run_chunks(partial(_fuse, values, confidence, *arrays), len(values), least=16)
    if g0 is not None and len(g0.faces):
        unseen = (confidence == 0) & (hull.values > -hull.step)
        values[unseen] = np.minimum(values, mesh_field(g0, hull, unseen))[unseen]
    front, back = (np.nan_to_num(ends) for ends in seen.hull_interval)
    cut = values <= 0
    for s, view in enumerate(views):
        ends = view.camera.position, seen.rays[s], front[s], back[s]
        _cover(values, hull.values, hull.origin, hull.step, *ends, mask_of(view))
    needed = hull.points(np.argwhere(cut & (values > 0)))
    # The field is closed at the grid's end, so that the corner lies outside.
    empty, _ = label(values <= 0)
    values[(empty > 0) & (empty != empty[0, 0, 0])] = hull.step
    return Posterior(Field(values, hull.origin, hull.step), confidence, needed)


@fused
def _fuse(
    values: NDArray[np.float32],
    confidence: NDArray[np.float32],
    origin: FloatArray,
    step: float,
    projections: FloatArray,
    centres: FloatArray,
    depth: FloatArray,
    normals: FloatArray,
    weights: FloatArray,
    band: float,
    jump: float,
    start: int,
    stop: int,
) -> None:
    _, ny, nz = values.shape
    count, height, width = depth.shape
    behind, weight, known = np.zeros(count), np.zeros(count), np.zeros(count, dtype=np.int64)
    facing = np.zeros((count, 3))
    for i in range(start, stop):
        for j in range(ny):
            for k in range(nz):
                if values[i, j, k] <= -step:
                    continue
                x, y, z = origin[0] + step * i, origin[1] + step * j, origin[2] + step * k
                free = False
                total = 0.0
                for a in range(count):
                    known[a] = 0
                    P = projections[a]
                    far = P[2, 0] * x + P[2, 1] * y + P[2, 2] * z + P[2, 3]
                    if far <= 0:
                        continue
                    u = (P[0, 0] * x + P[0, 1] * y + P[0, 2] * z + P[0, 3]) / far
                    v = (P[1, 0] * x + P[1, 1] * y + P[1, 2] * z + P[1, 3]) / far
                    column, row = int(np.floor(u)), int(np.floor(v))
                    if column < 0 or row < 0 or column >= width or row >= height:
                        continue
                    d = depth[a, row, column]
                    w = weights[a, row, column]
                    if d <= 0 or w <= 0:
                        continue
                    left, top = int(np.floor(u - 0.5)), int(np.floor(v - 0.5))
                    if left >= 0 and top >= 0 and left + 1 < width and top + 1 < height:
                        d00, d01 = depth[a, top, left], depth[a, top, left + 1]
                        d10, d11 = depth[a, top + 1, left], depth[a, top + 1, left + 1]
                        low, high = min(min(d00, d01), min(d10, d11)), max(max(d00, d01), max(d10, d11))
                        # One surface: between its pixels, not across an edge.
                        if low > 0 and high - low < jump:
                            p, q = u - 0.5 - left, v - 0.5 - top
                            d = (1 - q) * ((1 - p) * d00 + p * d01) + q * ((1 - p) * d10 + p * d11)
                    n = normals[a, row, column]
                    slope = (
                        n[0] * (x - centres[a, 0]) + n[1] * (y - centres[a, 1]) + n[2] * (z - centres[a, 2])
                    )
                    cosine = -slope / far
                    # Along the surface's normal: so the maps of one surface measure alike.
                    away = (far - d) * max(cosine, 0.3)
                    if away > band:
                        continue  # hidden behind the surface: nothing is known
                    total += w
                    if away <= -band:
                        free = True
                    known[a] = 1
                    behind[a], weight[a] = max(away, -band), w * max(cosine, 0.05)
                    facing[a, 0], facing[a, 1], facing[a, 2] = n[0], n[1], n[2]
                if total == 0.0:
                    continue
                confidence[i, j, k] = total
                least = band
                for a in range(count):
                    if known[a] == 0 or free:
                        continue
                    above, below = 0.0, 0.0
                    for b in range(count):
                        if known[b] == 0:
                            continue
                        alike = 1.0
                        if a != b:
                            alike = (
                                facing[a, 0] * facing[b, 0]
                                + facing[a, 1] * facing[b, 1]
                                + facing[a, 2] * facing[b, 2]
                            )
                        if alike > 0:
                            share = weight[b] * alike**4
                            above += share * behind[b]
                            below += share
                    least = min(least, above / below)
                if free:
                    least = -band
                values[i, j, k] = min(values[i, j, k], least)


@fused
def _cover(
    values: NDArray[np.float32],
    hull: NDArray[np.float32],
    origin: FloatArray,
    step: float,
    centre: FloatArray,
    rays: FloatArray,
    front: FloatArray,
    back: FloatArray,
    mask: NDArray[np.float32],
) -> None:
    nx, ny, nz = values.shape
    for row in range(mask.shape[0]):
        for column in range(mask.shape[1]):
            if mask[row, column] < SOLID or front[row, column] <= 0:
                continue
            ray = rays[row, column]
            stride = 0.5 * step / np.sqrt(ray[0] ** 2 + ray[1] ** 2 + ray[2] ** 2)
            t = front[row, column] - 2 * stride
            best, bi, bj, bk = -np.inf, -1, -1, -1
            while t <= back[row, column] + 2 * stride and best <= 0:
                i = int(np.round((centre[0] + ray[0] * t - origin[0]) / step))
                j = int(np.round((centre[1] + ray[1] * t - origin[1]) / step))
                k = int(np.round((centre[2] + ray[2] * t - origin[2]) / step))
                within = 0 <= i < nx and 0 <= j < ny and 0 <= k < nz
                if within and hull[i, j, k] > -0.5 * step and values[i, j, k] > best:
                    best, bi, bj, bk = values[i, j, k], i, j, k
                t += stride
            if best <= 0 and bi >= 0:
                values[bi, bj, bk] = 0.3 * step
