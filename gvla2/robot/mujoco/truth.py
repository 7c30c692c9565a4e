"""The bodies of a MuJoCo world as scene objects, for ``perceiver=oracle``: diagnosis only."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from gvla2.geometry.transform import FloatArray, rigid
from gvla2.perception.articulated import MovingPart, joint_of, part_noun, with_parts
from gvla2.perception.objects import object_of, opening_of
from gvla2.planning.scene import PartJoint, Scene, SceneObject
from gvla2.robot.mujoco.description import painted, robot_bodies
from gvla2.robot.mujoco.world import World

PLACES = frozenset(("top", "middle", "bottom", "upper", "lower", "left", "right", "front", "back"))
"""Words of a body's name that tell it from others of its kind."""

ROOM = re.compile(r"floor|wall|ground|(\w+_)?table")
"""What the names of bodies that belong to the room begin with."""


def true_scene(world: World) -> Scene:
    """Every body that is neither the robot nor the room; a body that moves on a joint of its own is a part.

    Labels are the bodies' names without numbers, colours those of their material.
    """
    model = world.model
    robot = set(robot_bodies(model, world.names.base))
    wholes: dict[int, dict[int, list[int]]] = {}
    for body in range(1, model.nbody):
        root = int(model.body_rootid[body])
        if body not in robot and not ROOM.match(model.body(root).name or ""):
            wholes.setdefault(root, {}).setdefault(moving_body(model, body), []).append(body)
    objects: list[SceneObject] = []
    for root, members in wholes.items():
        looks = {owner: _looks(world, bodies) for owner, bodies in members.items()}
        points, colours = looks.pop(root, (np.zeros((0, 3)), np.zeros((0, 3))))
        if not len(points):
            continue
        name = model.body(root).name or f"body{root}"
        words = _words(name)
        whole = object_of(points, colours, world.table_height, 1.0, name)
        bottom, top = points[:, 2].min(), points[:, 2].max()  # known, unlike those of a perceived object
        pose = rigid(whole.world_from_object[:3, :3], [*whole.centre[:2], 0.5 * (bottom + top)])
        sides = np.array([*whole.extents[:2], max(top - bottom, 1e-3)])
        whole = replace(whole, label=" ".join(words), world_from_object=pose, extents=sides)
        whole = replace(whole, opening=opening_of(points), confidence=1.0, named_by="oracle")
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


def _looks(world: World, bodies: Sequence[int]) -> tuple[FloatArray, FloatArray]:
    """Points (N, 3) on what is drawn of bodies, world, and their colours (N, 3)."""
    drawn = [mesh for body in bodies for mesh in painted(world.model, world.data, body, world.groups)]
    points = [mesh.vertices for mesh in drawn]
    # A mesh without a texture has one colour, (4,), which counts for each of its vertices.
    paint = [np.atleast_2d(mesh.visual.to_color().vertex_colors)[:, :3] / 255.0 for mesh in drawn]
    colours = [np.broadcast_to(c, (len(p), 3)) for c, p in zip(paint, points, strict=True)]
    return np.concatenate([np.zeros((0, 3)), *points]), np.concatenate([np.zeros((0, 3)), *colours])
