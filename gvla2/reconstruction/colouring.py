"""Colours of a surface from the views that see it, where they agree."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates, minimum_filter
from scipy.spatial import cKDTree

from gvla2.geometry.mesh import TriangleMesh
from gvla2.geometry.transform import FloatArray
from gvla2.reconstruction.mask_distance import Silhouette

_VIEWS = 4  # a vertex listens to this many views at most, those that face it best
SLANT = 0.15
"""Cosine below which a view sees a surface too obliquely to say what is there."""
_SHARPNESS = 3.0  # power of the cosine in a view's weight: the best view leads, blending blurs
_DISAGREEMENT = 0.12  # colour difference at which a view loses half its say
_BESIDE = 0.02  # say of a view whose pixel touches something that stands in front
_NEIGHBOURS = 8


def vertex_colours(
    mesh: TriangleMesh,
    normals: FloatArray,
    silhouettes: Sequence[Silhouette],
    depths: Sequence[NDArray[np.float32]],
    tolerance: float,
) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Colours (V, 3) in [0, 1] and which vertices (V,) some view has seen.

    A view sees a vertex when its depth map of the mesh (one of ``depths`` (H, W), metres, inf for nothing) has
    nothing more than ``tolerance`` (metres) before it, when the surface faces it by ``normals`` (V, 3), and inside
    the mask by most of a pixel, since a silhouette's rim is mixed with the background. Of the views' colours the one
    nearest to all others leads; those that differ from it lose weight. Vertices that no view has seen take the mean
    of the nearest ones that were.
    """
    count = len(mesh.vertices)
    weights = np.zeros((len(silhouettes), count))
    colours = np.zeros((len(silhouettes), count, 3))
    for i, (s, depth) in enumerate(zip(silhouettes, depths, strict=True)):
        weights[i], colours[i] = _look(mesh.vertices, normals, s, depth, tolerance)
    if len(silhouettes) > _VIEWS:
        best = np.argpartition(-weights, _VIEWS - 1, axis=0)[:_VIEWS]
        weights = np.take_along_axis(weights, best, axis=0)
        colours = np.take_along_axis(colours, best[:, :, None], axis=0)
    agreed, seen = _agree(weights, colours)
    if not seen.any():
        # Seen by nobody, for example a mask of a few pixels: the masks' own mean colour is all there is.
        pixels = np.concatenate([s.image[s.inside] for s in silhouettes])
        return np.tile(pixels.mean(axis=0) / 255.0, (count, 1)), seen
    if not seen.all():
        near = min(_NEIGHBOURS, int(seen.sum()))
        gaps, index = cKDTree(mesh.vertices[seen]).query(mesh.vertices[~seen], k=np.arange(1, near + 1))
        share = 1.0 / np.maximum(gaps, 1e-9)
        share /= share.sum(axis=1, keepdims=True)
        agreed[~seen] = np.einsum("nk,nkc->nc", share, agreed[seen][index])
    return np.clip(agreed, 0.0, 1.0), seen


def _look(
    points: FloatArray, normals: FloatArray, s: Silhouette, depth: NDArray[np.float32], tolerance: float
) -> tuple[FloatArray, FloatArray]:
    """One view's weights (V,) and colours (V, 3) in [0, 1] of points (V, 3)."""
    uv, z = s.camera.project(points)
    towards = s.camera.position - points
    towards /= np.maximum(np.linalg.norm(towards, axis=1, keepdims=True), 1e-12)
    facing = np.einsum("ij,ij->i", normals, towards)
    weight, colour = np.zeros(len(points)), np.zeros((len(points), 3))
    index = np.flatnonzero(s.camera.inside(uv) & (facing > SLANT))
    pixel = uv[index].astype(np.intp)
    index = index[z[index] <= depth[pixel[:, 1], pixel[:, 0]] + tolerance]
    rim = np.clip((np.nan_to_num(s.sample(uv[index]), nan=0.0) - 0.75) / 1.5, 0.0, 1.0)
    index, rim = index[rim > 0], rim[rim > 0]
    pixel = uv[index].astype(np.intp)
    beside = minimum_filter(depth, 3)[pixel[:, 1], pixel[:, 0]]
    # Beside the rim of what stands in front, pixels are mixed with it, and the hull's rim is not quite the object's.
    rim = rim * np.where(z[index] <= beside + tolerance, 1.0, _BESIDE)
    weight[index] = rim * facing[index] ** _SHARPNESS
    where = uv[index, ::-1].T - 0.5
    for channel in range(3):
        values = map_coordinates(s.image[:, :, channel].astype(np.float32), where, order=1, mode="nearest")
        colour[index, channel] = values / 255.0
    return weight, colour


def _agree(weights: FloatArray, colours: FloatArray) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Colours (V, 3) that views' colours (S, V, 3) with weights (S, V) agree on, and where there are any (V,)."""
    gaps = np.linalg.norm(colours[:, None] - colours[None, :], axis=-1)  # (S, S, V)
    dissent = np.einsum("jv,ijv->iv", weights, gaps) + np.where(weights > 0, 0.0, np.inf)
    # Among equals, as with two views, the one that sees better leads.
    leader = np.argmin(dissent - 1e-3 * weights, axis=0)
    gap = np.take_along_axis(gaps, leader[None, None, :], axis=0)[0]
    say = weights / (1.0 + (gap / _DISAGREEMENT) ** 2)
    total = say.sum(axis=0)
    mean = np.einsum("sv,svc->vc", say, colours) / np.maximum(total, 1e-12)[:, None]
    return mean, total > 0
