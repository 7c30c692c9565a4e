"""Small meshes with pictures on them, written as files: stand-ins for scans."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import trimesh
from PIL import Image

from gvla2.geometry.views import Views


def checkered(size: int = 64, dark=(200, 30, 30), light=(240, 220, 200)) -> Image.Image:
    rows, columns = np.indices((size, size)) // 8
    picture = np.where(((rows + columns) % 2)[..., None] == 0, dark, light).astype(np.uint8)
    return Image.fromarray(picture)


def painted(mesh: trimesh.Trimesh, image: Image.Image | None = None) -> trimesh.Trimesh:
    """The mesh with the picture wrapped about its z axis."""
    angle = np.arctan2(mesh.vertices[:, 1], mesh.vertices[:, 0]) / (2 * np.pi) + 0.5
    height = mesh.vertices[:, 2] - mesh.bounds[0, 2]
    uv = np.column_stack([angle, height / max(np.ptp(mesh.vertices[:, 2]), 1e-9)])
    material = trimesh.visual.material.SimpleMaterial(
        image=image or checkered(), diffuse=[255, 255, 255, 255]
    )
    return trimesh.Trimesh(
        mesh.vertices,
        mesh.faces,
        visual=trimesh.visual.TextureVisuals(uv=uv, material=material),
        process=False,
    )


def box(x: float, y: float, z: float) -> trimesh.Trimesh:
    return trimesh.creation.box(extents=(x, y, z)).subdivide().subdivide()


def bowl(radius: float = 0.07, height: float = 0.05, wall: float = 0.006) -> trimesh.Trimesh:
    """An open round vessel, closed as a surface."""
    outer, inner = radius, radius - wall
    profile = [[0, 0], [outer, 0], [outer, height], [inner, height], [inner, wall], [0, wall]]
    return trimesh.creation.revolve(np.array(profile), sections=32)


def write(
    folder: Path, name: str, mesh: trimesh.Trimesh, suffix: str = "obj", own_folder: bool = True
) -> Path:
    """Write a mesh as NAME/textured.obj, or as NAME.obj."""
    target = folder / name if own_folder else folder
    target.mkdir(parents=True, exist_ok=True)
    path = target / (f"textured.{suffix}" if own_folder else f"{name}.{suffix}")
    mesh.export(path)
    return path


def write_gso(model: Path, views: Views) -> None:
    """Views as a model folder of the GSO-30 layout, numbered from 0; its readers assume the lens."""
    model.mkdir(parents=True)
    for number, view in enumerate(views):
        rgba = np.dstack([view.image, np.rint(255 * view.mask).astype(np.uint8)])
        Image.fromarray(rgba).save(model / f"{number:03d}.png")
        np.save(model / f"{number:03d}.npy", (np.diag([1.0, -1, -1, 1]) @ view.camera.camera_from_world)[:3])
