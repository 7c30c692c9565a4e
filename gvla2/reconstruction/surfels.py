"""Surfaces as flat Gaussians, evenly spread."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from trimesh.triangles import points_to_barycentric

from gvla2.errors import GeometryError
from gvla2.geometry.gaussians import SH_C0, Gaussians
from gvla2.geometry.mesh import Mesh
from gvla2.geometry.transform import FloatArray
from gvla2.reconstruction.compiled import compiled

_CANDIDATES = 6  # for each Gaussian wanted
_PACKING = 0.715  # least distance of darts over sqrt(area / count): gives that count within a few per cent
_WIDTH = 0.50  # standard deviation over the mean spacing: the least that leaves no hole
_FLATNESS = 0.15  # thickness over width
_OPACITY_LOGIT = 4.0  # 0.982
_GREY = np.array([0.5, 0.5, 0.5])


def surfels(mesh: Mesh, normals: FloatArray | None = None, count: int = 15_000) -> Gaussians:
    """About ``count`` flat, opaque Gaussians on a mesh, no two too close (a Poisson-disk sampling).

    ``normals`` (V, 3): unit normals of the vertices; the faces' own serve when there are none. Colours are the
    mesh's, grey when it has none; there are no higher harmonics. Deterministic. Raises :class:`GeometryError` when
    ``count`` is not positive or no face has an area.
    """
    if count < 1:
        raise GeometryError(f"At least one Gaussian is needed, got a count of {count}.")
    rng = np.random.default_rng(0)
    candidates, face = mesh.sample(_CANDIDATES * count, rng)
    spacing = float(np.sqrt(mesh.areas.sum() / count))
    kept = _darts(candidates, _PACKING * spacing)
    points, face = candidates[kept], face[kept]
    weights = barycentric(points, mesh, face)
    corners = mesh.faces[face]
    across = mesh.normals[face] if normals is None else _mix(weights, normals[corners])
    colours = _GREY if mesh.colours is None else _mix(weights, mesh.colours[corners])
    # As many as were kept share the surface between them.
    width = _WIDTH * float(np.sqrt(mesh.areas.sum() / len(points)))
    n = len(points)
    return Gaussians(
        centres=points.astype(np.float32),
        log_scales=np.log(np.tile([width, width, _FLATNESS * width], (n, 1))).astype(np.float32),
        rotations=turned_to(across),
        opacity_logits=np.full(n, _OPACITY_LOGIT, dtype=np.float32),
        sh_dc=np.broadcast_to((colours - 0.5) / SH_C0, (n, 3)).astype(np.float32),
    )


def _mix(weights: FloatArray, values: FloatArray) -> FloatArray:
    """(N, 3) of weights (N, 3) for the corners' values (N, 3, 3)."""
    mixed: FloatArray = np.einsum("nk,nkc->nc", weights, values)
    return mixed


def barycentric(points: FloatArray, mesh: Mesh, face: NDArray[np.int64]) -> FloatArray:
    """(N, 3) weights of the corners of the face (N,) that each point (N, 3) lies on."""
    weights = points_to_barycentric(mesh.vertices[mesh.faces[face]], points)
    return np.asarray(np.clip(weights, 0.0, 1.0), dtype=np.float64)


def turned_to(normals: FloatArray) -> NDArray[np.float32]:
    """(N, 4) quaternions wxyz that turn z to the normals (N, 3) by the shortest way."""
    x, y, z = (normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)).T
    quaternions = np.stack([1.0 + z, -y, x, np.zeros_like(x)], axis=1)
    quaternions[z < -1 + 1e-9] = [0.0, 1.0, 0.0, 0.0]
    return np.asarray(quaternions / np.linalg.norm(quaternions, axis=1, keepdims=True), dtype=np.float32)


def _darts(points: FloatArray, distance: float) -> NDArray[np.int64]:
    """Indices of points (N, 3), taken in their order, none nearer than ``distance`` to one taken before."""
    cells = np.floor((points - points.min(axis=0)) / distance).astype(np.int32)
    table = np.full(1 << int(np.ceil(np.log2(len(points) + 1))), -1, dtype=np.int32)
    return _throw(points, cells, distance * distance, table, np.full(len(points), -1, dtype=np.int32))


@compiled
def _throw(
    points: FloatArray,
    cells: NDArray[np.int32],
    least: float,
    table: NDArray[np.int32],
    following: NDArray[np.int32],
) -> NDArray[np.int64]:
    """``table`` holds the last point that was kept of each cell's hash, ``following`` the one kept before it."""
    kept = np.zeros(len(points), dtype=np.bool_)
    last = len(table) - 1
    for i in range(len(points)):
        free = True
        own = 0
        for n in range(27):  # the point's own cell first: most darts fall near one of its own
            m = (n + 13) % 27
            x, y, z = cells[i, 0] + m // 9 - 1, cells[i, 1] + m // 3 % 3 - 1, cells[i, 2] + m % 3 - 1
            # Two cells may share a place; the distance tells their points apart.
            at = (x * 73856093 ^ y * 19349663 ^ z * 83492791) & last
            own = at if n == 0 else own
            j = table[at]
            while j >= 0 and free:
                across, along, up = (
                    points[i, 0] - points[j, 0],
                    points[i, 1] - points[j, 1],
                    points[i, 2] - points[j, 2],
                )
                free = across * across + along * along + up * up >= least
                j = following[j]
            if not free:
                break
        kept[i] = free
        if free:
            following[i] = table[own]
            table[own] = i
    return np.flatnonzero(kept)
