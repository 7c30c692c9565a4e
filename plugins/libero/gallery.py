"""The known objects of LIBERO as a gallery: a GLB file each, in metres, named as the suites name them."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from PIL import Image

from gvla2.errors import ConfigurationError
from gvla2.geometry.mesh_files import to_y_up
from gvla2.geometry.transform import rigid, transform_points
from gvla2.robot.mujoco.description import mesh_of
from gvla2.robot.mujoco.stepping import DRAWN, silent
from gvla2_plugins.libero.worlds import Sentences, import_benchmark

SUITES = ("libero_spatial", "libero_object", "libero_goal", "libero_10")
"""Whose objects are known by default."""

TEXTURE = 512
"""Longest side of a written texture, pixels: recognition samples 3000 points."""


def write_gallery(folder: Path, suites: Sequence[str] = SUITES) -> list[str]:
    """Write the rigid objects that the suites' tasks name, from the package's meshes; returns their names.

    Fixtures with joints (cabinets, stoves) are left out. Raises :class:`ConfigurationError` for an unknown suite.
    """
    benchmark = import_benchmark()
    unknown = [suite for suite in suites if suite not in benchmark.task_maps]
    if unknown:
        raise ConfigurationError(
            f"LIBERO has no suite {', '.join(unknown)}; it has {', '.join(benchmark.task_maps)}."
        )
    with silent():
        from libero.libero.envs.objects import OBJECTS_DICT
    files = [file for task, file in Sentences().files.items() if task.partition("/")[0] in suites]
    named = {name for file in files for name in _categories(file.read_text())}
    written = []
    for name in sorted(named & OBJECTS_DICT.keys()):
        made = _scene(Path(OBJECTS_DICT[name](name=name).file))
        if made is not None:
            folder.mkdir(parents=True, exist_ok=True)
            made.export(folder / f"{name}.glb")
            written.append(name)
    return written


def _categories(bddl: str) -> set[str]:
    """The categories of a task's objects and fixtures, from ``(:objects name_1 name_2 - category ...)``."""
    blocks = re.findall(r"\(:(?:objects|fixtures)([^)]*)\)", bddl)
    return {category for block in blocks for category in re.findall(r"-\s+(\w+)", block)}


def _scene(file: Path) -> Any:
    """What is drawn of a rigid object, Y up as GLB has it; None for one with joints or that only LIBERO can load."""
    import mujoco

    try:
        model = mujoco.MjModel.from_xml_path(str(file))
    except ValueError:
        return None
    if model.njnt:
        return None
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    scene = trimesh.Scene()
    for geom in range(model.ngeom):
        if model.geom_group[geom] in DRAWN and model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_MESH:
            pose = rigid(data.geom_xmat[geom].reshape(3, 3), data.geom_xpos[geom])
            scene.add_geometry(_painted(model, geom, pose))
    return scene if scene.geometry else None


def _painted(model: Any, geom: int, pose: np.ndarray) -> Any:
    mesh = int(model.geom_dataid[geom])
    vertices, faces = mesh_of(model, mesh)
    material, image = int(model.geom_matid[geom]), None
    rgba = model.geom_rgba[geom] if material < 0 else model.mat_rgba[material]
    texture = -1 if material < 0 else int(np.ravel(model.mat_texid[material]).max())
    if texture >= 0:
        size = int(model.tex_height[texture]), int(model.tex_width[texture]), int(model.tex_nchannel[texture])
        first = int(model.tex_adr[texture])
        pixels = np.asarray(model.tex_data[first : first + np.prod(size)]).reshape(size)
        image = Image.fromarray(pixels[..., :3])
        image.thumbnail((TEXTURE, TEXTURE))
    paint = trimesh.visual.material.PBRMaterial(
        baseColorTexture=image, baseColorFactor=np.rint(255 * np.array([*rgba[:3], 1.0])).astype(np.uint8)
    )
    corners = faces.ravel()
    uv = None
    if image is not None and model.mesh_texcoordnum[mesh] > 0:
        face, at = model.mesh_faceadr[mesh], model.mesh_texcoordadr[mesh]
        indices = np.asarray(model.mesh_facetexcoord[face : face + len(faces)]).ravel()
        uv = np.asarray(model.mesh_texcoord[at : at + model.mesh_texcoordnum[mesh]])[indices] * [1, -1] + [
            0,
            1,
        ]
    return trimesh.Trimesh(
        to_y_up(transform_points(pose, vertices[corners])),
        np.arange(len(corners)).reshape(-1, 3),
        visual=trimesh.visual.TextureVisuals(uv=uv, material=paint),
        process=False,
    )
