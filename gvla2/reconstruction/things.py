"""Gaussians and mesh of one object treated as one thing: its points, its outline, one motion for both."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gvla2.errors import GeometryError
from gvla2.geometry.transform import FloatArray
from gvla2.reconstruction.contracts import Reconstruction

DENSE = 100_000


def points_of(thing: Reconstruction) -> FloatArray:
    """The points that stand for the object: Gaussian centres, else mesh vertices, (N, 3)."""
    if thing.gaussians is not None and len(thing.gaussians.centres):
        return np.asarray(thing.gaussians.centres, dtype=np.float64)
    if thing.mesh is not None and len(thing.mesh.vertices):
        return np.asarray(thing.mesh.vertices, dtype=np.float64)
    raise GeometryError("The reconstruction is empty: it has neither Gaussians nor mesh vertices.")


def outlined(thing: Reconstruction) -> tuple[FloatArray, NDArray[np.int64] | None]:
    """What casts the object's silhouettes: the mesh, which has no gaps, else the Gaussians' centres."""
    if thing.mesh is not None and len(thing.mesh.faces):
        return thing.mesh.vertices, thing.mesh.faces
    return points_of(thing), None


def dense_points(thing: Reconstruction) -> FloatArray:
    """(N, 3) points so close together that their outline is the object's: samples of the mesh where there is one."""
    if thing.mesh is not None and len(thing.mesh.faces) and thing.mesh.areas.sum() > 0:
        return thing.mesh.sample(DENSE, np.random.default_rng(0))[0]
    return points_of(thing)


def both_moved(thing: Reconstruction, move: Callable[[FloatArray], FloatArray]) -> Reconstruction:
    """The same motion for Gaussians and mesh."""
    gaussians, mesh = thing.gaussians, thing.mesh
    if gaussians is not None:
        gaussians = gaussians.with_centres(move(np.asarray(gaussians.centres, dtype=np.float64)))
    if mesh is not None:
        mesh = mesh.with_vertices(move(np.asarray(mesh.vertices, dtype=np.float64)))
    return replace(thing, gaussians=gaussians, mesh=mesh)


def mismatch(a: Reconstruction, b: Reconstruction) -> str:
    """Why the two cannot be fused point by point, or ""."""
    if (a.gaussians is None) != (b.gaussians is None) or (a.mesh is None) != (b.mesh is None):
        return "One source has Gaussians or a mesh that the other lacks."
    if a.gaussians is not None and b.gaussians is not None and len(a.gaussians) != len(b.gaussians):
        return f"The sources have {len(a.gaussians)} and {len(b.gaussians)} Gaussians."
    if a.mesh is not None and b.mesh is not None and not np.array_equal(a.mesh.faces, b.mesh.faces):
        return "The sources' meshes differ in topology."
    return ""
