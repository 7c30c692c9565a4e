"""A task's layout as SAPIEN's actors and articulations, with threads that come loose and catches that hold a joint."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from typing import Any

import numpy as np
import trimesh
from scipy.spatial.transform import Rotation

from gvla2.errors import MissingDependencyError
from gvla2.geometry.convex import piece_file
from gvla2.geometry.transform import FloatArray, invert_rigid, rigid
from gvla2.robot.scan import Scan
from gvla2.robot.task import Body, Catch, Joint, Layout, Solid, Thread


def import_sapien() -> Any:
    """The module ``sapien``; raises :class:`MissingDependencyError` naming what is missing."""
    try:
        with warnings.catch_warnings():
            # It looks for Vulkan, which CPU physics does not need.
            warnings.simplefilter("ignore")
            import sapien
            import sapien.physx
    except ImportError as error:
        raise MissingDependencyError(
            f"SAPIEN or a system library of it ({error})",
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
            builder.add_multiple_convex_collisions_from_file(
                str(piece_file(solid.textured.mesh)), pose_of(pose), **how
            )
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
        return float(trimesh.load_mesh(piece_file(solid.textured.mesh)).volume)  # of all its pieces
    x, y, z = solid.size
    return {"box": x * y * z, "cylinder": np.pi / 4 * x * y * z, "sphere": np.pi / 6 * x**3}[solid.kind]


SLACK = 0.02
"""Compliance of a thread's stop, radians, so that it does not oscillate."""
FAR = 0.5 * np.pi
"""Radians of turn after which a thread of more than half a turn is re-tied."""
BINDS = 0.01
"""Radians per physics step above which a long thread binds: a hand turns it more slowly, and fingers that slip off its
cap would spin it loose.
"""
LEANS = np.deg2rad(1.0)
"""A screwed body that leans by more is set upright: the engine holds it in its place, but fingers that slip off it tip
it on its edge, where it would stay.
"""
HALF = np.pi - SLACK
"""Radians either way that the engine can bound."""


class Screwed:
    """One thread, tight until it is loose. ``angle`` is the turn now, radians; ``peak`` the largest either way."""

    def __init__(self, scene: Any, thread: Thread, layout: Layout, entities: dict[str, Any]) -> None:
        self._scene, self._thread = scene, thread
        self._parent, self._child = entities[thread.parent], entities[thread.child]
        low, high = thread.limits
        self._long = low < -np.pi or high > np.pi
        frame = axis_frame(thread.axis, thread.origin)
        parent, child = layout[thread.parent].world_from_body, layout[thread.child].world_from_body
        self._axis = parent[:3, :3].T @ frame[:3, 0]
        self._start = parent[:3, :3].T @ child[:3, :3]
        self._mover = next(c for c in self._child.components if hasattr(c, "set_angular_velocity"))
        self._frames = tuple(pose_of(invert_rigid(body) @ frame) for body in (parent, child))
        self._drive: Any = None
        self.loose = False
        self.angle = self.peak = 0.0
        self._tie()

    def _tie(self) -> None:
        """Tie the two at the present turn: the engine's joints know no turns beyond a half either way."""
        if self._drive is not None:
            self._child.remove_component(self._drive)
        # By quaternions, whose sign the engine respects: a matrix would not distinguish a whole turn from none.
        half = 0.5 * self.angle
        back = import_sapien().Pose([0.0, 0.0, 0.0], [np.cos(half), -np.sin(half), 0.0, 0.0])
        parent, child = self._frames
        self._drive = self._scene.create_drive(self._parent, parent, self._child, child * back)
        for lock in (self._drive.set_limit_x, self._drive.set_limit_y, self._drive.set_limit_z):
            lock(0.0, 0.0)
        self._drive.set_limit_cone(0.0, 0.0)
        low, high = (limit - self.angle for limit in self._thread.limits)
        if self._long:
            low, high = max(low, SLACK - HALF), min(high, HALF - SLACK)
        self._drive.set_limit_twist(low - SLACK, high + SLACK)
        self._drive.set_drive_property_twist(0.0, self._thread.damping)
        self._tied_at = self.angle

    def watch(self) -> None:
        """Read the turn, and release the child when it is far enough."""
        if self.loose:
            return
        turned = Rotation.from_matrix(_turn(self._parent).T @ _turn(self._child) @ self._start.T)
        # About the axis, whatever the child tilts, and over whole turns: never more than half of one at a time.
        x, y, z, w = turned.as_quat()
        step = 2.0 * float(np.arctan2(self._axis @ (x, y, z), w)) - self.angle
        step = (step + np.pi) % (2.0 * np.pi) - np.pi
        if self._long and abs(step) > BINDS:
            self._mover.set_angular_velocity([0.0, 0.0, 0.0])
        self.angle += step
        self.peak = max(self.peak, abs(self.angle))
        if turned.apply(self._axis) @ self._axis < np.cos(LEANS):
            self._set_upright()
        if self._long and abs(self.angle - self._tied_at) > FAR:
            self._tie()
        if self.peak >= self._thread.release:
            self._child.remove_component(self._drive)
            self.loose = True

    def _set_upright(self) -> None:
        """Remove the lean of the child."""
        straight = Rotation.from_rotvec(self.angle * self._axis).as_matrix()
        self._child.set_pose(pose_of(rigid(_turn(self._parent) @ straight @ self._start, self._child.pose.p)))
        self._mover.set_angular_velocity([0.0, 0.0, 0.0])


def _turn(entity: Any) -> FloatArray:
    return np.asarray(entity.pose.to_transformation_matrix(), dtype=np.float64)[:3, :3]


class Caught:
    """One catch: it locks or unlocks while its joint is at rest, and stays free once that has moved."""

    def __init__(self, catch: Catch, held: Joint, joints: dict[str, tuple[Any, int]]) -> None:
        self._catch, self._free = catch, held.limits
        low, high = held.limits
        self._shut = (max(low, held.rest - catch.play), min(high, held.rest + catch.play))
        self._articulation, self._index = joints[catch.joint]
        self._joint = self._articulation.active_joints[self._index]
        self._key, self._place = joints[catch.key]
        self._holds, self._gone = True, False
        self._joint.set_limits([list(self._shut)])

    def watch(self) -> None:
        """Lock or unlock by the key's present position."""
        if self._gone:
            return
        (low, high), play = self._shut, self._catch.play
        at = float(self._articulation.qpos[self._index])
        self._gone = not self._holds and not low - play <= at <= high + play
        key = float(self._key.qpos[self._place])
        holds = not self._gone and not self._catch.travel <= key <= self._catch.until
        if holds != self._holds:
            self._holds = holds
            self._joint.set_limits([list(self._shut if holds else self._free)])
