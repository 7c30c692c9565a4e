"""Turning a task's layout into SAPIEN's actors and articulations."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from typing import Any

import numpy as np

from gvla2.errors import MissingDependencyError
from gvla2.geometry.transform import FloatArray, invert_rigid, rigid
from gvla2.robot.scan import Scan
from gvla2.robot.task import Body, Joint, Layout, Solid
from gvla2_plugins.sapien.convex import piece_file, pieces


def import_sapien() -> Any:
    """The module ``sapien``; raises :class:`MissingDependencyError` naming the missing part."""
    try:
        with warnings.catch_warnings():
            # It looks for Vulkan, which CPU physics does not need.
            warnings.simplefilter("ignore")
            import sapien
            import sapien.physx
    except ImportError as error:
        missing = (
            "the package 'sapien'" if error.name == "sapien" else f"a system library of SAPIEN ({error})"
        )
        raise MissingDependencyError(
            missing,
            "A simulated arm (robot=sapien_panda and the like)",
            'pip install "gvla2[sim]" (on Linux; Debian and Ubuntu also need apt-get install libx11-6 libgl1)',
        ) from error
    return sapien


PREFIX = "task/"
"""Prefix of a layout's bodies in SAPIEN, so that they are never mistaken for robot links."""

_STANDING = rigid([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
"""Turns SAPIEN's cylinders, which lie along x, so that they stand along z."""


@dataclass(frozen=True)
class BuiltBodies:
    """``entities`` by the body's name; ``joints``: by the joint's name, its articulation and its place in it."""

    entities: dict[str, Any]
    joints: dict[str, tuple[Any, int]]


def build_bodies(scene: Any, layout: Layout) -> BuiltBodies:
    """Put all bodies and joints of a layout, which :mod:`gvla2.robot.task` has checked, into the scene."""
    parents = {joint.parent for joint in layout.joints}
    children = {joint.child for joint in layout.joints}
    built = BuiltBodies({}, {})
    for body in layout.bodies:
        if body.name not in parents | children:
            built.entities[body.name] = _build_actor(scene, body)
    for root in (b for b in layout.bodies if b.name in parents - children):
        _build_tree(scene, root, layout, built)
    return built


def pose_of(matrix: FloatArray) -> Any:
    """SAPIEN's pose of a rigid (4, 4) matrix."""
    return import_sapien().Pose(np.asarray(matrix, dtype=np.float32))


def _build_actor(scene: Any, body: Body) -> Any:
    builder = scene.create_actor_builder()
    builder.set_initial_pose(pose_of(body.world_from_body))
    _add_solids(builder, body)
    name = PREFIX + body.name
    return builder.build_static(name) if body.fixed else builder.build(name)


def _build_tree(scene: Any, root: Body, layout: Layout, built: BuiltBodies) -> None:
    """One articulation: ``root`` and everything attached to it."""
    builder = scene.create_articulation_builder()
    builder.set_initial_pose(pose_of(root.world_from_body))
    links = {root.name: builder.create_link_builder()}
    links[root.name].set_name(PREFIX + root.name)
    _add_solids(links[root.name], root)
    joints: dict[str, Joint] = {}
    waiting = [joint for joint in layout.joints if joint.parent == root.name]
    while waiting:
        joint = waiting.pop(0)
        joints[joint.name] = joint
        waiting += [j for j in layout.joints if j.parent == joint.child]
        link = links[joint.child] = builder.create_link_builder(links[joint.parent])
        link.set_name(PREFIX + joint.child)
        link.set_joint_name(joint.name)
        frame, ends = axis_frame(joint.axis, joint.origin), (layout[joint.parent], layout[joint.child])
        on_ends = [pose_of(invert_rigid(body.world_from_body) @ frame) for body in ends]
        link.set_joint_properties(joint.kind, [joint.limits], *on_ends)
        _add_solids(link, layout[joint.child])
    articulation = builder.build(fix_root_link=root.fixed)
    start = []
    for index, made in enumerate(articulation.active_joints):
        joint = joints[made.name]
        made.set_friction(joint.friction)  # the builder ignores the given friction
        made.set_drive_property(joint.stiffness, joint.damping)
        made.set_drive_target(joint.rest)
        start.append(np.clip(joint.rest, *joint.limits))
        built.joints[made.name] = (articulation, index)
    articulation.set_qpos(np.array(start, dtype=np.float32))
    for link in articulation.links:
        built.entities[link.name.removeprefix(PREFIX)] = link.entity


def _add_solids(builder: Any, body: Body) -> None:
    """The body's colliding solids, of the density that gives its mass."""
    physx = import_sapien().physx
    solids = [solid for solid in body.solids if solid.collides]
    volume = sum(_volume(solid) for solid in solids)
    material = physx.PhysxMaterial(body.friction, body.friction, 0.0)
    for solid in solids:
        how = {"material": material, "density": body.mass / volume}
        pose, half = solid.body_from_shape, [0.5 * side for side in solid.size]
        if isinstance(solid, Scan):
            builder.add_multiple_convex_collisions_from_file(str(piece_file(solid)), pose_of(pose), **how)
        elif solid.kind == "box":
            builder.add_box_collision(pose_of(pose), half_size=half, **how)
        elif solid.kind == "cylinder":
            standing = pose_of(pose @ _STANDING)
            builder.add_cylinder_collision(standing, radius=half[0], half_length=half[2], **how)
        else:
            builder.add_sphere_collision(pose_of(pose), radius=half[0], **how)


def axis_frame(axis: FloatArray, origin: FloatArray) -> FloatArray:
    """world_from_joint (4, 4): SAPIEN's joints and drives move along or about their own x axis."""
    x = np.asarray(axis, dtype=np.float64)
    x = x / np.linalg.norm(x)
    aside = np.eye(3)[int(np.argmin(np.abs(x)))]
    y = np.cross(aside, x)
    y = y / np.linalg.norm(y)
    return rigid(np.stack([x, y, np.cross(x, y)], axis=1), origin)


def _volume(solid: Solid) -> float:
    if isinstance(solid, Scan):
        return sum(piece.hull.volume for piece in pieces(solid))
    x, y, z = solid.size
    return {"box": x * y * z, "cylinder": np.pi / 4 * x * y * z, "sphere": np.pi / 6 * x**3}[solid.kind]
