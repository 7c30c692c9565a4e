"""Meshes with their textures: triangles, corner colours, images."""

from __future__ import annotations

import hashlib
import os
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray

from gvla2.errors import GeometryError
from gvla2.geometry.glb import to_z_up
from gvla2.geometry.mesh import TriangleMesh

GREY = 0.7
"""The colour of a mesh that has none."""


@dataclass(frozen=True)
class TexturedMesh:
    """A triangle mesh with textures and colours.

    ``mesh``: its vertices and faces, Z-up; ``uv`` (F, 3, 2) float32, texture coordinates of each face's corners,
    v upwards, repeating outside [0, 1]; ``texture`` (F,) int, the face's image, -1 for none; ``rgb`` (F, 3, 3)
    float32 in [0, 1], corner colours, which multiply the texture; ``images`` each (H, W, 3) uint8 RGB.
    """

    mesh: TriangleMesh
    uv: NDArray[np.float32]
    texture: NDArray[np.int64]
    rgb: NDArray[np.float32]
    images: tuple[NDArray[np.uint8], ...]

    def normalised(self) -> TexturedMesh:
        """The same mesh with its bounding box centred at the origin and its longest side 1.

        Raises :class:`GeometryError` when it has no extent.
        """
        low, high = self.mesh.bounds
        side = float((high - low).max())
        if not side > 0:
            raise GeometryError("A mesh whose vertices all coincide cannot be scaled to a longest side of 1.")
        return replace(self, mesh=self.mesh.with_vertices((self.mesh.vertices - 0.5 * (low + high)) / side))

    def content_hash(self) -> str:
        """Hexadecimal digest of everything visible, independent of the file name."""
        digest = hashlib.sha256()
        arrays: tuple[NDArray[Any], ...] = (
            self.mesh.vertices,
            self.mesh.faces,
            self.uv,
            self.texture,
            self.rgb,
            *self.images,
        )
        for array in arrays:
            digest.update(f"{array.shape}{array.dtype}".encode())
            digest.update(np.ascontiguousarray(array).tobytes())
        return digest.hexdigest()


def read_textured_mesh(path: str | os.PathLike[str]) -> TexturedMesh:
    """All meshes of an OBJ, GLB or PLY file as one, placed by the file's scene graph, with textures.

    GLB files are turned from Y-up to Z-up; the others are taken as they are. Raises :class:`GeometryError`,
    naming the file, when it is absent, broken or without triangles.
    """
    source = Path(path)
    if not source.is_file():
        raise GeometryError(f"Cannot read a mesh from {source}: there is no such file.")
    try:
        scene = trimesh.load_scene(source, process=False)
        parts = [part for part in scene.dump() if isinstance(part, trimesh.Trimesh) and len(part.faces)]
        looks = [_look(part) for part in parts]
    except Exception as error:  # trimesh's parsers raise anything
        raise GeometryError(f"Cannot read a mesh from {source}: {type(error).__name__}: {error}") from error
    if not parts:
        raise GeometryError(f"Cannot read a mesh from {source}: it holds no triangles.")
    starts = np.cumsum([0] + [len(part.vertices) for part in parts])
    vertices = np.concatenate([part.vertices for part in parts])
    faces = np.concatenate([part.faces + start for part, start in zip(parts, starts[:-1], strict=True)])
    images: list[NDArray[np.uint8]] = []
    texture: list[NDArray[np.int64]] = []
    for part, (_, _, image) in zip(parts, looks, strict=True):
        texture.append(np.full(len(part.faces), -1 if image is None else len(images), dtype=np.int64))
        if image is not None:
            images.append(image)
    # Where the texture is cut, the parser doubles vertices; every point counts once here.
    vertices, welded = np.unique(vertices, axis=0, return_inverse=True)
    faces = welded.reshape(-1)[faces]
    try:
        mesh = TriangleMesh(to_z_up(vertices) if source.suffix.lower() == ".glb" else vertices, faces)
    except GeometryError as error:
        raise GeometryError(f"{source}: {error}") from error
    return TexturedMesh(
        mesh,
        np.concatenate([uv for uv, _, _ in looks]),
        np.concatenate(texture),
        np.concatenate([rgb for _, rgb, _ in looks]),
        tuple(images),
    )


def _look(
    part: trimesh.Trimesh,
) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.uint8] | None]:
    """A part's corner texture coordinates (F, 3, 2), corner colours (F, 3, 3) and image, if any."""
    visual, count = part.visual, len(part.faces)
    uv = np.zeros((count, 3, 2), dtype=np.float32)
    if visual.kind == "texture":
        image = _image(visual.material)
        if image is not None and visual.uv is not None:
            tint = getattr(visual.material, "baseColorFactor", None)
            rgb = np.ones(3) if tint is None else _unit(tint)[:3]
            corners = np.asarray(visual.uv, dtype=np.float32)[part.faces]
            return corners, np.broadcast_to(rgb.astype(np.float32), (count, 3, 3)), image
        rgb = _unit(visual.material.main_color)[:3]
        return uv, np.broadcast_to(rgb.astype(np.float32), (count, 3, 3)), None
    if visual.defined:
        colours = _unit(visual.vertex_colors)[:, :3].astype(np.float32)
        return uv, colours[part.faces], None
    return uv, np.full((count, 3, 3), GREY, dtype=np.float32), None


def _image(material: Any) -> NDArray[np.uint8] | None:
    image = getattr(material, "baseColorTexture", None) or getattr(material, "image", None)
    return None if image is None else np.asarray(image.convert("RGB"), dtype=np.uint8)


def _unit(colour: Any) -> NDArray[np.float64]:
    """Colours in [0, 1] from bytes or floats."""
    array = np.asarray(colour)
    return array / 255.0 if array.dtype == np.uint8 else np.clip(array.astype(np.float64), 0, 1)
