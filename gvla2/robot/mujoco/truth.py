"""The bodies of a MuJoCo world as scene objects, for ``perceiver=oracle``: diagnosis only."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from gvla2.geometry.transform import FloatArray, box_corners, rigid, transform_points
from gvla2.perception.articulated import THIN, MovingPart, joint_of, part_noun, with_parts
from gvla2.planning.colours import nearest_colours
from gvla2.planning.scene import PartJoint, Scene, SceneObject, Shape
from gvla2.robot.mujoco.description import mesh_of, robot_bodies
from gvla2.robot.mujoco.world import World

MOST_POINTS = 1500
PLACES = frozenset(("top", "middle", "bottom", "upper", "lower", "left", "right", "front", "back"))
"""Words of a body's name that tell it from others of its kind."""

ROUND, ANGLES = 1.1, 2 * np.pi * np.arange(16) / 16
"""An outline is round if its reach differs by less than this factor between these directions, radians."""
DEEP, AROUND = 0.3, 0.5
"""A body is hollow when nothing of its middle reaches within this share of its height of its top; and the share of
its half width that is its middle."""


def true_scene(world: World) -> Scene:
    """Every body that is neither the robot nor the room; a body that moves on a joint of its own is a part.

    Labels are the bodies' names without numbers, colours those of their material, shapes boxes and plates.
    """
    model = world.model
    robot = set(robot_bodies(model, world.names.base))
    wholes: dict[int, dict[int, list[int]]] = {}
    for body in range(1, model.nbody):
        root = int(model.body_rootid[body])
        if body not in robot and not (model.body(root).name or "").startswith(world.scenery):
            wholes.setdefault(root, {}).setdefault(moving_body(model, body), []).append(body)
    objects: list[SceneObject] = []
    for root, members in wholes.items():
        looks = {owner: _looks(world, bodies) for owner, bodies in members.items()}
        points, colours = looks.pop(root, (np.zeros((0, 3)), np.zeros(3)))
        if not len(points):
            continue
        name = model.body(root).name or f"body{root}"
        words = _words(name)
        whole = _object(name, " ".join(words), points, colours, world.data.xmat[root].reshape(3, 3))
        parts = [_part(world, owner, words, seen) for owner, (seen, _) in looks.items() if len(seen)]
        objects += with_parts(whole, points, parts)
    return Scene(tuple(objects), world.table_height, world.workspace, "oracle")


def moving_body(model: Any, body: int) -> int:
    """The body, at or above this one, that moves on a hinge or slide; else the root of its tree."""
    import mujoco

    while body != model.body_rootid[body]:
        joints = range(model.body_jntadr[body], model.body_jntadr[body] + model.body_jntnum[body])
        if any(model.jnt_type[j] != mujoco.mjtJoint.mjJNT_FREE for j in joints):
            break
        body = int(model.body_parentid[body])
    return body


def _part(world: World, body: int, whole: Sequence[str], points: FloatArray) -> MovingPart:
    joint = model_joint(world.model, world.data, int(world.model.body_jntadr[body]))
    return MovingPart(part_label(world.model.body(body).name or "", whole, joint, points), points, joint)


def model_joint(model: Any, data: Any, joint: int) -> PartJoint:
    """A hinge or slide as it is now."""
    import mujoco

    slides = bool(model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_SLIDE)
    low, high = (float(value) for value in model.jnt_range[joint])
    now = float(data.qpos[model.jnt_qposadr[joint]])
    return joint_of(slides, data.xaxis[joint], data.xanchor[joint], now, low, high)


def part_label(body: str, whole: Sequence[str], joint: PartJoint, points: FloatArray) -> str:
    """What a moving body is called: its name's words that say where it is, and what it is."""
    places = [word for word in _words(body) if word in PLACES and word not in whole]
    return " ".join([*places, part_noun(joint, points)])


def _words(name: str) -> list[str]:
    return [word for word in re.split(r"[\W_]+", name) if word and not word.isdigit() and word != "main"]


def _object(name: str, label: str, points: FloatArray, rgb: FloatArray, axes: FloatArray) -> SceneObject:
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
    round_ = _is_round(local[:, :2] - middle[:2])
    shape: Shape = ("disc" if round_ else "plate") if flat else ("cylinder" if round_ else "box")
    return SceneObject(
        name,
        label,
        shape,
        nearest_colours(rgb, 1)[0][0],
        rigid(turn, turn @ middle),
        extents,
        points[:: max(1, len(points) // MOST_POINTS)],
        rgb,
        opening=2 * float(np.percentile(wall, 2)) if hollow and len(wall) else 0.0,
        named_by="oracle",
    )


def _is_round(points: FloatArray) -> bool:
    """Whether an outline (N, 2) about the origin reaches about equally far in all directions."""
    ways = np.stack([np.cos(ANGLES), np.sin(ANGLES)])
    reach = (points @ ways).max(axis=0)
    return bool(reach.max() < ROUND * reach.min())


def _looks(world: World, bodies: Sequence[int]) -> tuple[FloatArray, FloatArray]:
    """Vertices (N, 3) of what is drawn of bodies, world, and their mean colour (3,)."""
    found = [one for body in bodies for one in _drawn(world, body)]
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
    """(3,) the mean of its texture at its vertices, else its material's colour, else its own."""
    material, mesh = int(model.geom_matid[geom]), int(model.geom_dataid[geom])
    if material < 0:
        return np.array(model.geom_rgba[geom][:3], dtype=np.float64)
    texture = next((int(i) for i in np.ravel(model.mat_texid[material]) if i >= 0), -1)
    if texture < 0 or mesh < 0 or not model.mesh_texcoordnum[mesh]:
        return np.array(model.mat_rgba[material][:3], dtype=np.float64)
    first, size = model.mesh_texcoordadr[mesh], (model.tex_height[texture], model.tex_width[texture], -1)
    u, v = model.mesh_texcoord[first : first + model.mesh_texcoordnum[mesh]].T % 1.0
    begin, depth = model.tex_adr[texture], model.tex_nchannel[texture]
    image = model.tex_data[begin : begin + size[0] * size[1] * depth].reshape(size)[..., :3]
    seen = image[(v * (size[0] - 1)).astype(int), (u * (size[1] - 1)).astype(int)]
    return np.asarray(seen.mean(axis=0) / 255.0)
