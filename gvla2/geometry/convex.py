"""Collision shapes of meshes: convex pieces by CoACD, cached for the user."""

from __future__ import annotations

import hashlib
import logging
from functools import lru_cache
from pathlib import Path

import numpy as np
import trimesh
from scipy.spatial import ConvexHull, QhullError

from gvla2.errors import GeometryError
from gvla2.geometry.mesh import TriangleMesh
from gvla2.geometry.mesh_files import read_mesh
from gvla2.geometry.transform import FloatArray
from gvla2.io.array_cache import cache_folder
from gvla2.io.files import write_whole

VERSION = 3
"""Version of the decomposition: changes whenever its pieces would."""

THRESHOLD, MOST_PIECES, MOST_CORNERS = 0.05, 24, 48
"""CoACD's concavity, in sizes of the object; the pieces' number; corners per piece (PhysX thins out beyond 255)."""

FACES = 20_000
"""Meshes are simplified to this many faces first: finer ones change no piece and cost minutes."""

HOLLOW, HOLLOW_SHARE = 0.04, 0.02
"""An object counts as convex if, moving straight out of its surface by this share of its longest side, one is still
inside the hull at less than this share of the surface."""

THINNEST = 1e-3
"""Least thickness of a piece, metres: a hull needs a volume."""

log = logging.getLogger(__name__)


@lru_cache(maxsize=64)
def convex_pieces(path: str, scale: float) -> tuple[FloatArray, ...]:
    """Corners (N, 3) of the convex pieces of a mesh's file, in its frame, multiplied by ``scale``.

    Raises :class:`GeometryError` for a file that is no mesh or has no solid.
    """
    pieces = trimesh.load_mesh(piece_file(read_mesh(path))).split()
    return tuple(scale * np.asarray(piece.vertices, dtype=np.float64) for piece in pieces)


def piece_file(mesh: TriangleMesh) -> Path:
    """The OBJ file of a mesh's convex pieces, one group each, their triangles wound outwards.

    From the cache or made now (up to half a minute for an open vessel). Raises :class:`GeometryError` for a mesh of no
    solid at all.
    """
    digest = hashlib.sha256(f"{VERSION} {THRESHOLD} {MOST_PIECES} {MOST_CORNERS}".encode())
    digest.update(np.round(mesh.vertices, 7).tobytes() + mesh.faces.tobytes())
    path = cache_folder() / "collision" / f"{digest.hexdigest()[:32]}.obj"
    if not path.is_file():
        path.parent.mkdir(parents=True, exist_ok=True)
        found = decompose(mesh)
        hulls = {f"piece_{k}": trimesh.convex.convex_hull(corners) for k, corners in enumerate(found)}
        scene = trimesh.Scene(hulls)
        text = scene.export(file_type="obj", include_normals=False, include_texture=False)
        write_whole(path, str(text).encode())
    return path


def decompose(mesh: TriangleMesh) -> list[FloatArray]:
    """Corners (N, 3) of convex pieces that together represent the mesh; just its hull if it is convex enough."""
    hull = _hull_of(mesh.vertices)
    if _is_convex(mesh, hull):
        return [hull]
    log.info("Decomposing a mesh of %d faces into convex pieces; this is done once.", len(mesh.faces))
    coarse = mesh
    cell = float(np.ptp(mesh.vertices, axis=0).max()) / 400
    while len(coarse.faces) > FACES:
        coarse, cell = mesh.clustered(cell)[0], cell * 1.3
    import coacd

    coacd.set_log_level("error")
    found = coacd.run_coacd(
        coacd.Mesh(coarse.vertices, coarse.faces),
        threshold=THRESHOLD,
        max_convex_hull=MOST_PIECES,
        preprocess_resolution=40,
        resolution=1000,
        mcts_nodes=10,
        mcts_iterations=50,
        mcts_max_depth=2,
        decimate=True,
        max_ch_vertex=MOST_CORNERS,
        seed=0,
    )
    solid = [_hull_of(np.asarray(corners, dtype=np.float64)) for corners, _ in found]
    return solid or [hull]


def _is_convex(mesh: TriangleMesh, hull: FloatArray) -> bool:
    """Whether hardly any of the surface faces a hollow.

    A point's distance below the hull would not show it: the inside of a thin wall is near the hull's outside.
    """
    planes = ConvexHull(hull).equations
    points, faces = mesh.sample(2000, np.random.default_rng(0))
    below = -(points @ planes[:, :3].T + planes[:, 3]).clip(max=0.0)  # (N, planes)
    outwards = mesh.normals[faces] @ planes[:, :3].T
    way = np.divide(below, outwards, out=np.full_like(below, np.inf), where=outwards > 1e-9).min(axis=1)
    return float((way > HOLLOW * np.ptp(mesh.vertices, axis=0).max()).mean()) < HOLLOW_SHARE


def _hull_of(points: FloatArray) -> FloatArray:
    """The corners (N, 3) of the convex hull; flat ones get the thickness :data:`THINNEST`."""
    try:
        return np.asarray(points[ConvexHull(points).vertices])
    except QhullError:
        _, _, axes = np.linalg.svd(points - points.mean(axis=0), full_matrices=False)
        sides = np.concatenate([points + 0.5 * THINNEST * step for step in (*axes, *-axes)])
    try:
        return np.asarray(sides[ConvexHull(sides).vertices])
    except QhullError as error:
        raise GeometryError("A mesh without any extent has no solid.") from error
