"""The bodies of a MuJoCo world as scene objects, for ``perceiver=oracle``: diagnosis only."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from gvla2.geometry.transform import FloatArray, box_corners, rigid, transform_points
from gvla2.planning.scene import Scene, SceneObject, Shape
from gvla2.robot.mujoco.description import mesh_of, robot_bodies
from gvla2.robot.mujoco.world import World

MOST_POINTS = 1500
THIN = 2e-3
"""Least side of an object, metres."""

DEEP, AROUND = 0.3, 0.5
"""A body is hollow when nothing of its middle reaches within this share of its height of its top; and the share of
its half width that is its middle."""


def true_scene(world: World) -> Scene:
    """Every body that is neither the robot nor the room; a body on another's joint is a part of it.

    Labels are the bodies' names without numbers, colours those of their material, shapes boxes and plates.
    """
    model = world.model
    robot = set(robot_bodies(model, world.names.base))
    objects: list[SceneObject] = []
    for body in range(1, model.nbody):
        root = model.body(model.body_rootid[body]).name or ""
        if body in robot or root.startswith(world.scenery):
            continue
        points, colours = _looks(world, body)
        if len(points):
            parent = model.body(model.body_parentid[body]).name or ""
            parent = parent if any(o.id == parent for o in objects) else ""
            objects.append(
                _object(model.body(body).name or f"body{body}", points, colours, world, body, parent)
            )
    return Scene(tuple(objects), world.table_height, world.workspace, "oracle")


def _object(
    name: str, points: FloatArray, rgb: FloatArray, world: World, body: int, parent: str
) -> SceneObject:
    axes = world.data.xmat[body].reshape(3, 3)
    yaw = float(np.arctan2(axes[1, 0], axes[0, 0]))
    turn = Rotation.from_euler("z", yaw).as_matrix()
    local = points @ turn
    low, high = local.min(axis=0), local.max(axis=0)
    middle, extents = 0.5 * (low + high), np.maximum(high - low, THIN)
    away = np.linalg.norm((local - middle)[:, :2], axis=1)
    inner = local[away < AROUND * 0.5 * min(extents[:2])]
    wall = away[local[:, 2] > high[2] - 0.15 * extents[2]]
    hollow = len(inner) > 0 and inner[:, 2].max() < high[2] - DEEP * extents[2]
    flat = extents[2] < 0.3 * min(extents[:2])
    shape: Shape = "plate" if flat else "box"
    words = (word for word in re.split(r"[\W_]+", name) if word and not word.isdigit() and word != "main")
    return SceneObject(
        name,
        " ".join(words),
        shape,
        "",
        rigid(turn, turn @ middle),
        extents,
        points[:: max(1, len(points) // MOST_POINTS)],
        rgb,
        parent,
        opening=2 * float(np.percentile(wall, 2)) if hollow and len(wall) else 0.0,
    )


def _looks(world: World, body: int) -> tuple[FloatArray, FloatArray]:
    """Vertices (N, 3) of what is drawn of a body, world, and its mean colour (3,)."""
    found = list(_drawn(world, body))
    if not found:
        return np.zeros((0, 3)), np.zeros(3)
    return np.concatenate([points for points, _ in found]), np.mean([rgb for _, rgb in found], axis=0)


def _drawn(world: World, body: int) -> Iterator[tuple[FloatArray, FloatArray]]:
    import mujoco

    model, data = world.model, world.data
    for geom in range(model.body_geomadr[body], model.body_geomadr[body] + model.body_geomnum[body]):
        if model.geom_group[geom] not in world.groups or model.geom_rgba[geom][3] == 0:
            continue
        kind, size = model.geom_type[geom], np.array(model.geom_size[geom])
        if kind == mujoco.mjtGeom.mjGEOM_PLANE:
            continue
        if kind == mujoco.mjtGeom.mjGEOM_MESH:
            vertices = mesh_of(model, int(model.geom_dataid[geom]))[0]
        else:
            if kind in (mujoco.mjtGeom.mjGEOM_CYLINDER, mujoco.mjtGeom.mjGEOM_CAPSULE):
                size = np.array([size[0], size[0], size[1]])
            elif kind == mujoco.mjtGeom.mjGEOM_SPHERE:
                size = np.full(3, size[0])
            vertices = box_corners(2 * size)
        pose = rigid(data.geom_xmat[geom].reshape(3, 3), data.geom_xpos[geom])
        yield transform_points(pose, vertices), _colour(model, geom)


def _colour(model: Any, geom: int) -> FloatArray:
    """(3,) its material's colour, else its own; textures are not read."""
    material = model.geom_matid[geom]
    rgba = model.geom_rgba[geom] if material < 0 else model.mat_rgba[material]
    return np.array(rgba[:3], dtype=np.float64)
