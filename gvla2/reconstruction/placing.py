"""Gaussians put on a new surface, with the attributes that they had on the old one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from gvla2.geometry.gaussians import Gaussians
from gvla2.geometry.mesh import Mesh
from gvla2.geometry.transform import FloatArray
from gvla2.reconstruction.compiled import cores
from gvla2.reconstruction.mask_distance import Silhouette
from gvla2.reconstruction.surfels import surfels, turned_to
from gvla2.reconstruction.zbuffer import depth_map

_SLANT = 0.15
"""Cosine below which a view sees a surface too obliquely to say what belongs there."""


def place(
    old: Gaussians,
    worn: Mesh | None,
    mesh: Mesh,
    normals: FloatArray,
    shown: Sequence[Silhouette],
    tolerance: float,
) -> Gaussians:
    """As many Gaussians as ``old``, within a few per cent, evenly spread over ``mesh``.

    Each takes opacity, scales, rotation and harmonics of the old one that the view which faces it best saw on the
    same pixel, for there it belongs; where no view looks, of the nearest. ``worn`` is the mesh that the old ones lie
    on, if any; ``normals`` (V, 3) are ``mesh``'s; ``tolerance`` metres decides what is hidden. Scales grow or shrink
    with the spacing, rotations follow the surface, colours seen from everywhere are the mesh's where it has any.
    """
    spread = surfels(mesh, normals, len(old))
    points = spread.centres.astype(np.float64)
    across = Rotation.from_quat(spread.rotations.astype(np.float64), scalar_first=True).apply([0.0, 0.0, 1.0])
    source = _sources(points, across, old, worn, mesh, shown, tolerance)
    spacing = np.sqrt(mesh.areas.sum() / len(points))
    before = np.sqrt(worn.areas.sum() / len(old)) if worn is not None and worn.areas.sum() > 0 else spacing
    own = Rotation.from_quat(old.rotations[source].astype(np.float64), scalar_first=True)
    thin = np.argmin(old.log_scales[source], axis=1)
    was = own.as_matrix()[np.arange(len(points)), :, thin]
    was *= np.where(np.einsum("nk,nk->n", was, across) < 0, -1.0, 1.0)[:, None]
    turn = Rotation.from_quat(turned_to(across).astype(np.float64), scalar_first=True) * (
        Rotation.from_quat(turned_to(was).astype(np.float64), scalar_first=True).inv()
    )
    placed = replace(
        spread,
        log_scales=old.log_scales[source] + np.float32(np.log(spacing / before)),
        rotations=(turn * own).as_quat(scalar_first=True).astype(np.float32),
        opacity_logits=old.opacity_logits[source],
        sh_rest=None if old.sh_rest is None else old.sh_rest[source],
    )
    return placed if mesh.colours is not None else replace(placed, sh_dc=old.sh_dc[source])


def _sources(
    points: FloatArray,
    across: FloatArray,
    old: Gaussians,
    worn: Mesh | None,
    mesh: Mesh,
    shown: Sequence[Silhouette],
    tolerance: float,
) -> NDArray[np.int64]:
    """(N,) the old Gaussian whose attributes each point takes."""
    there = old.centres.astype(np.float64)
    source, best = np.zeros(len(points), dtype=np.int64), np.full(len(points), _SLANT)
    for s in shown if worn is not None and len(worn.faces) else ():
        assert worn is not None
        towards = s.camera.position - points
        facing = np.einsum("nk,nk->n", across, towards) / np.linalg.norm(towards, axis=1)
        uv, seen = _visible(points, mesh, s, tolerance)
        old_uv, old_seen = _visible(there, worn, s, 2 * tolerance)
        if not old_seen.any():
            continue
        chosen = seen & (facing > best)
        candidates = np.flatnonzero(old_seen)
        _, near = cKDTree(old_uv[candidates]).query(uv[chosen], workers=cores())
        source[chosen] = candidates[near]
        best[chosen] = facing[chosen]
    hidden = best == _SLANT
    if hidden.any():
        source[hidden] = cKDTree(there).query(points[hidden], workers=cores())[1]
    return source


def _visible(
    points: FloatArray, mesh: Mesh, s: Silhouette, tolerance: float
) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Pixels (N, 2) of points and which of them (N,) the mesh does not hide."""
    uv, z = s.camera.project(points)
    inside = s.camera.inside(uv)
    pixel = np.where(inside[:, None], np.nan_to_num(uv), 0).astype(np.intp)
    depth = depth_map(mesh, s.camera)[pixel[:, 1], pixel[:, 0]]
    return uv, np.asarray(inside & (z <= depth + tolerance))
