"""GLB files: their axes, and moving their vertices while everything else stays.

glTF is Y-up; ours is Z-up. Materials, texture coordinates, images, the scene graph, extensions and extras are
never decoded: positions (and the normals that go with them) are changed where they lie in the binary chunk.
"""

from __future__ import annotations

import json
import os
import struct
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gvla2.errors import GeometryError
from gvla2.geometry.gltf import (
    Document,
    inverse,
    pack,
    placed_meshes,
    read_faces,
    read_floats,
    store_floats,
    unpack,
)
from gvla2.geometry.mesh import TriangleMesh
from gvla2.geometry.transform import FloatArray, transform_points
from gvla2.io.files import write_whole

_TRIANGLES = 4


def to_y_up(points: ArrayLike) -> FloatArray:
    """Our points or directions (..., 3) in the frame of glTF: (x, y, z) becomes (x, z, -y)."""
    p = np.asarray(points, dtype=np.float64)
    return np.stack([p[..., 0], p[..., 2], -p[..., 1]], axis=-1)


def to_z_up(points: ArrayLike) -> FloatArray:
    """Points or directions (..., 3) of glTF in our frame: (x, y, z) becomes (x, -z, y)."""
    p = np.asarray(points, dtype=np.float64)
    return np.stack([p[..., 0], -p[..., 2], p[..., 1]], axis=-1)


@dataclass(frozen=True)
class _Placed:
    """One vertex buffer placed in the scene: the accessors of its positions, normals and triangles."""

    world_from_node: FloatArray
    positions: int
    normals: int | None
    triangles: tuple[int | None, ...]


@dataclass(frozen=True)
class GlbFile:
    """A GLB file held in memory; ``positions`` and ``with_positions`` cover the vertices of its whole scene."""

    document: Document = field(repr=False)
    binary: bytes = field(repr=False)
    source: str = "GLB"

    @classmethod
    def read(cls, path: str | os.PathLike[str]) -> GlbFile:
        """Read and check a file.

        Raises :class:`GeometryError`, naming the file, when it is absent, not a GLB 2 file, truncated, without
        vertices, or when its positions are compressed, quantised, sparse or not finite.
        """
        try:
            content = Path(path).read_bytes()
            document, binary = unpack(content)
            glb = cls(document, binary, str(path))
            glb.positions()
        except (OSError, GeometryError) as error:
            raise GeometryError(f"Cannot read {path}: {error}") from error
        except (struct.error, ValueError, LookupError, TypeError) as error:
            raise GeometryError(f"Cannot read {path}: malformed glTF, {error!r}.") from error
        return glb

    def positions(self) -> FloatArray:
        """(V, 3) vertices of the whole scene in its order, metres, Z-up, placed by the scene graph."""
        placed = [
            transform_points(p.world_from_node, read_floats(self.document, self.binary, p.positions))
            for p in self._placed()
        ]
        points = np.concatenate(placed) if placed else np.zeros((0, 3))
        if len(points) == 0:
            raise GeometryError("it holds no vertices.")
        if not np.isfinite(points).all():
            raise GeometryError(f"{int((~np.isfinite(points)).any(axis=1).sum())} vertices are not finite.")
        return to_z_up(points)

    def with_positions(self, positions: ArrayLike) -> GlbFile:
        """The same file with the vertices of ``positions()`` moved to (V, 3), metres, Z-up.

        Stored normals turn as their surface does; tangents stay. Raises :class:`GeometryError` for a wrong shape,
        for values that are not finite, and when one mesh is placed several times and its copies would have to
        differ.
        """
        new, old = np.asarray(positions, dtype=np.float64), self.positions()
        if new.shape != old.shape or not np.isfinite(new).all():
            raise GeometryError(f"{self.source} needs finite positions {old.shape}, got shape {new.shape}.")
        document: Document = json.loads(json.dumps(self.document))
        binary = bytearray(self.binary)
        moved: dict[int, FloatArray] = {}
        start = 0
        for part in self._placed():
            before = read_floats(self.document, self.binary, part.positions)
            stop = start + len(before)
            after = transform_points(inverse(part.world_from_node), to_y_up(new[start:stop]))
            start = stop
            if part.positions in moved:
                reach = max(float(np.ptp(before, axis=0).max()), 1e-9)
                if not np.allclose(moved[part.positions], after, rtol=0, atol=1e-5 * reach):
                    raise GeometryError(
                        f"{self.source} places one mesh several times, and its copies would be moved apart; "
                        "export it with instances applied."
                    )
                continue
            moved[part.positions] = after
            store_floats(document, binary, part.positions, after)
            accessor = document["accessors"][part.positions]
            stored = read_floats(document, binary, part.positions)
            accessor["min"], accessor["max"] = stored.min(axis=0).tolist(), stored.max(axis=0).tolist()
            if part.normals is not None and part.triangles:
                faces = np.concatenate(
                    [read_faces(document, self.binary, i, len(before)) for i in part.triangles]
                )
                turned = _turn(read_floats(document, binary, part.normals), before, after, faces)
                store_floats(document, binary, part.normals, turned)
        return GlbFile(document, bytes(binary), self.source)

    def write(self, path: str | os.PathLike[str]) -> None:
        """Write the file whole or not at all; raises :class:`gvla2.errors.OutputError`."""
        write_whole(path, pack(self.document, self.binary))

    def _placed(self) -> list[_Placed]:
        """The scene's vertex buffers in the order of the node tree, each once a placement."""
        found: dict[tuple[bytes, int], _Placed] = {}
        for world_from_node, mesh in placed_meshes(self.document):
            for primitive in self.document["meshes"][mesh]["primitives"]:
                if "POSITION" not in primitive["attributes"]:
                    continue
                if "KHR_draco_mesh_compression" in primitive.get("extensions", {}):
                    raise GeometryError("its meshes are compressed (Draco); export it without compression.")
                position = primitive["attributes"]["POSITION"]
                key = (world_from_node.tobytes(), position)
                triangles = found[key].triangles if key in found else ()
                if primitive.get("mode", _TRIANGLES) == _TRIANGLES:
                    triangles = (*triangles, primitive.get("indices"))
                normals = primitive["attributes"].get("NORMAL")
                found[key] = _Placed(world_from_node, position, normals, triangles)
        return list(found.values())


def map_glb(
    source: str | os.PathLike[str],
    target: str | os.PathLike[str],
    mapping: Callable[[FloatArray], ArrayLike],
) -> None:
    """Write ``source`` to ``target`` with its vertices (V, 3), metres, Z-up, passed through ``mapping``."""
    glb = GlbFile.read(source)
    glb.with_positions(mapping(glb.positions())).write(target)


def _turn(normals: FloatArray, before: FloatArray, after: FloatArray, faces: NDArray[np.int64]) -> FloatArray:
    """Stored normals (V, 3), turned by the smallest rotation that takes the old surface's normal to the new.

    Computing them afresh would lose the author's smoothing; this keeps it, also across seams.
    """
    a, b = _vertex_normals(before, faces), _vertex_normals(after, faces)
    axis, cosine = np.cross(a, b), np.einsum("ij,ij->i", a, b)[:, None]
    along = np.einsum("ij,ij->i", axis, normals)[:, None]
    # Rodrigues' formula for the rotation a -> b; a half turn leaves the axis undefined.
    turned = cosine * normals + np.cross(axis, normals) + axis * along / np.maximum(1 + cosine, 1e-9)
    return np.where(cosine > -0.999, turned, -normals)


def _vertex_normals(vertices: FloatArray, faces: NDArray[np.int64]) -> FloatArray:
    """(V, 3) unit normals, area-weighted over a vertex's faces; +z where there are none."""
    mesh = TriangleMesh(vertices, faces)
    weighted = np.repeat(mesh.normals * mesh.areas[:, None], 3, axis=0)
    corners = faces.ravel()
    total = np.stack([np.bincount(corners, weighted[:, k], len(vertices)) for k in range(3)], axis=1)
    length = np.linalg.norm(total, axis=1, keepdims=True)
    return np.where(length > 0, total / np.where(length > 0, length, 1.0), [0.0, 0.0, 1.0])
