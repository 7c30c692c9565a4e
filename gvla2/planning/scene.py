"""The scene X_t = {(s_i, P_i)}: labelled objects with several 3D points each."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from difflib import SequenceMatcher
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gvla2.geometry.mesh import TriangleMesh
from gvla2.geometry.transform import FloatArray, box_corners, invert_rigid, transform_points
from gvla2.geometry.views import Viewpoint

Shape = Literal["box", "cylinder", "sphere", "disc", "plate", "ring", "bar", "region", "other"]
"""Coarse geometry: a ``region`` is a patch painted on the table, a ``disc`` a flat cylinder, a ``plate`` a flat box,
a ``ring`` a flat object with a hole through it, a ``bar`` something long and thin."""
ROUND: tuple[Shape, ...] = ("cylinder", "disc", "sphere")
"""Shapes that look the same from all sides when they stand upright."""
SIDES = {
    "left_of": np.array([0.0, 1.0, 0.0]),
    "right_of": np.array([0.0, -1.0, 0.0]),
    "behind": np.array([1.0, 0.0, 0.0]),
    "front_of": np.array([-1.0, 0.0, 0.0]),
}
"""Unit vectors to an object's sides, as the robot sees them."""
PRINTED = "text"
"""The source of names that are the words read on an object, in no order: some of them may be missing or misread."""
READ_ALIKE = 0.8
"""Least likeness of a word and one that was read: "ketchlp" for ketchup (.86), not "soap" for soup (.75)."""
TOUCHING = 0.008
"""A point this near to an object's box counts as on it, metres: the error of depth cameras and perceived boxes."""


def likeness_of_words(one: str, other: str) -> float:
    """How far two words agree, letters lost or misread, in [0, 1]."""
    return SequenceMatcher(None, one, other, autojunk=False).ratio()


@dataclass(frozen=True)
class Box:
    """An axis-aligned box in the world frame: ``low`` (3,) and ``high`` (3,), metres."""

    low: FloatArray
    high: FloatArray

    def contains(self, points: FloatArray, margin: float = 0.0) -> NDArray[np.bool_]:
        """(...,) bool for points (..., 3); ``margin`` in metres shrinks the box."""
        inside = (points >= self.low + margin) & (points <= self.high - margin)
        return np.asarray(inside.all(axis=-1))


@dataclass(frozen=True)
class KnownShape:
    """The scan that an object was recognised as, and its pose.

    ``path`` is the scan's file (.obj, .glb, .ply); ``scale`` takes its units to metres, and ``world_from_scan``
    (4, 4), rigid, takes the scaled vertices to the world. ``residual`` is the median distance of the seen points
    from the placed surface, metres. ``up`` (3,), in the scan's frame, is vertical in the resting pose in which it
    should stand, the upright or the nearest one; None where its resting poses are unknown.
    """

    name: str
    path: str
    world_from_scan: FloatArray = field(repr=False)
    scale: float = 1.0
    residual: float = 0.0
    up: FloatArray | None = field(default=None, repr=False)

    def mesh(self) -> TriangleMesh:
        """The whole scan in the world frame, including unseen parts; raises :class:`GeometryError`."""
        from gvla2.geometry.mesh_files import read_mesh  # scenes can also be read without trimesh

        scan = read_mesh(self.path)
        return scan.with_vertices(transform_points(self.world_from_scan, self.scale * scan.vertices))


@dataclass(frozen=True)
class PartJoint:
    """How a part moves on its whole, world frame: it ``slides`` along, or turns about, the unit vector ``axis`` (3,).

    ``origin`` (3,) is a point on the axis of a turn, metres. ``position`` is how far it has moved from where it is
    closed (a drawer, a door) or off (a knob), and ``reach`` how far it can, both positive along or about ``axis``,
    metres or radians.
    """

    slides: bool
    axis: FloatArray
    origin: FloatArray
    position: float
    reach: float


@dataclass(frozen=True)
class SceneObject:
    """One labelled object, as seen.

    ``world_from_object`` (4, 4) is the frame of its oriented box, origin at the box's centre, z up for objects that
    stand on the table; ``extents`` (3,) full side lengths along that frame's axes, metres. ``points`` (N, 3) seen
    surface points in the world, metres; ``rgb`` (3,) mean colour in [0, 1]. ``label`` is its everyday name ("red
    cube"), ``colour`` a colour word or "" if unsure. ``parent`` is the id of the object that this is a part of (a
    button of a lamp), or "". ``confidence`` in [0, 1]. ``opening`` is the narrowest inner width of a hollow object at
    its top (a cup, an open box) or of a ring's hole, metres; 0 if it is closed. ``named_by`` is the source of
    ``label``: "" for colour and shape, else the source's name; ``sureness`` in [0, 1] is the source's confidence in the
    name. ``known`` is the scan that it was recognised as, with its pose. ``joint`` is how it moves on its ``parent``,
    where that is known.
    """

    id: str
    label: str
    shape: Shape
    colour: str
    world_from_object: FloatArray
    extents: FloatArray
    points: FloatArray = field(repr=False)
    rgb: FloatArray = field(default_factory=lambda: np.zeros(3))
    parent: str = ""
    confidence: float = 1.0
    opening: float = 0.0
    named_by: str = ""
    sureness: float = 1.0
    known: KnownShape | None = None
    joint: PartJoint | None = None

    def moved(self, by: FloatArray) -> SceneObject:
        """The object with its points and its scan after a rigid motion (4, 4) in the world."""
        known = self.known and replace(self.known, world_from_scan=by @ self.known.world_from_scan)
        pose, points = by @ self.world_from_object, transform_points(by, self.points)
        return replace(self, world_from_object=pose, points=points, known=known)

    @property
    def centre(self) -> FloatArray:
        """(3,) centre of the oriented box, metres; the caller's own copy."""
        return self.world_from_object[:3, 3].copy()

    @cached_property
    def top(self) -> float:
        """Height of the highest corner of the oriented box, world z in metres."""
        return float(self.corners()[:, 2].max())

    @cached_property
    def bottom(self) -> float:
        """Height of the lowest corner of the oriented box, world z in metres."""
        return float(self.corners()[:, 2].min())

    @property
    def righting(self) -> FloatArray:
        """(3,) rotation vector, world, radians, that turns a known object to how it should stand on a level surface;
        0 if it stands so or if its resting poses are unknown.
        """
        if self.known is None or self.known.up is None:
            return np.zeros(3)
        up = self.known.world_from_scan[:3, :3] @ self.known.up
        axis = np.cross(up, [0.0, 0.0, 1.0])
        sine = float(np.linalg.norm(axis))
        return np.asarray(axis / max(sine, 1e-9) * np.arctan2(sine, up[2]))

    def corners(self) -> FloatArray:
        """(8, 3) corners of the oriented box in the world, metres."""
        return transform_points(self.world_from_object, box_corners(self.extents))

    def outline(self) -> FloatArray:
        """(N, 3) points around the box, or the cylinder in it if it is round, 5 mm apart in height, world metres."""
        angles = 2 * np.pi * np.arange(24) / 24
        ring = np.stack([np.cos(angles), np.sin(angles)], axis=1)
        if self.shape not in ROUND:
            ring = ring / np.abs(ring).max(axis=1, keepdims=True)
        heights = np.linspace(-1.0, 1.0, 2 + int(self.extents[2] / 0.005))
        local = np.column_stack([np.tile(ring, (len(heights), 1)), np.repeat(heights, len(ring))])
        return transform_points(self.world_from_object, 0.5 * self.extents * local)

    def distances(self, points: ArrayLike) -> FloatArray:
        """(...,) how far world points (..., 3) lie outside the oriented box, metres; 0 inside."""
        local = np.abs(transform_points(invert_rigid(self.world_from_object), points))
        return np.asarray(np.linalg.norm(np.maximum(local - 0.5 * self.extents, 0.0), axis=-1))

    def half_along(self, way: FloatArray) -> float:
        """Distance from its centre that the oriented box, or an upright round object, reaches along a unit vector (3,),
        metres.
        """
        reach = np.abs(way @ self.world_from_object[:3, :3]) * (0.5 * self.extents)
        if self.shape in ROUND and abs(self.world_from_object[2, 2]) > 0.5:
            return float(np.hypot(reach[0], reach[1]) + reach[2])
        return float(reach.sum())

    def covers(self, point: FloatArray) -> bool:
        """Whether a point (3,), by its x and y, is within the oriented box's footprint."""
        level = np.array([*point[:2], self.centre[2]])
        local = transform_points(invert_rigid(self.world_from_object), level)
        return bool((np.abs(local[:2]) <= 0.5 * self.extents[:2]).all())

    def upright_faces(self) -> list[FloatArray]:
        """Level unit normals (3,) of the oriented box's upright faces."""
        axes = self.world_from_object[:3, :3]
        flat = [axes[:, i] * [1.0, 1.0, 0.0] for i in range(3) if abs(axes[2, i]) < 0.5]
        return [sign * a / np.linalg.norm(a) for a in flat for sign in (1.0, -1.0)]


@dataclass(frozen=True)
class Scene:
    """X_t: the scene perceived at one moment.

    ``table_height`` is world z in metres; ``table`` bounds the seen part of its top. ``workspace`` is where the hand
    may go. ``perceiver`` names its source ("oracle" results are marked by it). ``viewpoint`` is where the person stands
    whose words for sides count: with the robot, or facing it.
    """

    objects: tuple[SceneObject, ...]
    table_height: float
    workspace: Box
    perceiver: str = ""
    notes: tuple[str, ...] = ()
    viewpoint: Viewpoint = "robot"

    def side(self, relation: str) -> FloatArray:
        """(3,) level unit vector from an object to its side of a relation ("left_of"), as the viewpoint has it."""
        return SIDES[relation] if self.viewpoint == "robot" else -SIDES[relation]

    def __getitem__(self, object_id: str) -> SceneObject:
        for candidate in self.objects:
            if candidate.id == object_id:
                return candidate
        raise KeyError(f"No object '{object_id}' in the scene; it has {[o.id for o in self.objects]}.")

    def object_at(self, point: FloatArray, within: float = TOUCHING) -> str:
        """The id of the object that a point (3,) is on or in, "" for none; of a whole and its part, the part."""
        near = [o for o in self.objects if o.distances(point) <= within]
        if not near:
            return ""
        # Boxes of hollow objects and their contents overlap: take the one whose surface was seen nearest.
        gaps = [
            float(np.linalg.norm(o.points - point, axis=1).min() if len(o.points) else o.distances(point))
            for o in near
        ]
        same = [o for o, gap in zip(near, gaps, strict=True) if gap <= min(gaps) + 0.5 * TOUCHING]
        return min(same, key=lambda o: (not o.parent, float(np.prod(o.extents)))).id

    def with_object(self, changed: SceneObject) -> Scene:
        """The scene with the object of the same id replaced (refined geometry)."""
        return replace(self, objects=tuple(changed if o.id == changed.id else o for o in self.objects))

    def parts_of(self, object_id: str) -> tuple[SceneObject, ...]:
        """The parts of an object and the parts of those, in the scene's order."""
        within = {object_id}
        for _ in self.objects:
            grown = within | {o.id for o in self.objects if o.parent in within}
            if grown == within:
                break
            within = grown
        return tuple(o for o in self.objects if o.id in within and o.id != object_id)

    def family(self, object_id: str) -> frozenset[str]:
        """The ids of an object and of its parts."""
        return frozenset({object_id, *(part.id for part in self.parts_of(object_id))})

    def whole_of(self, part: SceneObject) -> SceneObject | None:
        """The object that ``part`` is a part of; None for a whole, and if the scene lacks it."""
        return next((o for o in self.objects if o.id == part.parent), None)

    def obstacles(self, ignore: frozenset[str] = frozenset()) -> tuple[SceneObject, ...]:
        """Objects to avoid: all but painted regions, the ids in ``ignore`` and the parts of those."""
        ignored = ignore | {part.id for one in ignore if one for part in self.parts_of(one)}
        return tuple(o for o in self.objects if o.shape != "region" and o.id not in ignored)
