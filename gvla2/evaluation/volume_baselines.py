"""Two plain ways to use depth maps, as rows beside the branch: carving, and a truncated signed distance field.

Both get the same prior as the branch, and the masks. Neither estimates an error or keeps anything of G0.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from gvla2.errors import GeometryError
from gvla2.geometry.camera import Camera
from gvla2.geometry.mesh import TriangleMesh
from gvla2.geometry.transform import FloatArray
from gvla2.geometry.views import Views
from gvla2.reconstruction.appearance import vertex_colours
from gvla2.reconstruction.carving import Field, hull_field, surface_of
from gvla2.reconstruction.contracts import GeometryEstimate, Reconstruction, Renderer
from gvla2.reconstruction.depth_evidence import camera_scale
from gvla2.reconstruction.inset import inset, outward_normals
from gvla2.reconstruction.silhouette import depth_map, mask_silhouettes
from gvla2.reconstruction.surfels import surfels

ROUNDS = 4
TRUNCATION = 6.0
"""Voxels on either side of a surface that a TSDF remembers."""


class _Sight(NamedTuple):
    """Where the voxels of a grid (X, Y, Z) lie in a view: their pixels, and their depth in metres, NaN outside."""

    row: NDArray[np.intp]
    column: NDArray[np.intp]
    z: FloatArray

    @classmethod
    def of(cls, field: Field, camera: Camera) -> Self:
        shape = field.values.shape
        uv, z = camera.project(field.points(np.indices(shape).reshape(3, -1).T))
        inside = camera.inside(uv)
        pixel = np.where(inside[:, None], np.nan_to_num(uv), 0).astype(np.intp)
        z = np.where(inside, z, np.nan)
        return cls(pixel[:, 1].reshape(shape), pixel[:, 0].reshape(shape), z.reshape(shape))

    def behind(self, depth: FloatArray) -> FloatArray:
        """(X, Y, Z) how far behind the depth map each voxel lies along the camera's z, metres; NaN where unknown."""
        return np.asarray(self.z - np.where(depth > 0, depth, np.nan)[self.row, self.column])


def carved(views: Views, prior: GeometryEstimate, resolution: int = 96) -> TriangleMesh | None:
    """The visual hull without the voxels in front of a depth map; None when nothing is left."""
    field = hull_field(views, resolution)
    depth = prior.depth.astype(np.float64) * camera_scale(prior, views)
    values = field.values.copy()
    for view, known in zip(views, depth, strict=True):
        ahead = _Sight.of(field, view.camera).behind(known)
        np.minimum(values, np.where(np.isfinite(ahead), ahead, values), out=values)
    return mesh_of(Field(values, field.origin, field.step))


def aligned_tsdf(views: Views, prior: GeometryEstimate, resolution: int = 96) -> TriangleMesh | None:
    """A TSDF mean of the depth maps within the hull, each brought to the consensus by a scale and a shift.

    Four rounds: fit each map to the surface that all make (the hull at first) by the median of ratios and, from the
    second round, a robust line; then take the mean again.
    """
    hull = hull_field(views, resolution)
    maps = np.where(prior.depth > 0, prior.depth, np.nan) * camera_scale(prior, views)
    surface = mesh_of(hull)
    sights = [_Sight.of(hull, view.camera) for view in views]  # the same in every round
    for number in range(ROUNDS):
        if surface is None:
            return None
        fitted = []
        for view, known in zip(views, maps, strict=True):
            front = depth_map(surface, view.camera).astype(np.float64)
            both = np.isfinite(front) & np.isfinite(known)
            if both.sum() < 50:
                fitted.append(known)
                continue
            fitted.append(_to(known, front, both, line=number > 0))
        maps = np.stack(fitted)
        surface = mesh_of(_mean(hull, sights, maps))
    return surface


def _to(known: FloatArray, front: FloatArray, both: NDArray[np.bool_], line: bool) -> FloatArray:
    x, y = known[both], front[both]
    if not line:
        return np.asarray(known * np.median(y / x))
    weight = np.ones_like(x)
    gain, bias = 1.0, 0.0
    middle = float(np.median(x))
    for _ in range(10):
        design = np.stack([x - middle, np.ones_like(x)], axis=1)
        normal = design.T @ (weight[:, None] * design) + 1e-9 * np.eye(2)
        gain, bias = np.linalg.solve(normal, design.T @ (weight * y))
        gap = np.abs(y - design @ [gain, bias])
        weight = 1.0 / (gap + 1e-3)
    return np.asarray(gain * (known - middle) + bias)


def _mean(hull: Field, sights: Sequence[_Sight], maps: FloatArray) -> Field:
    reach = TRUNCATION * hull.step
    total, count = np.zeros(hull.values.shape), np.zeros(hull.values.shape)
    for sight, known in zip(sights, maps, strict=True):
        behind = sight.behind(known)
        seen = np.isfinite(behind) & (behind < reach)
        total[seen] += np.maximum(behind[seen], -reach)
        count[seen] += 1
    mean = np.where(count > 0, total / np.maximum(count, 1), reach)
    return Field(np.minimum(mean, hull.values).astype(np.float32), hull.origin, hull.step)


def mesh_of(field: Field) -> TriangleMesh | None:
    """The zero level set of a field as a mesh without colours; None when it has none."""
    try:
        return surface_of(field)
    except (ValueError, GeometryError):
        return None


def dressed(mesh: TriangleMesh, views: Views, count: int, renderer: Renderer) -> Reconstruction:
    """A bare mesh with colours from the views and about ``count`` Gaussians on it, put as far inside as ours are."""
    shown, _ = mask_silhouettes(views)
    normals = outward_normals(mesh)
    depths = [depth_map(mesh, s.camera) for s in shown]
    tolerance = 0.02 * float(np.ptp(mesh.vertices, axis=0).max())
    colours, _ = vertex_colours(mesh, normals, shown, depths, tolerance)
    mesh = TriangleMesh(mesh.vertices, mesh.faces, colours)
    return inset(Reconstruction(surfels(mesh, normals, count), mesh), views, renderer)[0]
