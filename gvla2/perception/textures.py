"""Points on a scan's surface with the colours of its texture."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import trimesh

from gvla2.errors import GeometryError
from gvla2.geometry.glb import to_z_up
from gvla2.geometry.transform import FloatArray

GREY = 0.7
"""The colour of a mesh that has none."""


def sampled_surface(
    path: str | os.PathLike[str], count: int, seed: int = 0
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """``count`` points (N, 3) in the file's units, Z-up, evenly by area; normals (N, 3), colours (N, 3) in [0, 1].

    Raises :class:`GeometryError`, naming the file, when it is absent, broken, or has no surface.
    """
    source = Path(path)
    if not source.is_file():
        raise GeometryError(f"Cannot read a scan from {source}: there is no such file.")
    try:
        scene = trimesh.load_scene(source, process=False)
        parts = [part for part in scene.dump() if isinstance(part, trimesh.Trimesh) and len(part.faces)]
    except Exception as error:  # trimesh's parsers raise anything
        raise GeometryError(f"Cannot read a scan from {source}: {type(error).__name__}: {error}") from error
    areas = np.array([part.area for part in parts])
    if not parts or not np.isfinite(areas).all() or not areas.sum() > 0:
        raise GeometryError(f"Cannot read a scan from {source}: it holds no triangles with an area.")
    rng = np.random.default_rng(seed)
    shares = rng.multinomial(count, areas / areas.sum())
    drawn = [_sampled(part, int(n), rng) for part, n in zip(parts, shares, strict=True) if n]
    points, normals, rgb = (np.concatenate(values) for values in zip(*drawn, strict=True))
    if source.suffix.lower() == ".glb":
        points, normals = to_z_up(points), to_z_up(normals)
    if sum(part.volume for part in parts if part.is_watertight) < 0:
        normals = -normals  # faces wound inside out
    return points, normals, rgb


def _sampled(
    part: trimesh.Trimesh, count: int, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray, FloatArray]:
    area = part.area_faces
    faces = rng.choice(len(area), count, p=area / area.sum())
    # Uniform in a triangle: the square root keeps points from crowding at a corner.
    r, s = np.sqrt(rng.random(count)), rng.random(count)
    weights = np.stack([1 - r, r * (1 - s), r * s], axis=1)
    points = np.einsum("ij,ijk->ik", weights, part.triangles[faces])
    return points, np.asarray(part.face_normals[faces], dtype=np.float64), _colours(part, faces, weights)


def _colours(part: trimesh.Trimesh, faces: np.ndarray, weights: FloatArray) -> FloatArray:
    visual = part.visual
    if visual.kind == "texture" and visual.uv is not None:
        material = visual.material
        image = getattr(material, "baseColorTexture", None) or getattr(material, "image", None)
        if image is not None:
            pixels = np.asarray(image.convert("RGB"), dtype=np.float64) / 255.0
            uv = np.einsum("ij,ijk->ik", weights, np.asarray(visual.uv, dtype=np.float64)[part.faces[faces]])
            height, width = pixels.shape[:2]
            columns = np.minimum((uv[:, 0] % 1.0 * width).astype(int), width - 1)
            rows = np.minimum(((1.0 - uv[:, 1] % 1.0) * height).astype(int), height - 1)
            return np.asarray(pixels[rows, columns])
    if visual.defined:
        coloured = visual.to_color() if visual.kind == "texture" else visual
        corners = np.asarray(coloured.vertex_colors, dtype=np.float64)[:, :3] / 255.0
        return np.asarray(np.einsum("ij,ijk->ik", weights, corners[part.faces[faces]]))
    return np.full((len(faces), 3), GREY)
