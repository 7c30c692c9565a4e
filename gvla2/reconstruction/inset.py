"""How far inside the surface Gaussians belong, so that what they paint ends where the masks end.

A Gaussian has an extent, and a renderer's low-pass adds more than half a pixel to every silhouette. Centres that lie
on the true surface therefore paint an object that is too large. They are brought inwards, along the surface's
normals, by the one distance at which rendered alpha and masks agree best; the mesh stays where the surface is.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import trimesh
from scipy.spatial import cKDTree

from gvla2.geometry.compiled import cores
from gvla2.geometry.gaussians import Gaussians
from gvla2.geometry.mesh import TriangleMesh
from gvla2.geometry.transform import FloatArray
from gvla2.geometry.views import Views
from gvla2.reconstruction.contracts import Reconstruction, Renderer, StageReport
from gvla2.reconstruction.support import mask_of
from gvla2.reconstruction.surfels import scattered

LEAST_GAIN = 0.002
"""Rise of the agreement with the masks for which points are moved at all."""
MOST = 2.0
"""Farthest that points are moved, pixels of the views."""


def outward_normals(mesh: TriangleMesh) -> FloatArray:
    """(V, 3) unit normals of the vertices, weighted by angles, out of a closed mesh whatever its winding."""
    made = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    # Six times the volume: of it, only the sign matters, and trimesh's own comes with all moments of inertia.
    outward = 1.0 if np.einsum("fk,fk->", a, np.cross(b, c)) >= 0 else -1.0
    return np.asarray(outward * made.vertex_normals)


def normals_at(centres: FloatArray, mesh: TriangleMesh) -> FloatArray:
    """(N, 3) outward unit normals of the mesh where it lies nearest to the centres (N, 3)."""
    surface, normals = mesh.vertices, outward_normals(mesh)
    if len(surface) < min(len(centres), _ENOUGH) and mesh.areas.sum() > 0:
        # Where the vertices lie far apart, points between them.
        surface, face, weights = scattered(mesh, _ENOUGH)
        normals = np.einsum("pk,pkc->pc", weights, normals[mesh.faces[face]])
        normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
    _, near = cKDTree(surface).query(centres, workers=cores())
    return np.asarray(normals[near])


_ENOUGH = 60_000


def inset(obj: Reconstruction, views: Views, renderer: Renderer) -> tuple[Reconstruction, StageReport]:
    """The object with its Gaussians where they paint the masks best; nothing but their centres changes.

    The report's measures are ``alpha_iou``: sum of min(alpha, mask) over sum of max, mean over the three views that
    show most. Skipped without Gaussians and without a mesh, whose normals separate inside from outside.
    """
    gaussians, mesh = obj.gaussians, obj.mesh
    if gaussians is None or len(gaussians) == 0 or mesh is None or len(mesh.faces) == 0:
        return obj, StageReport("inset", "skipped", "It takes Gaussians and a mesh.")
    centres = np.asarray(gaussians.centres, dtype=np.float64)
    step = normals_at(centres, mesh) * pixel_sizes(centres, views)[:, None]
    judges = largest(views)

    def at(pixels: float) -> Gaussians:
        return gaussians.with_centres(centres - pixels * step)

    pixels, before, after = _best(lambda t: alpha_iou(at(t), judges, renderer))
    measures = {"alpha_iou": before}, {"alpha_iou": after}
    if not after > before + LEAST_GAIN:
        reason = "The Gaussians paint the masks as well as they can."
        return obj, StageReport("inset", "skipped", reason, *measures)
    way = f"{abs(pixels):.2f} px {'inwards' if pixels > 0 else 'outwards'}"
    return replace(obj, gaussians=at(pixels)), StageReport("inset", "applied", f"Gaussians {way}.", *measures)


def alpha_iou(gaussians: Gaussians, views: Views, renderer: Renderer) -> float:
    """Agreement of rendered alpha and masks, in [0, 1], mean over the views with a mask; NaN when none has."""
    found = []
    for view in views:
        mask = mask_of(view)
        if mask.any():
            alpha = renderer.render(gaussians, view.camera)[1]
            found.append(float(np.minimum(alpha, mask).sum() / np.maximum(alpha, mask).sum()))
    return float(np.mean(found)) if found else float("nan")


def largest(views: Views, count: int = 3) -> Views:
    """The views whose masks are largest, in their order: the others hardly change the result."""
    areas = [float(mask_of(view).sum()) for view in views]
    chosen = sorted(sorted(range(len(views)), key=lambda n: -areas[n])[:count])
    return Views(tuple(views[n] for n in chosen))


def pixel_sizes(points: FloatArray, views: Views) -> FloatArray:
    """(N,) metres that a pixel spans at each point, mean over the views that have it in front of them."""
    total, seen = np.zeros(len(points)), np.zeros(len(points))
    for view in views:
        camera = view.camera
        depth = points @ camera.camera_from_world[2, :3] + camera.camera_from_world[2, 3]
        front = depth > 0
        focal = 0.5 * (camera.K[0, 0] + camera.K[1, 1])
        total += np.where(front, depth / focal, 0.0)
        seen += front
    return np.asarray(total / np.maximum(seen, 1))


def _best(score: Callable[[float], float]) -> tuple[float, float, float]:
    """The shift in [-1, MOST] pixels with the best score after four evaluations, score(0), and the best score.

    A score falls off evenly on both sides of its summit, so a parabola through three of its values finds it.
    """
    known = {0.0: score(0.0), 1.0: score(1.0)}
    third = MOST if known[1.0] > known[0.0] else -1.0 if known[0.0] - known[1.0] > 0.03 else 0.5
    known[third] = score(third)
    guess = _summit(known)
    known.setdefault(guess, score(guess))
    best = max(known, key=lambda t: known[t])
    return best, known[0.0], known[best]


def _summit(known: dict[float, float]) -> float:
    """The maximum of the parabola through three points; the best point if it has none."""
    curve = np.polyfit(list(known), list(known.values()), 2)
    if not np.isfinite(curve).all() or curve[0] >= 0:
        return max(known, key=lambda t: known[t])
    return float(np.clip(-curve[1] / (2 * curve[0]), -1.0, MOST))
