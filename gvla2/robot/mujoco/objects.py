"""What a MuJoCo model draws, object by object: for ``perceiver=oracle``, and for galleries of known objects."""

from __future__ import annotations

import re
from collections.abc import Collection, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from PIL import Image

from gvla2.geometry.mesh import TriangleMesh
from gvla2.geometry.transform import FloatArray, rigid
from gvla2.perception.articulated import MovingPart, joint_of, part_noun, with_parts
from gvla2.perception.objects import object_of, opening_of
from gvla2.planning.scene import Box, Scene, SceneObject
from gvla2.robot.mujoco.arm import geom_mesh

PLACES = frozenset(("top", "middle", "bottom", "upper", "lower", "left", "right", "front", "back"))
"""Words of a body's name that tell it from others of its kind."""

ROOM = re.compile(r"floor|wall|ground|(\w+_)?table")
"""What the names of bodies that belong to the room begin with."""

TEXTURE = 512
"""Longest side of a texture, pixels: recognition samples 3000 points."""


def true_scene(
    model: Any, data: Any, groups: Sequence[int], robot: Collection[int], table_height: float, workspace: Box
) -> Scene:
    """Every body that is neither the robot's nor the room; a body that moves on a joint of its own is a part.

    Labels are the bodies' names without numbers, colours those of their material.
    """
    objects: list[SceneObject] = []
    for root, drawn in drawn_objects(model, data, groups, robot).items():
        name = model.body(root).name or f"body{root}"
        if root not in drawn or ROOM.match(name):
            continue
        points, colours = _surface(drawn[root])
        whole = object_of(points, colours, table_height, 1.0, name)
        bottom, top = points[:, 2].min(), points[:, 2].max()  # known, unlike those of a perceived object
        pose = rigid(whole.world_from_object[:3, :3], [*whole.centre[:2], 0.5 * (bottom + top)])
        sides = np.array([*whole.extents[:2], max(top - bottom, 1e-3)])
        whole = replace(whole, label=" ".join(_words(name)), world_from_object=pose, extents=sides)
        whole = replace(whole, opening=opening_of(points), confidence=1.0, named_by="oracle")
        parts = [moving_part(model, data, body, meshes) for body, meshes in drawn.items() if body != root]
        objects += with_parts(whole, points, parts)
    return Scene(tuple(objects), table_height, workspace, "oracle")


def drawn_objects(
    model: Any, data: Any, groups: Sequence[int], without: Collection[int] = ()
) -> dict[int, dict[int, list[Any]]]:
    """What is drawn of each object, by the body at its root: trimeshes (world, metres) by the body that moves them, the
    root itself or one on a hinge or slide.
    """
    objects: dict[int, dict[int, list[Any]]] = {}
    for body in range(1, model.nbody):
        if body not in without and (meshes := _painted(model, data, body, groups)):
            drawn = objects.setdefault(int(model.body_rootid[body]), {})
            drawn.setdefault(_moving_body(model, body), []).extend(meshes)
    return objects


def _moving_body(model: Any, body: int) -> int:
    """The body, at or above this one, that moves on a hinge or slide; else the root of its tree."""
    import mujoco

    while body != model.body_rootid[body]:
        joints = range(model.body_jntadr[body], model.body_jntadr[body] + model.body_jntnum[body])
        if any(model.jnt_type[j] != mujoco.mjtJoint.mjJNT_FREE for j in joints):
            break
        body = int(model.body_parentid[body])
    return body


def moving_part(model: Any, data: Any, body: int, meshes: Sequence[Any]) -> MovingPart:
    """What moves with a body on a hinge or slide, as it is now; its name has the words of the body's that say where it
    is, and what it is.
    """
    import mujoco

    number = int(model.body_jntadr[body])
    slides = bool(model.jnt_type[number] == mujoco.mjtJoint.mjJNT_SLIDE)
    now, (low, high) = float(data.qpos[model.jnt_qposadr[number]]), map(float, model.jnt_range[number])
    joint = joint_of(slides, data.xaxis[number], data.xanchor[number], now, low, high)
    points, whole = _surface(meshes)[0], _words(model.body(model.body_rootid[body]).name)
    places = [word for word in _words(model.body(body).name) if word in PLACES and word not in whole]
    return MovingPart(" ".join([*places, part_noun(joint, points)]), points, joint)


def _words(name: str) -> list[str]:
    return [word for word in re.split(r"[\W_]+", name) if word and not word.isdigit() and word != "main"]


def _surface(meshes: Sequence[Any]) -> tuple[FloatArray, FloatArray]:
    """The vertices (N, 3) of trimeshes and their colours (N, 3)."""
    points = [mesh.vertices for mesh in meshes]
    # A mesh without a texture has one colour, (4,), which counts for each of its vertices.
    paint = [np.atleast_2d(mesh.visual.to_color().vertex_colors)[:, :3] / 255.0 for mesh in meshes]
    colours = [np.broadcast_to(c, (len(p), 3)) for c, p in zip(paint, points, strict=True)]
    return np.concatenate(points), np.concatenate(colours)


def _painted(model: Any, data: Any, body: int, groups: Sequence[int]) -> list[Any]:
    """What is drawn of a body as trimeshes, world, metres: meshes with their textures, the rest in the mean colour."""
    import trimesh

    made = []
    for geom in range(model.body_geomadr[body], model.body_geomadr[body] + model.body_geomnum[body]):
        if model.geom_group[geom] not in groups or model.geom_rgba[geom][3] == 0:
            continue
        material, image = int(model.geom_matid[geom]), None
        rgba = np.array(model.geom_rgba[geom] if material < 0 else model.mat_rgba[material])
        texture = -1 if material < 0 else int(np.ravel(model.mat_texid[material]).max())
        if texture >= 0:
            size = (int(table[texture]) for table in (model.tex_height, model.tex_width, model.tex_nchannel))
            height, width, depth = size
            first = int(model.tex_adr[texture])
            pixels = np.asarray(model.tex_data[first : first + height * width * depth])
            image = Image.fromarray(pixels.reshape(height, width, depth)[..., :3])
            image.thumbnail((TEXTURE, TEXTURE))
        mesh = geom_mesh(model, geom)
        if mesh is None:
            continue
        shape, uv = _unwrapped(model, geom, mesh)
        if image is None:
            uv = None
        elif uv is None:
            rgba[:3] *= np.asarray(image).reshape(-1, 3).mean(axis=0) / 255
            image = None
        paint = np.rint(255 * np.array([*rgba[:3], 1.0])).astype(np.uint8)
        material = trimesh.visual.material.PBRMaterial(baseColorTexture=image, baseColorFactor=paint)
        shape.visual = trimesh.visual.TextureVisuals(uv=uv, material=material)
        shape.apply_transform(rigid(data.geom_xmat[geom].reshape(3, 3), data.geom_xpos[geom]))
        made.append(shape)
    return made


def _unwrapped(model: Any, geom: int, mesh: TriangleMesh) -> tuple[Any, Any]:
    """The surface of a geom as a trimesh, and texture coordinates (V, 2) if it is a mesh that has them."""
    import trimesh

    number = int(model.geom_dataid[geom])
    if number < 0:
        return trimesh.Trimesh(mesh.vertices, mesh.faces, process=False), None
    corners, uv = mesh.faces.ravel(), None
    if model.mesh_texcoordnum[number] > 0:
        face, at = model.mesh_faceadr[number], model.mesh_texcoordadr[number]
        indices = np.asarray(model.mesh_facetexcoord[face : face + len(mesh.faces)]).ravel()
        # MuJoCo counts rows of a picture from above.
        uv = model.mesh_texcoord[at : at + model.mesh_texcoordnum[number]][indices] * [1, -1] + [0, 1]
    alone = np.arange(len(corners)).reshape(-1, 3)
    return trimesh.Trimesh(mesh.vertices[corners], alone, process=False), uv
