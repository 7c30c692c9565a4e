"""Meshes in OBJ, GLB and PLY files, read and written by trimesh.

GLB files are Y-up by their standard and are turned to our Z-up frame and back; OBJ and PLY state no axes and are taken
as they are. Materials do not pass through a :class:`TriangleMesh`: to move the vertices of a GLB file and keep
everything else, use :func:`gvla2.geometry.glb.map_glb`.
"""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import trimesh

from gvla2.errors import GeometryError
from gvla2.geometry.glb import to_y_up, to_z_up
from gvla2.geometry.mesh import TriangleMesh
from gvla2.io.files import write_whole

_SUFFIXES = (".obj", ".glb", ".ply")


def read_mesh(path: str | os.PathLike[str]) -> TriangleMesh:
    """All meshes of a file as one, each placed by the file's scene graph, Z-up.

    Vertex order is the file's. Colours come from vertex colours, else from the material or texture at each
    vertex, else they are None. Raises :class:`GeometryError`, naming the file, when it is absent, of another kind,
    broken, without triangles, or with vertices that are not finite.
    """
    source = Path(path)
    suffix = _suffix(source)
    if not source.is_file():
        raise GeometryError(f"Cannot read a mesh from {source}: there is no such file.")
    try:
        scene = trimesh.load_scene(source, process=False, maintain_order=True)
        parts = [part for part in scene.dump() if isinstance(part, trimesh.Trimesh) and len(part.faces)]
    except Exception as error:  # trimesh's parsers raise anything
        raise GeometryError(f"Cannot read a mesh from {source}: {type(error).__name__}: {error}") from error
    if not parts:
        raise GeometryError(f"Cannot read a mesh from {source}: it holds no triangles.")
    vertices = np.concatenate([part.vertices for part in parts])
    starts = np.cumsum([0] + [len(part.vertices) for part in parts])
    faces = np.concatenate([part.faces + start for part, start in zip(parts, starts[:-1], strict=True)])
    colours = np.concatenate([_colours(part) for part in parts]) if all(map(_is_coloured, parts)) else None
    try:
        return TriangleMesh(to_z_up(vertices) if suffix == ".glb" else vertices, faces, colours)
    except GeometryError as error:
        raise GeometryError(f"{source}: {error}") from error


def write_mesh(path: str | os.PathLike[str], mesh: TriangleMesh) -> None:
    """Write vertices, faces and colours, whole or not at all; the suffix .obj, .glb or .ply chooses the format.

    Raises :class:`GeometryError` for another suffix, :class:`gvla2.errors.OutputError` when it cannot be written.
    """
    suffix = _suffix(Path(path))
    vertices = to_y_up(mesh.vertices) if suffix == ".glb" else mesh.vertices
    colours = None if mesh.colours is None else np.rint(255 * mesh.colours).astype(np.uint8)
    built = trimesh.Trimesh(vertices, mesh.faces, vertex_colors=colours, process=False)
    content = built.export(file_type=suffix[1:])
    write_whole(path, content.encode() if isinstance(content, str) else content)


def _suffix(path: Path) -> str:
    suffix = path.suffix.lower()
    if suffix not in _SUFFIXES:
        raise GeometryError(f"{path}: meshes are {', '.join(_SUFFIXES)} files, not '{suffix}'.")
    return suffix


def _is_coloured(part: trimesh.Trimesh) -> bool:
    return bool(part.visual.defined)


def _colours(part: trimesh.Trimesh) -> np.ndarray:
    """(V, 3) in [0, 1] of a part that has colours of some kind."""
    visual = part.visual.to_color() if part.visual.kind == "texture" else part.visual
    return np.asarray(visual.vertex_colors, dtype=np.float64)[:, :3] / 255.0
