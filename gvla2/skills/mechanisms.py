"""Mechanisms: hinged lids and sliding drawers, told from what is seen of a thing and its parts.

What a thing is for shows in its geometry: a flat part over a hollow one turns about one of its edges, and what has a
handle before an upright face slides along that face's normal. Where a closed lid looks the same from all sides, it is
taken to open towards the robot, as things are put before somebody who is to open them.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from gvla2.geometry.transform import FloatArray
from gvla2.planning.scene import ROUND, Scene, SceneObject
from gvla2.skills.parts import is_handle, is_lid

UP = np.array([0.0, 0.0, 1.0])
LIP = 0.006
"""A lid that stands out over one side by this much more than over the others is opened there, metres."""
OVERHANG = 0.15
"""A lid stands out by less than this share of its length: where it seems to by more, the wall was not seen."""
FEWEST, STRAYS = 50, 6
"""Points that outline a thing, and how many of them may lie astray."""
SLIM = 0.02
"""A handle is no thicker than fingers close around with ease, metres."""
BEFORE = 0.10
"""A handle stands at most this far before the face that it belongs to, metres."""
CLOSED = 0.15
"""A lid is closed when it is tilted by less, radians."""


@dataclass(frozen=True)
class Hinge:
    """A lid that turns about a level edge.

    ``origin`` (3,) middle of the hinge; ``level`` (3,) unit, from the hinge over the box, where the free edge is when
    closed; ``angle`` by which it is open, radians; ``reach`` from hinge to free edge, ``breadth`` along the hinge and
    ``thickness``, metres. ``guessed``: nothing tells which edge the hinge is at.
    """

    body: SceneObject | None
    lid: SceneObject
    origin: FloatArray
    level: FloatArray
    angle: float
    reach: float
    breadth: float
    thickness: float
    guessed: bool = False

    @cached_property
    def axis(self) -> FloatArray:
        """(3,) unit; a right-hand turn about it opens the lid."""
        return np.cross(self.level, UP)

    def out(self, angle: float) -> FloatArray:
        """(3,) unit, along the lid from the hinge when it is open by ``angle``."""
        return np.asarray(np.cos(angle) * self.level + np.sin(angle) * UP)

    def normal(self, angle: float) -> FloatArray:
        """(3,) unit, the way the free edge goes while the lid opens."""
        return np.asarray(np.cos(angle) * UP - np.sin(angle) * self.level)

    def edge(self, angle: float, inside: float = 0.0) -> FloatArray:
        """(3,) middle of the free edge, or a point ``inside`` metres nearer to the hinge."""
        return self.origin + (self.reach - inside) * self.out(angle)

    @property
    def parts(self) -> frozenset[str]:
        """Ids of what may be touched at work on it."""
        return frozenset({self.lid.id, *([self.body.id] if self.body is not None else [])})


@dataclass(frozen=True)
class Slide:
    """Something that is drawn out along ``out`` (3,), level unit, by ``handle``; ``body`` is what it slides in."""

    body: SceneObject | None
    front: SceneObject
    handle: SceneObject
    out: FloatArray

    @property
    def parts(self) -> frozenset[str]:
        """Ids of what may be touched at work on it."""
        things = (self.body, self.front, self.handle)
        return frozenset(t.id for t in things if t is not None)


def hinges(scene: Scene) -> list[Hinge]:
    """Every lid that seems hinged, with the box under it."""
    found = []
    for lid in scene.objects:
        body = scene.whole_of(lid)
        turns = body is not None and body.shape in ROUND  # what is on a round thing does not swing
        if lid.shape in ("plate", "box") and is_lid(lid, scene) and not turns:
            found.append(hinge_of(lid, body, scene))
    return found


def slides(scene: Scene) -> list[Slide]:
    """Every handle with the front that it pulls."""
    found = []
    for handle in scene.objects:
        if handle.extents.min() > SLIM or not is_handle(handle):
            continue
        front = scene.whole_of(handle) or _behind(handle, scene)
        if front is None or is_lid(front, scene):
            continue
        body = scene.whole_of(front)
        out = _outward(handle, body or front)
        if out is not None:
            found.append(Slide(body, front, handle, out))
    return found


def hinge_of(lid: SceneObject, body: SceneObject | None, scene: Scene) -> Hinge:
    """Where a lid's hinge is, from how it lies on its box or stands open on it."""
    axes, extents = lid.world_from_object[:3, :3], lid.extents
    thin = int(np.argmin(extents))
    sides = [i for i in range(3) if i != thin]
    tilt = float(np.arccos(min(1.0, abs(axes[2, thin]))))
    if tilt < CLOSED:
        level, reach, guessed = _lip(lid, body, sides, scene)
        origin = lid.centre - 0.5 * reach * level
        breadth = 2 * lid.half_along(np.cross(level, UP))
        return Hinge(body, lid, origin, level, 0.0, reach, breadth, float(extents[thin]), guessed)
    rising = max(sides, key=lambda i: abs(axes[2, i]))
    out = axes[:, rising] * (1.0 if axes[2, rising] > 0 else -1.0)
    reach = float(extents[rising])
    origin = lid.centre - 0.5 * reach * out
    other = next(i for i in sides if i != rising)
    across = axes[:, other] * [1.0, 1.0, 0.0]
    level = np.cross(UP, across / max(float(np.linalg.norm(across)), 1e-9))
    inward = body.centre - origin if body is not None else -out
    if inward @ level < 0:
        level = -level
    angle = float(np.arctan2(out[2], out @ level))
    return Hinge(body, lid, origin, level, angle, reach, float(extents[other]), float(extents[thin]))


def _lip(
    lid: SceneObject, body: SceneObject | None, sides: list[int], scene: Scene
) -> tuple[FloatArray, float, bool]:
    """Direction (3,) from the hinge to the free edge of a closed lid, its length, and whether that is a guess."""
    axes = lid.world_from_object[:3, :3]
    ways = [(sign * _flat(axes[:, i]), float(lid.extents[i])) for i in sides for sign in (1.0, -1.0)]
    if body is not None:
        stands_out = [_reach(lid, way) - _reach(body, way) for way, _ in ways]
        told = [k for k, (_, length) in enumerate(ways) if stands_out[k] < OVERHANG * length]
        order = sorted(told, key=lambda k: -stands_out[k])
        if len(order) > 1 and stands_out[order[0]] - stands_out[order[1]] > LIP:
            return (*ways[order[0]], False)
        # A wall that no camera sees may be in the shadow of the lip; one that is flush with the lid is not.
        ways = [way for k, way in enumerate(ways) if k not in told] or ways
    near = np.array([scene.workspace.low[0], 0.5 * (scene.workspace.low[1] + scene.workspace.high[1])])
    to_robot = np.array([*(near - lid.centre[:2]), 0.0])
    way, length = max(ways, key=lambda w: float(w[0] @ to_robot))
    return way, length, len(ways) > 1


def _outward(handle: SceneObject, ref: SceneObject) -> FloatArray | None:
    """(3,) the normal of the upright face of ``ref`` that the handle stands before; None when before none."""
    shift = handle.centre - ref.centre
    faces = ref.upright_faces()
    return max(faces, key=lambda way: float(shift @ way) - ref.half_along(way), default=None)


def _behind(handle: SceneObject, scene: Scene) -> SceneObject | None:
    """The thing with an upright face right behind a handle that is not known to be a part."""
    best, nearest = None, BEFORE
    for thing in scene.obstacles(frozenset({handle.id})):
        way = _outward(handle, thing)
        if way is None or thing.extents.max() < handle.extents.max():
            continue
        shift = handle.centre - thing.centre
        gap = float(shift @ way) - thing.half_along(way) - handle.half_along(way)
        aside = np.cross(UP, way)
        beside = abs(shift @ aside) >= thing.half_along(aside)
        if not beside and thing.bottom < handle.centre[2] < thing.top + 0.01 and gap < nearest:
            best, nearest = thing, gap
    return best


def hinge_for(thing: SceneObject, scene: Scene) -> Hinge | None:
    """The hinge that a lid, or the thing under it, is a part of."""
    return next((h for h in hinges(scene) if thing.id in h.parts), None)


def slide_for(thing: SceneObject, scene: Scene) -> Slide | None:
    """The slide that a handle, a front or what it slides in is a part of."""
    return next((s for s in slides(scene) if thing.id in s.parts), None)


def _reach(thing: SceneObject, way: FloatArray) -> float:
    """How far a thing goes along a unit vector, metres from the world's origin: by its points, where it has some."""
    if len(thing.points) < FEWEST:
        return float(thing.centre @ way) + thing.half_along(way)
    return float(np.sort(thing.points @ way)[-STRAYS])


def _flat(vector: FloatArray) -> FloatArray:
    level = vector * [1.0, 1.0, 0.0]
    return np.asarray(level / max(float(np.linalg.norm(level)), 1e-9))
