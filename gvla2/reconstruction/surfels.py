"""Surfaces as flat Gaussians, and Gaussians put on a new surface with the attributes that they had on the old one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from gvla2.errors import GeometryError
from gvla2.geometry.compiled import cores, fused
from gvla2.geometry.gaussians import SH_C0, Gaussians
from gvla2.geometry.mesh import TriangleMesh
from gvla2.geometry.transform import FloatArray

_ROUNDS = 6  # of darts, each as many as Gaussians are wanted
_PACKING = 0.715  # least distance of darts over sqrt(area / count): gives that count within a few per cent
_WIDTH = 0.50  # standard deviation over the mean spacing: the least that leaves no hole
_FLATNESS = 0.15  # thickness over width
_OPACITY_LOGIT = 4.0  # 0.982
_GREY = np.array([0.5, 0.5, 0.5])


def surfels(mesh: TriangleMesh, normals: FloatArray | None = None, count: int = 15_000) -> Gaussians:
    """About ``count`` flat, opaque Gaussians on a mesh, no two too close (a Poisson-disk sampling).

    ``normals`` (V, 3): unit normals of the vertices; the faces' own serve when there are none. Colours are the
    mesh's, grey when it has none. Deterministic. Raises :class:`GeometryError` when
    ``count`` is not positive or no face has an area.
    """
    if count < 1:
        raise GeometryError(f"At least one Gaussian is needed, got a count of {count}.")
    points, face, weights = scattered(mesh, count)
    corners = mesh.faces[face]
    across = mesh.normals[face] if normals is None else _mix(weights, normals[corners])
    colours = _GREY if mesh.colours is None else _mix(weights, mesh.colours[corners])
    # As many as were kept share the surface between them.
    width = _WIDTH * float(np.sqrt(mesh.areas.sum() / len(points)))
    n = len(points)
    return Gaussians(
        centres=points.astype(np.float32),
        log_scales=np.tile(np.log([width, width, _FLATNESS * width]).astype(np.float32), (n, 1)),
        rotations=turned_to(across),
        opacity_logits=np.full(n, _OPACITY_LOGIT, dtype=np.float32),
        sh_dc=np.broadcast_to((colours - 0.5) / SH_C0, (n, 3)).astype(np.float32),
    )


def _mix(weights: FloatArray, values: FloatArray) -> FloatArray:
    """(N, 3) of weights (N, 3) for the corners' values (N, 3, 3)."""
    mixed: FloatArray = np.einsum("nk,nkc->nc", weights, values)
    return mixed


def turned_to(normals: FloatArray) -> NDArray[np.float32]:
    """(N, 4) quaternions wxyz that turn z to the normals (N, 3) by the shortest way."""
    x, y, z = (normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)).T
    quaternions = np.stack([1.0 + z, -y, x, np.zeros_like(x)], axis=1)
    quaternions[z < -1 + 1e-9] = [0.0, 1.0, 0.0, 0.0]
    return np.asarray(quaternions / np.linalg.norm(quaternions, axis=1, keepdims=True), dtype=np.float32)


def scattered(mesh: TriangleMesh, count: int) -> tuple[FloatArray, NDArray[np.int64], FloatArray]:
    """About ``count`` points (N, 3) on a mesh, no two too close, their faces (N,) and weights of the corners (N, 3).

    Darts are thrown in rounds, each with one dart for each ``count``-th of the surface: it goes over the surface in the
    faces' order, so that a dart's neighbours are still at hand, and the next round fills the gaps.
    Raises :class:`GeometryError` when no face has an area.
    """
    areas = mesh.areas
    solid = np.flatnonzero(areas > 0)
    if len(solid) == 0:
        raise GeometryError(f"No face of the mesh has an area ({len(areas)} faces): nothing to sample.")
    ends = np.cumsum(areas[solid])
    chance = np.random.default_rng(0).random((_ROUNDS, count, 3))
    distance = _PACKING * float(np.sqrt(ends[-1] / count))
    table = np.full(1 << int(np.ceil(np.log2(count + 1))), -1, dtype=np.int32)
    points, face, weights = _throw(
        mesh.vertices[mesh.faces[solid]], ends, chance, mesh.vertices.min(axis=0), distance, table
    )
    return points, solid[face], weights


@fused
def _throw(
    corners: FloatArray,
    ends: FloatArray,
    chance: FloatArray,
    low: FloatArray,
    distance: float,
    table: NDArray[np.int32],
) -> tuple[FloatArray, NDArray[np.int64], FloatArray]:
    """``table`` holds the last point that was kept of each cell's hash, ``following`` the one kept before it."""
    rounds, count, _ = chance.shape
    points, weights = np.empty((rounds * count, 3)), np.empty((rounds * count, 3))
    face = np.empty(rounds * count, dtype=np.int64)
    following = np.empty(rounds * count, dtype=np.int32)
    last, kept, side = len(table) - 1, 0, 2 * distance
    for turn in range(rounds):
        f = 0
        for i in range(count):
            at = ends[-1] * (i + chance[turn, i, 0]) / count
            while ends[f] <= at and f < len(ends) - 1:
                f += 1
            # The square root makes the triangle's far side as dense as its tip (Osada et al. 2002, eq. 1).
            u, v = np.sqrt(chance[turn, i, 1]), chance[turn, i, 2]
            wa, wb, wc = 1 - u, u * (1 - v), u * v
            x = wa * corners[f, 0, 0] + wb * corners[f, 1, 0] + wc * corners[f, 2, 0]
            y = wa * corners[f, 0, 1] + wb * corners[f, 1, 1] + wc * corners[f, 2, 1]
            z = wa * corners[f, 0, 2] + wb * corners[f, 1, 2] + wc * corners[f, 2, 2]
            # Of cells twice as wide as the distance, the own one and on each axis the nearer of its neighbours will do.
            p, q, r = (x - low[0]) / side, (y - low[1]) / side, (z - low[2]) / side
            px, qy, rz = int(p), int(q), int(r)
            free, own = True, 0
            for n in range(8):
                cx = 2 * int(p + 0.5) - 1 - px if n & 1 else px
                cy = 2 * int(q + 0.5) - 1 - qy if n & 2 else qy
                cz = 2 * int(r + 0.5) - 1 - rz if n & 4 else rz
                place = (cx * 73856093 ^ cy * 19349663 ^ cz * 83492791) & last
                own = place if n == 0 else own
                # Two cells may share a place; the distance separates their points.
                j = table[place]
                while j >= 0 and free:
                    across, along, up = x - points[j, 0], y - points[j, 1], z - points[j, 2]
                    free = across * across + along * along + up * up >= distance * distance
                    j = following[j]
                if not free:
                    break
            if free:
                points[kept, 0], points[kept, 1], points[kept, 2] = x, y, z
                weights[kept, 0], weights[kept, 1], weights[kept, 2] = wa, wb, wc
                face[kept], following[kept] = f, table[own]
                table[own] = kept
                kept += 1
    return points[:kept].copy(), face[:kept].copy(), weights[:kept].copy()


def place(
    old: Gaussians, old_mesh: TriangleMesh | None, mesh: TriangleMesh, normals: FloatArray
) -> Gaussians:
    """As many Gaussians as ``old``, within a few per cent, evenly spread over ``mesh``.

    Each takes opacity, scales, rotation and colour of the nearest old one. ``old_mesh`` is where the old ones lie,
    if known; ``normals`` (V, 3) are ``mesh``'s. Scales grow or shrink with the spacing, rotations turn with the surface
    by the shortest way, constant colours are the mesh's where it has any.
    """
    spread = surfels(mesh, normals, len(old))
    source = cKDTree(old.centres).query(spread.centres, workers=cores())[1]
    across = _rotation(spread.rotations).apply([0.0, 0.0, 1.0])
    spacing = np.sqrt(mesh.areas.sum() / len(spread))
    before = (
        np.sqrt(old_mesh.areas.sum() / len(old))
        if old_mesh is not None and old_mesh.areas.sum() > 0
        else spacing
    )
    own = _rotation(old.rotations[source])
    was = own.apply(np.eye(3)[np.argmin(old.log_scales[source], axis=1)])
    was *= np.where(np.einsum("nk,nk->n", was, across) < 0, -1, 1)[:, None]
    # The shortest way from one unit vector to another, less than half a turn.
    halfway = np.column_stack([np.cross(was, across), 1 + np.einsum("nk,nk->n", was, across)])
    turned = (Rotation.from_quat(halfway) * own).as_quat(scalar_first=True)
    return replace(
        spread,
        log_scales=old.log_scales[source] + np.float32(np.log(spacing / before)),
        rotations=turned.astype(np.float32),
        opacity_logits=old.opacity_logits[source],
        sh_dc=old.sh_dc[source] if mesh.colours is None else spread.sh_dc,
    )


def _rotation(quaternions: NDArray[np.float32]) -> Rotation:
    """Rotations of quaternions wxyz (N, 4) of any length."""
    return Rotation.from_quat(quaternions, scalar_first=True)
