"""Collision model: the arm's links as convex hulls, the perceived scene as simple solids."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Sequence
from functools import cached_property
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gvla2.geometry.transform import FloatArray
from gvla2.planning.arm import Attachment, Clearance
from gvla2.planning.scene import Scene, SceneObject
from gvla2.robot.kinematics import Kinematics
from gvla2.robot.libraries import library
from gvla2.robot.link_hulls import link_geometry
from gvla2.robot.self_collision import disabled, usually_close

TABLE = "table"
"""The name of the supporting plane in ``allowed_contacts`` and in :class:`Clearance`."""


class CollisionChecker:
    """Checks joint configurations at one opening of the hand against one scene; see :meth:`CollisionModel.checker`.

    Not safe to share between threads.
    """

    def __init__(
        self, kinematics: Kinematics, data: Any, geometry: Any, gripper: float, n_world: int
    ) -> None:
        self._pin = library("pinocchio")
        self._kinematics, self._geometry = kinematics, geometry
        self._q = kinematics.full(np.zeros(kinematics.dof), gripper)
        self._index = kinematics.arm_index
        self._data, self._geometry_data = data, geometry.createData()
        self.n_world = n_world
        self._margins = np.zeros(n_world)

    @cached_property
    def pairs(self) -> tuple[tuple[str, str], ...]:
        """The checked pairs; the first ``n_world`` have a part of the scene as the second."""
        names = [_part(o) for o in self._geometry.geometryObjects]
        return tuple((names[p.first], names[p.second]) for p in self._geometry.collisionPairs)

    def set_margins(self, margins: float | FloatArray) -> None:
        """How far (metres) the parts of each world pair must stay apart: one for all, or (n_world,).

        Negative margins tolerate that much penetration; the arm's own parts only must not touch.
        """
        values = np.broadcast_to(np.asarray(margins, dtype=np.float64), (self.n_world,))
        if np.array_equal(values, self._margins):
            return
        self._margins = values.copy()
        for request, value in zip(self._geometry_data.collisionRequests, values, strict=False):
            request.security_margin = float(value)

    def free(self, joints: FloatArray) -> bool:
        """Whether joints (dof,) keep all margins."""
        self._q[self._index] = joints
        return not self._pin.computeCollisions(
            self._kinematics.model, self._data, self._geometry, self._geometry_data, self._q, True
        )

    def first_blocked(self, path: FloatArray) -> int | None:
        """Index of a configuration of the path (N, dof) that breaks a margin; None when there is none.

        They are checked in bisecting order, so that a blocked path is found early.
        """
        return next((int(i) for i in _bisecting(len(path)) if not self.free(path[i])), None)

    def distances(self, joints: FloatArray) -> FloatArray:
        """(pairs,) signed distances in metres, negative where the parts overlap."""
        if not len(self._geometry.collisionPairs):
            return np.empty(0)
        self._q[self._index] = joints
        self._pin.computeDistances(
            self._kinematics.model, self._data, self._geometry, self._geometry_data, self._q
        )
        return np.array([result.min_distance for result in self._geometry_data.distanceResults])

    def clearance(self, joints: FloatArray) -> Clearance:
        """The smallest of the distances and its pair."""
        distances = self.distances(joints)
        if not len(distances):
            return Clearance(np.inf)
        nearest = int(distances.argmin())
        return Clearance(float(distances[nearest]), *self.pairs[nearest])


class CollisionModel:
    """An arm's solids, and checkers of them against scenes; the latest checkers are kept.

    Pairs of links that the SRDF disables are left out; for links that it does not name, or without one, pairs that are
    usually close. ``overlapping`` are the pairs whose hulls overlap harmlessly: physics must ignore them.
    ``hand_links`` (URDF links) may touch a waypoint's allowed contacts, other links never.
    """

    def __init__(
        self,
        kinematics: Kinematics,
        urdf: Path,
        package_dirs: Sequence[Path],
        *,
        hand_links: Sequence[str],
        srdf: Path | None = None,
        kept: int = 12,
    ) -> None:
        self._kinematics = kinematics
        self._robot = link_geometry(kinematics, urdf, package_dirs)
        self._hand = frozenset(hand_links)
        solids = [(_part(o), o.parentJoint) for o in self._robot.geometryObjects]
        close = usually_close(kinematics, self._robot, self._hand)
        told = set() if srdf is None else disabled(srdf)
        named = {link for pair in told for link in pair}
        harmless = told | {pair for pair in close if not pair <= named}
        self.overlapping = close if srdf is None else close | disabled(srdf, "Default")
        self._self_pairs = [
            (i, j)
            for (i, (one, a)), (j, (other, b)) in combinations(enumerate(solids), 2)
            if a != b and frozenset((one, other)) not in harmless
        ]
        self._data = kinematics.model.createData()  # of one configuration, for any checker
        self._checkers: OrderedDict[object, CollisionChecker] = OrderedDict()
        self._scene: tuple[Scene | None, object] = None, None
        self._kept = kept

    def checker(
        self,
        scene: Scene,
        gripper: float,
        allowed_contacts: frozenset[str] = frozenset(),
        attached: Attachment | None = None,
    ) -> CollisionChecker:
        """A checker with zero margins; see :meth:`gvla2.planning.arm.Arm.clearance` for the arguments."""
        if self._scene[0] is not scene:
            self._scene = scene, _scene_key(scene)
        key = (self._scene[1], round(gripper, 4), allowed_contacts, _attachment_key(attached))
        checker = self._checkers.get(key)
        if checker is None:
            checker = self._build(scene, gripper, allowed_contacts, attached)
            self._checkers[key] = checker
            if len(self._checkers) > self._kept:
                self._checkers.popitem(last=False)
        self._checkers.move_to_end(key)
        checker.set_margins(0.0)
        return checker

    def _build(
        self, scene: Scene, gripper: float, allowed: frozenset[str], attached: Attachment | None
    ) -> CollisionChecker:
        pin = library("pinocchio")
        geometry = self._robot.copy()
        links = [(i, _part(o)) for i, o in enumerate(geometry.geometryObjects)]
        still = {i for i, o in enumerate(geometry.geometryObjects) if o.parentJoint == 0}
        self_pairs = list(self._self_pairs)
        hand = self._hand
        if attached is not None:
            held = attached.object
            joint = self._kinematics.tcp_joint
            placement = pin.SE3(self._kinematics.joint_from_tcp @ attached.tcp_from_object)
            index = geometry.addGeometryObject(pin.GeometryObject(held.id, joint, 0, placement, _solid(held)))
            self_pairs += [
                (i, index)
                for i, name in links
                if name not in hand and geometry.geometryObjects[i].parentJoint != joint
            ]
            links.append((index, held.id))
            hand = hand | {held.id}
        world = [(TABLE, library("coal").Halfspace(np.array([0.0, 0.0, 1.0]), scene.table_height), np.eye(4))]
        ignored = frozenset() if attached is None else frozenset({attached.object.id})
        world += [(o.id, _solid(o), o.world_from_object) for o in scene.obstacles(ignored)]
        n_world = 0
        for name, solid, placement in world:
            index = geometry.addGeometryObject(pin.GeometryObject(name, 0, 0, pin.SE3(placement), solid))
            for i, part in links:
                if i in still or (part in hand and name in allowed):
                    continue
                geometry.addCollisionPair(pin.CollisionPair(i, index))
                n_world += 1
        for first, second in self_pairs:
            geometry.addCollisionPair(pin.CollisionPair(first, second))
        return CollisionChecker(self._kinematics, self._data, geometry, gripper, n_world)


def _part(solid: Any) -> str:
    return str(solid.name)


def _solid(thing: SceneObject) -> Any:
    """A coal shape in the object's frame: a cylinder or sphere around its box if it is one, else the box."""
    coal = library("coal")
    x, y, z = np.maximum(thing.extents, 1e-4)
    if thing.shape in ("cylinder", "disc"):
        return coal.Cylinder(0.5 * max(x, y), z)
    if thing.shape == "sphere":
        return coal.Sphere(0.5 * max(x, y, z))
    return coal.Box(x, y, z)


def _object_key(thing: SceneObject) -> tuple[object, ...]:
    return (thing.id, thing.shape, thing.world_from_object.tobytes(), thing.extents.tobytes())


def _scene_key(scene: Scene) -> tuple[object, ...]:
    return (scene.table_height, *(_object_key(o) for o in scene.obstacles()))


def _attachment_key(attached: Attachment | None) -> tuple[object, ...] | None:
    return None if attached is None else (*_object_key(attached.object), attached.tcp_from_object.tobytes())


def _bisecting(count: int) -> NDArray[np.intp]:
    """0..count-1 in bit-reversed order, which bisects the range again and again."""
    if count <= 2:
        return np.arange(count)
    bits = int(np.ceil(np.log2(count)))
    codes = np.arange(1 << bits)
    reverse = np.zeros_like(codes)
    for bit in range(bits):
        reverse |= ((codes >> bit) & 1) << (bits - 1 - bit)
    return np.asarray(reverse[reverse < count], dtype=np.intp)
