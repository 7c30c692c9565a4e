"""How deep points of a grid lie inside a closed mesh."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation, binary_erosion
from scipy.spatial import cKDTree

from gvla2.geometry.mesh import TriangleMesh
from gvla2.geometry.transform import FloatArray
from gvla2.reconstruction.compiled import compiled, cores
from gvla2.reconstruction.occupancy import Field

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


@compiled
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
