"""Collision model: the arm's links as convex hulls, the perceived scene as simple solids and known objects' pieces."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections import Counter, OrderedDict, defaultdict
from collections.abc import Sequence, Set
from contextlib import suppress
from functools import cached_property, lru_cache
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np

from gvla2.errors import GeometryError, RobotError, reading
from gvla2.geometry.transform import FloatArray, box_corners
from gvla2.planning.arm import Attachment, Clearance
from gvla2.planning.scene import Scene, SceneObject
from gvla2.robot.kinematics import Kinematics, library

TABLE = "table"
"""The name of the supporting plane in ``allowed_contacts`` and in :class:`Clearance`."""

LARGE = 0.2
"""Known objects longer than this, metres, are checked as their convex pieces: of smaller ones the box leaves enough
room beside it, and costs less.
"""

KEPT = 12
"""Number of the latest checkers that are kept."""


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
        """The checked pairs; the first ``n_world`` have an object of the scene or the table as the second."""
        names = [_link(o) for o in self._geometry.geometryObjects]
        return tuple((names[p.first], names[p.second]) for p in self._geometry.collisionPairs)

    def set_margins(self, margins: float | FloatArray) -> None:
        """Distances (metres) to keep for each world pair: one for all, or (n_world,).

        Negative margins tolerate that much penetration; the arm's own links must just not touch.
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
        return next((i for i in _bisecting(len(path)) if not self.free(path[i])), None)

    def distances(self, joints: FloatArray) -> FloatArray:
        """(pairs,) signed distances in metres, negative where the two overlap."""
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
    ``solids`` are those of :func:`link_geometry`. ``hand_links`` may touch a waypoint's allowed contacts, other links
    never.
    """

    def __init__(
        self,
        kinematics: Kinematics,
        solids: Any,
        *,
        hand_links: Sequence[str],
        srdf: Path | None = None,
    ) -> None:
        self._kinematics = kinematics
        self._robot = link_geometry(kinematics, solids)
        self._hand = frozenset(hand_links)
        links = [(_link(o), o.parentJoint) for o in self._robot.geometryObjects]
        close = usually_close(kinematics, self._robot, self._hand)
        listed = set() if srdf is None else disabled(srdf)
        named = {link for pair in listed for link in pair}
        harmless = listed | {pair for pair in close if not pair <= named}
        self.overlapping = close if srdf is None else close | disabled(srdf, "Default")
        self._self_pairs = [
            (i, j)
            for (i, (one, a)), (j, (other, b)) in combinations(enumerate(links), 2)
            if a != b and frozenset((one, other)) not in harmless
        ]
        self._data = kinematics.model.createData()  # of one configuration, for any checker
        self._checkers: OrderedDict[object, CollisionChecker] = OrderedDict()

    def checker(
        self,
        scene: Scene,
        gripper: float,
        allowed_contacts: frozenset[str] = frozenset(),
        attached: Attachment | None = None,
    ) -> CollisionChecker:
        """A checker with zero margins; see :meth:`gvla2.planning.arm.Arm.clearance` for the arguments."""
        solids = tuple(_object_key(obj) for obj in scene.obstacles())
        held = attached and (*_object_key(attached.object), attached.tcp_from_object.tobytes())
        key = (scene.table_height, solids, round(gripper, 4), allowed_contacts, held)
        checker = self._checkers.get(key)
        if checker is None:
            checker = self._build(scene, gripper, allowed_contacts, attached)
            self._checkers[key] = checker
            if len(self._checkers) > KEPT:
                self._checkers.popitem(last=False)
        self._checkers.move_to_end(key)
        checker.set_margins(0.0)
        return checker

    def _build(
        self, scene: Scene, gripper: float, allowed: frozenset[str], attached: Attachment | None
    ) -> CollisionChecker:
        pin = library("pinocchio")
        geometry = self._robot.copy()
        links = [(i, _link(o)) for i, o in enumerate(geometry.geometryObjects)]
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
        for obj in scene.obstacles(ignored):
            world += [(obj.id, solid, placement) for solid, placement in _solids(obj)]
        n_world = 0
        for name, solid, placement in world:
            index = geometry.addGeometryObject(pin.GeometryObject(name, 0, 0, pin.SE3(placement), solid))
            for i, link in links:
                if i in still or (link in hand and name in allowed):
                    continue
                geometry.addCollisionPair(pin.CollisionPair(i, index))
                n_world += 1
        for first, second in self_pairs:
            geometry.addCollisionPair(pin.CollisionPair(first, second))
        return CollisionChecker(self._kinematics, self._data, geometry, gripper, n_world)


def _link(solid: Any) -> str:
    return str(solid.name)


def _solids(item: SceneObject) -> list[tuple[Any, FloatArray]]:
    """Coal shapes, each with its pose (4, 4) in the world: the convex pieces of a large known object, which an arm may
    reach past, else one simple shape. Of containers, whose decomposition takes minutes, the box is kept.
    """
    if item.known is not None and item.opening == 0.0 and float(item.extents.max()) > LARGE:
        # The scan's file is gone, or there is no CoACD: its box is known.
        with suppress(GeometryError, ModuleNotFoundError):
            pieces = _pieces(item.known.path, item.known.scale)
            return [(piece, item.known.world_from_scan) for piece in pieces]
    return [(_solid(item), item.world_from_object)]


@lru_cache(maxsize=64)
def _pieces(path: str, scale: float) -> tuple[Any, ...]:
    """The convex pieces of a scan's file as coal shapes in its frame, metres."""
    # Few scenes have such an object, and importing trimesh is slow.
    from gvla2.geometry.convex import convex_pieces

    return tuple(convex_hull(corners) for corners in convex_pieces(path, scale))


def convex_hull(corners: FloatArray) -> Any:
    """The convex hull of points (N, 3) as a coal shape."""
    coal = library("coal")
    vertices = coal.StdVec_Vec3s()
    vertices.extend(np.ascontiguousarray(corners))
    return coal.Convex.convexHull(vertices, True, "Qt")


def _solid(item: SceneObject) -> Any:
    """A coal shape in the object's frame: a cylinder or sphere around its box if it is one, else the box."""
    x, y, z = np.maximum(item.extents, 1e-4)
    kind, across = item.shape, max(x, y)
    if kind in ("cylinder", "disc"):
        return coal_shape("cylinder", (across, across, z))
    return coal_shape("sphere", (max(across, z),) * 3) if kind == "sphere" else coal_shape("box", (x, y, z))


def coal_shape(kind: str, size: Sequence[float]) -> Any:
    """A coal shape of full sides ``size``, metres: a cylinder about z, a sphere, else a box."""
    coal = library("coal")
    x, y, z = map(float, size)
    if kind == "cylinder":
        return coal.Cylinder(0.5 * x, z)
    return coal.Sphere(0.5 * x) if kind == "sphere" else coal.Box(x, y, z)


def _object_key(item: SceneObject) -> tuple[object, ...]:
    scan = item.known and (item.known.path, item.known.world_from_scan.tobytes())
    return (item.id, item.shape, item.world_from_object.tobytes(), item.extents.tobytes(), scan)


def _bisecting(count: int) -> list[int]:
    """0..count-1 in bit-reversed order, which bisects the range again and again."""
    bits = count.bit_length()
    return sorted(range(count), key=lambda index: f"{index:0{bits}b}"[::-1])


def link_geometry(kinematics: Kinematics, solids: Any) -> Any:
    """The collision shapes of links, a pinocchio ``GeometryModel``, fewer and in the world: they are named by their
    link, and names may repeat.

    Round primitives (spheres, cylinders, capsules) are kept: exact, and faster than a hull; a link's meshes and boxes
    become their convex hull.
    """
    pin, coal = library("pinocchio"), library("coal")
    merged = pin.GeometryModel()

    def add(frame: int, placement: Any, shape: Any) -> None:
        link = kinematics.model.frames[frame]
        merged.addGeometryObject(pin.GeometryObject(link.name, link.parentJoint, frame, placement, shape))

    corners: dict[int, list[FloatArray]] = defaultdict(list)
    for solid in solids.geometryObjects:
        shape, pose = solid.geometry, solid.placement
        if solid.parentJoint == 0:
            pose = pin.SE3(kinematics.world_from_base) * pose
        if isinstance(shape, coal.BVHModelBase):
            points = np.array(shape.vertices(), dtype=np.float64).reshape(-1, 3)
        elif isinstance(shape, coal.ConvexBase):
            points = np.array(shape.points(), dtype=np.float64).reshape(-1, 3)
        elif isinstance(shape, coal.Box):
            points = box_corners(2.0 * shape.halfSide)
        else:
            add(solid.parentFrame, pose, shape)
            continue
        corners[solid.parentFrame].append(points @ pose.rotation.T + pose.translation)
    for frame, pieces in corners.items():
        add(frame, pin.SE3.Identity(), convex_hull(np.concatenate(pieces)))
    return merged


Pair = frozenset[str]
"""Two links by name."""

POSTURES, USUAL = 300, 0.5
"""Number of sampled postures; links whose hulls overlap in more than this share of them are neighbours with oversized
hulls, not colliding."""


def disabled(srdf: Path, reason: str = "") -> set[Pair]:
    """The pairs whose checks an SRDF disables, for a ``reason`` ("Default": overlap at the default posture)."""
    with reading("an SRDF", srdf, RobotError):
        return {
            frozenset((pair.get("link1", ""), pair.get("link2", "")))
            for pair in ET.parse(srdf).getroot().iter("disable_collisions")
            if reason in ("", pair.get("reason"))
        }


def usually_close(kinematics: Kinematics, robot: Any, hand: Set[str]) -> set[Pair]:
    """Pairs of links whose overlap is harmless: joined by a joint, both of the ``hand`` (its fingers may meet), or
    overlapping in more than ``USUAL`` of the postures drawn within the joints' limits, always the same ones.

    ``robot`` is the pinocchio ``GeometryModel`` of the links' solids.
    """
    pin, model, solids = library("pinocchio"), kinematics.model, robot.geometryObjects
    robot = robot.copy()
    robot.removeAllCollisionPairs()
    found: set[Pair] = set()
    for i, j in combinations(range(len(solids)), 2):
        one, other = solids[i], solids[j]
        pair = frozenset((str(one.name), str(other.name)))
        a, b = one.parentJoint, other.parentJoint
        if a == b or model.parents[a] == b or model.parents[b] == a or pair <= hand:
            found.add(pair)
        else:
            robot.addCollisionPair(pin.CollisionPair(i, j))
    pairs = [frozenset((str(solids[p.first].name), str(solids[p.second].name))) for p in robot.collisionPairs]
    data, geometry_data = model.createData(), robot.createData()
    touched: Counter[Pair] = Counter()
    rng = np.random.default_rng(20240229)
    for joints in rng.uniform(kinematics.low, kinematics.high, (POSTURES, kinematics.dof)):
        pin.computeCollisions(model, data, robot, geometry_data, kinematics.full(joints, 1.0), False)
        results = geometry_data.collisionResults
        touched.update({p for p, result in zip(pairs, results, strict=True) if result.isCollision()})
    return found | {pair for pair, count in touched.items() if count > USUAL * POSTURES}
