"""Gaussians put on a new surface, with the attributes that they had on the old one."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from gvla2.geometry.gaussians import Gaussians
from gvla2.geometry.mesh import TriangleMesh
from gvla2.geometry.transform import FloatArray
from gvla2.reconstruction.colouring import SLANT
from gvla2.reconstruction.compiled import cores, run_together
from gvla2.reconstruction.mask_distance import Silhouette
from gvla2.reconstruction.outline import projected
from gvla2.reconstruction.surfels import surfels
from gvla2.reconstruction.zbuffer import depth_map


def place(
    old: Gaussians,
    worn: TriangleMesh | None,
    mesh: TriangleMesh,
    normals: FloatArray,
    shown: Sequence[Silhouette],
    depths: Sequence[NDArray[np.float32]],
    tolerance: float,
) -> Gaussians:
    """As many Gaussians as ``old``, within a few per cent, evenly spread over ``mesh``.

    Each takes opacity, scales, rotation and harmonics of the old one that the view which faces it best saw on the
    same pixel, for there it belongs; where no view looks, of the nearest. ``worn`` is the mesh that the old ones lie
    on, if any; ``normals`` (V, 3) are ``mesh``'s, ``depths`` (H, W) its depth maps in the views ``shown``;
    ``tolerance`` metres decides what is hidden. Scales grow or shrink with the spacing, rotations turn with the surface
    by the shortest way, colours seen from everywhere are the mesh's where it has any.
    """
    jobs: list[Callable[[], Any]] = [
        partial(surfels, mesh, normals, len(old)),
        partial(_painted, old, worn, shown, 2 * tolerance),
    ]
    spread: Gaussians
    spread, painted = run_together(jobs)
    points = spread.centres.astype(np.float64)
    across = _rotation(spread.rotations).apply([0.0, 0.0, 1.0])
    source = _sources(points, across, old, painted, shown, depths, tolerance)
    spacing = np.sqrt(mesh.areas.sum() / len(points))
    before = np.sqrt(worn.areas.sum() / len(old)) if worn is not None and worn.areas.sum() > 0 else spacing
    own = _rotation(old.rotations[source])
    was = own.apply(np.eye(3)[np.argmin(old.log_scales[source], axis=1)])
    was *= np.where(np.einsum("nk,nk->n", was, across) < 0, -1, 1)[:, None]
    # The shortest way from one unit vector to another, less than half a turn.
    way, half = np.cross(was, across), 1 + np.einsum("nk,nk->n", was, across)
    axis, angle = np.split(own.as_quat(), [3], axis=1)
    turned = np.column_stack(
        [
            half * angle[:, 0] - np.einsum("nk,nk->n", way, axis),
            half[:, None] * axis + angle * way + np.cross(way, axis),
        ]
    )
    turned /= np.linalg.norm(turned, axis=1, keepdims=True)
    placed = replace(
        spread,
        log_scales=old.log_scales[source] + np.float32(np.log(spacing / before)),
        rotations=turned.astype(np.float32),
        opacity_logits=old.opacity_logits[source],
        sh_rest=None if old.sh_rest is None else old.sh_rest[source],
    )
    return placed if mesh.colours is not None else replace(placed, sh_dc=old.sh_dc[source])


def _rotation(quaternions: NDArray[np.float32]) -> Rotation:
    """Of quaternions wxyz (N, 4), of any length."""
    return Rotation.from_quat(np.roll(quaternions, -1, axis=1))


def _painted(
    old: Gaussians, worn: TriangleMesh | None, shown: Sequence[Silhouette], tolerance: float
) -> list[tuple[cKDTree, NDArray[np.intp]]]:
    """For each view the pixels of the Gaussians that it shows on their mesh, and which these are."""
    found: list[tuple[cKDTree, NDArray[np.intp]]] = []
    if worn is not None and len(worn.faces):
        there = old.centres.astype(np.float64)
        for s in shown:
            uv, seen = _visible(there, s, depth_map(worn, s.camera), tolerance)
            # An even tree takes longer to build, and answers no sooner.
            found.append((cKDTree(uv[seen], leafsize=32, balanced_tree=False), np.flatnonzero(seen)))
    return found


def _sources(
    points: FloatArray,
    across: FloatArray,
    old: Gaussians,
    painted: Sequence[tuple[cKDTree, NDArray[np.intp]]],
    shown: Sequence[Silhouette],
    depths: Sequence[NDArray[np.float32]],
    tolerance: float,
) -> NDArray[np.int64]:
    """(N,) the old Gaussian whose attributes each point takes."""
    source, view = np.zeros(len(points), dtype=np.int64), np.full(len(points), -1)
    best, pixels = np.full(len(points), SLANT), np.empty((len(points), 2), dtype=np.float32)
    for number, (_, which) in enumerate(painted):
        if not len(which):
            continue
        s = shown[number]
        uv, seen = _visible(points, s, depths[number], tolerance)
        towards = s.camera.position - points
        facing = np.einsum("nk,nk->n", across, towards) / np.linalg.norm(towards, axis=1)
        better = seen & (facing > best)
        view[better], best[better], pixels[better] = number, facing[better], uv[better]
    for number, (tree, which) in enumerate(painted):
        mine = np.flatnonzero(view == number)
        if len(mine):
            source[mine] = which[tree.query(pixels[mine], workers=cores())[1]]
    hidden = view < 0
    if hidden.any():
        source[hidden] = cKDTree(old.centres).query(points[hidden], workers=cores())[1]
    return source


def _visible(
    points: FloatArray, s: Silhouette, depth: NDArray[np.float32], tolerance: float
) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """Pixels (N, 2) of points and which of them (N,) lie no more than ``tolerance`` behind ``depth`` (H, W)."""
    uvz = projected(points, s.camera)
    inside = s.camera.inside(uvz)
    column, row = np.where(inside[:, None], uvz[:, :2], 0).astype(np.intp).T
    return uvz[:, :2], np.asarray(inside & (uvz[:, 2] <= depth[row, column] + tolerance))
