"""prototype"""

from __future__ import annotations

import os
import numpy as np
from numpy.typing import NDArray

from gvla2.geometry.mesh import Mesh
from gvla2.geometry.transform import FloatArray
from gvla2.geometry.views import Views
from gvla2.reconstruction.carving import hull_field, surface_of
from gvla2.reconstruction.compiled import compiled
from gvla2.reconstruction.contracts import GeometryEstimate
from gvla2.reconstruction.depth_alignment import align
from gvla2.reconstruction.occupancy import Field
from gvla2.reconstruction.prior_depth import _surface
from gvla2.reconstruction.sim3 import depth_scale
from gvla2.reconstruction.support import mask_of
from gvla2.reconstruction.zbuffer import depth_map

BAND = 3.0
ALIGN = os.environ.get("ALIGN", "1") == "1"
COVER = os.environ.get("COVER", "1") == "1"
SHRINK = float(os.environ.get("SHRINK", "0"))
BELIEVE = os.environ.get("BELIEVE", "1") == "1"
GAP = float(os.environ.get("GAP", "0.06"))
WSTD = int(os.environ.get("WSTD", "1"))
DEBUG = os.environ.get("DEBUG")


def extent(mesh: Mesh, views: Views):
    front = np.stack([depth_map(mesh, v.camera) for v in views]).astype(np.float64)
    back = np.stack([depth_map(mesh, v.camera, farthest=True) for v in views]).astype(np.float64)
    return np.where(np.isfinite(front), front, np.nan), np.where(np.isfinite(back), back, np.nan)


def surfaces(depth, views, jump):
    normals = np.full((*depth.shape, 3), np.nan)
    solid = np.zeros(depth.shape, dtype=bool)
    for s, view in enumerate(views):
        smooth, normals[s], _ = _surface(view.camera.backproject(depth[s]), depth[s], view.camera.position, jump)
        solid[s] = smooth & np.isfinite(normals[s]).all(axis=-1)
    return solid, normals


def fused_surface(mesh: Mesh, views: Views, prior: GeometryEstimate) -> Mesh:
    depth = np.where(prior.depth > 0, prior.depth, np.nan) * depth_scale(prior, views)
    masks = np.stack([mask_of(v) for v in views])
    depth = np.where(masks > 0.5, depth, np.nan).astype(np.float64)
    hull = hull_field(views)
    vertices, faces, _ = surface_of(hull)
    shape = Mesh(vertices, faces)
    front, back = extent(shape, views)
    size = float(np.linalg.norm(np.ptp(vertices, axis=0)))
    # a first scale, so that jumps are metres
    for s in range(len(depth)):
        depth[s] *= np.nanmedian(front[s] / depth[s])
    solid, normals = surfaces(depth, views, 0.025 * size)
    sigma = 0.0
    if ALIGN:
        aligned = align(depth, solid, normals, views, front, back)
        depth, sigma = aligned.depth, aligned.sigma
        if BELIEVE:
            depth = believed(depth, aligned.std, front, back)
        solid, normals = surfaces(depth, views, 0.025 * size)
        if DEBUG:
            print("  sigma", sigma, "theta", np.round(aligned.theta[:, :4], 3).tolist(), "field", np.sqrt(np.mean(aligned.theta[:, 4:] ** 2)))
    weight = prior.confidence if not WSTD else np.nan_to_num(1e-4 / aligned.std**2) * (prior.confidence if WSTD==2 else 1.0)
    field = fuse(hull, views, depth, normals, weight, sigma, front, back)
    vertices, faces, _ = surface_of(field)
    return Mesh(vertices, faces)


def believed(depth, std, front, back):
    """Posterior mean of depth: a Gaussian about what was told, times how far surfaces lie behind a hull."""
    far = np.maximum(back - front, 1e-6)
    length = GAP * far
    sigma = np.maximum(std * depth, 1e-6)
    nodes = np.linspace(-3, 3, 25)
    top, bottom = np.zeros_like(depth), np.zeros_like(depth)
    for z in nodes:
        g = depth - front + sigma * z
        p = np.exp(-0.5 * z * z) / (1 + (g / length) ** 2) * ((g >= 0) & (g <= far))
        top += p * g
        bottom += p
    mean = np.where(bottom > 1e-9, top / np.maximum(bottom, 1e-12), np.clip(depth - front, 0, far))
    return np.where(np.isfinite(front), front + mean, depth)


def fuse(hull, views, depth, normals, confidence, sigma, front, back):
    values = hull.values.copy()
    typical = float(np.nanmedian(depth))
    band = max(BAND * hull.step, 3 * sigma * typical)
    P = np.stack([v.camera.K @ v.camera.camera_from_world[:3] for v in views])
    centres = np.stack([v.camera.position for v in views])
    filled = np.nan_to_num(depth, nan=0.0)
    n = np.nan_to_num(normals, nan=0.0).astype(np.float32)
    _fuse(values, hull.origin, hull.step, P, centres, filled, n, np.ascontiguousarray(confidence, dtype=np.float64), band, 0.025 * 1.0)
    if SHRINK:
        inside = np.isfinite(values)
        g = hull.values
        push = (sigma * typical) ** 2 / SHRINK
        values = np.where(values < hull.values, np.minimum(values + push, hull.values), values).astype(np.float32)
    if COVER:
        for s, view in enumerate(views):
            keep_covered(values, hull, view, front[s], back[s], mask_of(view))
    return Field(values, hull.origin, hull.step)


def keep_covered(values, hull, view, front, back, mask):
    _cover(values, hull.values, hull.origin, hull.step, view.camera.position, np.ascontiguousarray(view.camera.rays()[1]),
           np.nan_to_num(front, nan=0.0), np.nan_to_num(back, nan=0.0), mask.astype(np.float32))


@compiled
def _cover(values, hull, origin, step, centre, rays, front, back, mask):
    nx, ny, nz = values.shape
    for r in range(mask.shape[0]):
        for c in range(mask.shape[1]):
            if mask[r, c] < 0.75 or front[r, c] <= 0:
                continue
            dx, dy, dz = rays[r, c, 0], rays[r, c, 1], rays[r, c, 2]
            long = np.sqrt(dx * dx + dy * dy + dz * dz)
            t = front[r, c] - step
            end = back[r, c] + step
            best = -1e9
            bi = bj = bk = -1
            while t <= end:
                x = (centre[0] + dx * t - origin[0]) / step
                y = (centre[1] + dy * t - origin[1]) / step
                z = (centre[2] + dz * t - origin[2]) / step
                i, j, k = int(round(x)), int(round(y)), int(round(z))
                if i >= 0 and j >= 0 and k >= 0 and i < nx and j < ny and k < nz:
                    v = values[i, j, k]
                    if v > best and hull[i, j, k] > -0.5 * step:
                        best = v
                        bi, bj, bk = i, j, k
                    if v > 0:
                        break
                t += 0.5 * step / long
            if best <= 0 and bi >= 0:
                values[bi, bj, bk] = 0.3 * step


@compiled
def _fuse(values, origin, step, P, centres, depth, normals, confidence, band, jump):
    nx, ny, nz = values.shape
    count, height, width = depth.shape
    s = np.zeros(count)
    w = np.zeros(count)
    ns = np.zeros((count, 3))
    state = np.zeros(count, dtype=np.int64)
    for i in range(nx):
        for j in range(ny):
            for k in range(nz):
                if values[i, j, k] <= -step:
                    continue
                x, y, z = origin[0] + step * i, origin[1] + step * j, origin[2] + step * k
                seen = 0
                for a in range(count):
                    state[a] = 0
                    zz = P[a, 2, 0] * x + P[a, 2, 1] * y + P[a, 2, 2] * z + P[a, 2, 3]
                    if zz <= 0:
                        continue
                    u = (P[a, 0, 0] * x + P[a, 0, 1] * y + P[a, 0, 2] * z + P[a, 0, 3]) / zz - 0.5
                    v = (P[a, 1, 0] * x + P[a, 1, 1] * y + P[a, 1, 2] * z + P[a, 1, 3]) / zz - 0.5
                    c0, r0 = int(np.floor(u)), int(np.floor(v))
                    col, row = int(np.floor(u + 0.5)), int(np.floor(v + 0.5))
                    if col < 0 or row < 0 or col >= width or row >= height:
                        continue
                    d = depth[a, row, col]
                    if d <= 0:
                        continue
                    if c0 >= 0 and r0 >= 0 and c0 + 1 < width and r0 + 1 < height:
                        d00, d01 = depth[a, r0, c0], depth[a, r0, c0 + 1]
                        d10, d11 = depth[a, r0 + 1, c0], depth[a, r0 + 1, c0 + 1]
                        low = min(min(d00, d01), min(d10, d11))
                        high = max(max(d00, d01), max(d10, d11))
                        if low > 0 and high - low < jump:
                            fu, fv = u - c0, v - r0
                            d = (1 - fv) * ((1 - fu) * d00 + fu * d01) + fv * ((1 - fu) * d10 + fu * d11)
                    n0, n1, n2 = normals[a, row, col, 0], normals[a, row, col, 1], normals[a, row, col, 2]
                    rx, ry, rz = (x - centres[a, 0]) / zz, (y - centres[a, 1]) / zz, (z - centres[a, 2]) / zz
                    cosine = -(n0 * rx + n1 * ry + n2 * rz)
                    factor = max(cosine, 0.3)
                    away = (zz - d) * factor
                    if away > band:
                        continue
                    ns[a, 0], ns[a, 1], ns[a, 2] = n0, n1, n2
                    w[a] = confidence[a, row, col] * max(cosine, 0.05)
                    s[a] = max(away, -band)
                    state[a] = 1 if away > -band else 2
                    seen += 1
                if seen == 0:
                    continue
                least = band
                for a in range(count):
                    if state[a] == 0:
                        continue
                    if state[a] == 2:
                        least = -band
                        break
                    top, bottom = 0.0, 0.0
                    for b in range(count):
                        if state[b] != 1:
                            continue
                        alike = ns[a, 0] * ns[b, 0] + ns[a, 1] * ns[b, 1] + ns[a, 2] * ns[b, 2]
                        if a == b:
                            alike = 1.0
                        if alike > 0:
                            share = w[b] * alike**4
                            top += share * s[b]
                            bottom += share
                    if bottom > 0:
                        least = min(least, top / bottom)
                values[i, j, k] = min(values[i, j, k], least)
