"""Mechanisms: hinged lids and doors, sliding drawers, objects held between others, lamps.

A part with a known joint slides along or turns about its axis. Otherwise geometry decides: a flat part over a hollow
one turns about one of its edges, a part with a handle in front of an upright face slides along that face's normal, and
a thin panel turns about the upright edge that is farther from its handle. If nothing shows where a closed lid's hinge
is, it is assumed to open towards the robot, as boxes are placed for someone who is to open them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from gvla2.geometry.transform import FloatArray, invert_rigid, rigid, transform_points
from gvla2.planning.part_hierarchy import holders, inside, is_ajar, is_handle, is_lid
from gvla2.planning.scene import ROUND, PartJoint, Scene, SceneObject

UP = np.array([0.0, 0.0, 1.0])
LIP = 0.006
"""A lid opens at the side where it projects by this much more than at the others, metres."""
OVERHANG = 0.15
"""A lid projects by less than this share of its length; if it seems to by more, the wall was not seen."""
FEWEST, STRAYS = 50, 6
"""The fewest points that define an outline, and the number of outliers that are ignored."""
SLIM = 0.02
"""Greatest thickness of a handle, metres."""
BESIDE = 0.004
"""Points of a drawer farther than this from its handle, across the way out, are its front's, metres."""
PANEL = 0.08
"""A door is thinner, and no side of it is shorter, metres."""
FOOT, FEWEST_FOOT, END = 0.45, 8, 0.35
"""Share of a handle's distance from the panel within which it is fixed, the fewest points that show it, and the share
of a lever's length in which it is."""
CLOSED = 0.15
"""A lid tilted by less is closed, radians."""


@dataclass(frozen=True)
class Hinge:
    """A lid that turns about a level edge.

    ``origin`` (3,) is the middle of the hinge; ``level`` (3,) the unit vector from the hinge to the free edge when the
    lid is closed; ``angle`` is how far it is open, radians; ``reach`` from hinge to free edge, ``breadth`` along the
    hinge and ``thickness`` are in metres. ``guessed``: the hinge's edge could not be inferred.
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
        """(3,) unit; a right-handed rotation about it opens the lid."""
        return np.cross(self.level, UP)

    def out(self, angle: float) -> FloatArray:
        """(3,) unit, from the hinge along the lid when it is open by ``angle``."""
        return np.asarray(np.cos(angle) * self.level + np.sin(angle) * UP)

    def normal(self, angle: float) -> FloatArray:
        """(3,) unit, the direction of the free edge's motion while the lid opens."""
        return np.asarray(np.cos(angle) * UP - np.sin(angle) * self.level)

    def edge(self, angle: float, inside: float = 0.0) -> FloatArray:
        """(3,) middle of the free edge, or the point ``inside`` metres closer to the hinge."""
        return self.origin + (self.reach - inside) * self.out(angle)

    @property
    def parts(self) -> frozenset[str]:
        """Ids of what may be touched at work on it."""
        return frozenset({self.lid.id, *([self.body.id] if self.body is not None else [])})


@dataclass(frozen=True)
class Slide:
    """Something that is drawn out along ``out`` (3,), unit, by ``handle``; ``body`` is what it slides in. A known
    ``joint`` says how far.
    """

    body: SceneObject | None
    front: SceneObject
    handle: SceneObject
    out: FloatArray
    joint: PartJoint | None = None

    @property
    def parts(self) -> frozenset[str]:
        """Ids of what may be touched at work on it."""
        objects = (self.body, self.front, self.handle)
        return frozenset(t.id for t in objects if t is not None)

    @cached_property
    def face(self) -> float:
        """Coordinate along ``out`` of the face behind the handle, metres."""
        if self.joint is not None and self.handle is not self.front:
            local = transform_points(invert_rigid(self.handle.world_from_object), self.front.points)
            across = np.abs(self.handle.world_from_object[:3, :3].T @ self.out) < 0.5
            beside = (np.abs(local) > 0.5 * self.handle.extents + BESIDE)[:, across].any(axis=1)
            if beside.any():
                return float((self.front.points[beside] @ self.out).max())
        objects = [o for o in (self.front, self.body) if o is not None]
        return max(float(o.centre @ self.out) + o.half_along(self.out) for o in objects)


@dataclass(frozen=True)
class Door:
    """A panel that turns about the unit vector ``axis`` (3,) through ``origin`` (3,), right-handed to open.

    ``arm`` (3,) is the unit vector from the axis to its free edge now, ``reach`` metres away. ``handle`` is None where
    none is seen; ``joint`` says how far it is open, where that is known. ``lever`` (3,) is the point on the panel about
    which its handle turns, None for one that is fixed.
    """

    panel: SceneObject
    origin: FloatArray
    axis: FloatArray
    arm: FloatArray
    reach: float
    handle: SceneObject | None = None
    joint: PartJoint | None = None
    lever: FloatArray | None = None

    @cached_property
    def out(self) -> FloatArray:
        """(3,) unit, out of its face: the direction in which the free edge moves when it opens."""
        return np.cross(self.axis, self.arm)


def doors(scene: Scene) -> list[Door]:
    """All parts that are known to turn and are no knobs, and all thin upright panels with a handle before them."""
    found = []
    for panel in scene.objects:
        handle = next((part for part in scene.parts_of(panel.id) if is_handle(part)), None)
        joint = panel.joint
        if joint is not None and not joint.slides and is_ajar(panel) is not None and len(panel.points):
            off = panel.points - joint.origin
            off = off - np.outer(off @ joint.axis, joint.axis)
            arm = off.mean(axis=0) / np.linalg.norm(off.mean(axis=0))
            along = float(joint.axis @ (panel.centre - joint.origin))
            origin = joint.origin + along * joint.axis
            found.append(Door(panel, origin, joint.axis, arm, float((off @ arm).max()), handle, joint))
        elif handle is not None and not panel.parent and (thin := _upright_panel(panel)) is not None:
            found.append(_door_by_handle(panel, handle, thin))
    return found


def _upright_panel(obj: SceneObject) -> FloatArray | None:
    """(3,) the level unit normal of something thin and upright; None for anything else."""
    thin = int(np.argmin(obj.extents))
    normal = obj.world_from_object[:3, thin]
    slim = obj.extents[thin] < PANEL and np.delete(obj.extents, thin).min() > PANEL
    return normal if slim and abs(normal[2]) < 0.3 else None


def _door_by_handle(panel: SceneObject, handle: SceneObject, normal: FloatArray) -> Door:
    """Its hinge is the upright edge that is farther from the handle, and it opens to the side that the handle is on."""
    shift = handle.centre - panel.centre
    out = _flat(normal) * (1.0 if shift @ normal > 0 else -1.0)
    arm = np.cross(UP, out)
    arm = arm if shift @ arm > 0 else -arm
    half = panel.half_along(arm)
    origin, axis = panel.centre - half * arm, np.cross(arm, out)
    return Door(panel, origin, axis, arm, 2 * half, handle, lever=_lever(panel, handle, out, arm))


def _lever(panel: SceneObject, handle: SceneObject, out: FloatArray, along: FloatArray) -> FloatArray | None:
    """(3,) where a level bar that is fixed at one end alone is fixed, on the panel's face; None for other handles."""
    if not len(handle.points):
        return None
    face = float(panel.centre @ out) + panel.half_along(out)
    off, at = handle.points @ out - face, handle.points @ along
    foot = (off > 0.0) & (off < FOOT * off.max())
    low, high = np.quantile(at, [0.02, 0.98])
    upright = high - low < 2 * np.ptp(np.quantile(handle.points[off >= FOOT * off.max(), 2], [0.02, 0.98]))
    if foot.sum() < FEWEST_FOOT or upright:
        return None
    first, last = (np.quantile(at[foot], [0.1, 0.9]) - low) / (high - low)
    if first < 1.0 - END and last > END:
        return None
    spot = np.median(handle.points[foot], axis=0)
    return np.asarray(spot + (face - float(spot @ out)) * out)


def door_for(obj: SceneObject, scene: Scene) -> Door | None:
    """The door that an object is, or that it is the handle or the whole of; None if there is none."""
    found = doors(scene)
    own = (d for d in found if obj.id in (d.panel.id, d.handle.id if d.handle is not None else ""))
    return next(own, None) or next((d for d in found if obj.id == d.panel.parent), None)


def hinges(scene: Scene) -> list[Hinge]:
    """All lids that seem hinged, with the boxes under them."""
    found = []
    for lid in scene.objects:
        body = scene.whole_of(lid)
        turns = body is not None and body.shape in ROUND  # a lid on a round object turns
        if lid.shape in ("plate", "box") and is_lid(lid, scene) and not turns:
            found.append(hinge_of(lid, body, scene))
    return found


def slides(scene: Scene) -> list[Slide]:
    """All parts that are known to slide, and all handles with the fronts that they pull."""
    found, kin = list[Slide](), set[str]()
    for front in scene.objects:
        if (joint := front.joint) is not None and joint.slides:
            handle = next((part for part in scene.parts_of(front.id) if is_handle(part)), front)
            found.append(Slide(scene.whole_of(front), front, handle, joint.axis, joint))
            kin |= scene.family(front.id)
    for handle in (obj for obj in scene.objects if obj.id not in kin):
        if handle.extents.min() > SLIM or not is_handle(handle):
            continue
        whole = scene.whole_of(handle)
        if whole is None or is_lid(whole, scene):
            continue
        body = scene.whole_of(whole)
        behind = body or whole  # the handle is before one of its upright faces
        shift = handle.centre - behind.centre
        faces = sorted(behind.upright_faces(), key=lambda way: behind.half_along(way) - float(shift @ way))
        found += [Slide(body, whole, handle, out) for out in faces[:1]]
    return found


def hinge_of(lid: SceneObject, body: SceneObject | None, scene: Scene) -> Hinge:
    """A lid's hinge, inferred from the lid's pose on its box."""
    thickness = float(lid.extents.min())
    if _tilt(lid) < CLOSED:
        level, reach, guessed = _lip(lid, body, scene)
        origin = lid.centre - 0.5 * reach * level
        breadth = 2 * lid.half_along(np.cross(level, UP))
        return Hinge(body, lid, origin, level, 0.0, reach, breadth, thickness, guessed)
    out, level, reach, breadth = _swung(lid, body)
    angle = float(np.arctan2(out[2], out @ level))
    return Hinge(body, lid, lid.centre - 0.5 * reach * out, level, angle, reach, breadth, thickness)


def _tilt(lid: SceneObject) -> float:
    """Angle between a flat object and the level, radians."""
    return float(np.arccos(min(1.0, abs(lid.world_from_object[2, int(np.argmin(lid.extents))]))))


def _swung(lid: SceneObject, body: SceneObject | None) -> tuple[FloatArray, FloatArray, float, float]:
    """For an open lid: its direction (3,) from the hinge, its level direction (3,) when closed, reach and breadth."""
    axes, extents = lid.world_from_object[:3, :3], lid.extents
    sides = sorted((i for i in range(3) if i != int(np.argmin(extents))), key=lambda i: abs(axes[2, i]))
    other, rising = sides
    out = axes[:, rising] * (1.0 if axes[2, rising] > 0 else -1.0)
    reach = float(extents[rising])
    level = np.cross(UP, _flat(axes[:, other]))
    inward = out if body is None else body.centre - (lid.centre - 0.5 * reach * out)
    return out, level if inward @ level >= 0 else -level, reach, float(extents[other])


def _lip(lid: SceneObject, body: SceneObject | None, scene: Scene) -> tuple[FloatArray, float, bool]:
    """Direction (3,) from the hinge to the free edge of a closed lid, the lid's length, and whether that is a guess."""
    axes = lid.world_from_object[:3, :3]
    sides = [i for i in range(3) if i != int(np.argmin(lid.extents))]
    ways = [(sign * _flat(axes[:, i]), float(lid.extents[i])) for i in sides for sign in (1.0, -1.0)]
    if body is not None:
        stands_out = [_reach(lid, way) - _reach(body, way) for way, _ in ways]
        seen = [k for k, (_, length) in enumerate(ways) if stands_out[k] < OVERHANG * length]
        order = sorted(seen, key=lambda k: -stands_out[k])
        if len(order) > 1 and stands_out[order[0]] - stands_out[order[1]] > LIP:
            return (*ways[order[0]], False)
        # An unseen wall may be hidden by the lip; a wall flush with the lid is not.
        ways = [way for k, way in enumerate(ways) if k not in seen] or ways
    near = np.array([scene.workspace.low[0], 0.5 * (scene.workspace.low[1] + scene.workspace.high[1])])
    to_robot = np.array([*(near - lid.centre[:2]), 0.0])
    way, length = max(ways, key=lambda w: float(w[0] @ to_robot))
    return way, length, len(ways) > 1


def hinge_for(obj: SceneObject, scene: Scene) -> Hinge | None:
    """The hinge of a lid, or of the object under it; None if there is none."""
    return next((h for h in hinges(scene) if obj.id in h.parts), None)


def slide_for(obj: SceneObject, scene: Scene) -> Slide | None:
    """The slide of a handle, a front or the body around it; None if there is none."""
    found = slides(scene)
    own = (s for s in found if obj.id in (s.front.id, s.handle.id))
    return next(own, None) or next((s for s in found if obj.id in s.parts), None)


def _reach(obj: SceneObject, way: FloatArray) -> float:
    """An object's greatest coordinate along a unit vector, metres; from its points if there are enough."""
    if len(obj.points) < FEWEST:
        return float(obj.centre @ way) + obj.half_along(way)
    return float(np.sort(obj.points @ way)[-STRAYS])


def _flat(vector: FloatArray) -> FloatArray:
    level = vector * [1.0, 1.0, 0.0]
    return np.asarray(level / max(float(np.linalg.norm(level)), 1e-9))


TOUCHING = 0.012
"""Two objects with a smaller gap may touch, metres: perceived faces are off by a few millimetres."""
SAMPLES = 41


@dataclass(frozen=True)
class Stuck:
    """``theme`` is the object with its likely hidden part; ``way`` (3,) the level unit vector out of its ``holders``
    (ids); ``exposed`` the length that sticks out and ``hidden`` the greatest length that is held, metres.
    """

    theme: SceneObject
    way: FloatArray
    exposed: float
    hidden: float
    holders: frozenset[str]

    @property
    def end(self) -> FloatArray:
        """(3,) middle of the free end."""
        return self.theme.centre + self.way * self.theme.half_along(self.way)


def stuck(theme: SceneObject, scene: Scene) -> Stuck | None:
    """How an object is held sideways; None if it is not."""
    if theme.shape == "region" or theme.bottom < scene.table_height + 0.01:
        return None
    if any(o.opening > 0.0 and o.joint is not None and inside(theme, o) for o in holders(theme, scene)):
        return None  # it lies in an open drawer
    others = [o for o in scene.obstacles(frozenset({theme.id})) if o.parent != theme.id]
    return _covered(theme, others) or _flush(theme, others)


def _covered(theme: SceneObject, others: list[SceneObject]) -> Stuck | None:
    """Held between something right above and right below a part of it."""
    above = [o for o in others if -TOUCHING < o.bottom - theme.top < TOUCHING]
    below = [o for o in others if -TOUCHING < theme.bottom - o.top < TOUCHING]
    if not above or not below:
        return None
    found = []
    for way in theme.upright_faces():
        half = theme.half_along(way)
        line = theme.centre + np.linspace(half, -half, SAMPLES)[:, None] * way
        held = np.array([any(o.covers(p) for o in above) for p in line])
        if not held.any() or held[0]:
            continue
        exposed = 2 * half * float(np.argmax(held)) / (SAMPLES - 1)
        holding = frozenset(o.id for o in others if _near(theme, o))
        found.append(Stuck(theme, way, exposed, 2 * half - exposed, holding))
    return max(found, key=lambda s: s.exposed, default=None)


def _flush(theme: SceneObject, others: list[SceneObject]) -> Stuck | None:
    """In the air in front of an upright face of something bigger: the rest of it is inside."""
    below = [o for o in others if theme.bottom - TOUCHING < o.top < theme.centre[2]]
    if any(o.covers(theme.centre) for o in below):
        return None
    for other in others:
        if not (other.bottom < theme.bottom and theme.top < other.top + TOUCHING):
            continue
        for way in other.upright_faces():
            shift = theme.centre - other.centre
            gap = float(shift @ way) - other.half_along(way) - theme.half_along(way)
            aside = np.array([-way[1], way[0], 0.0])
            # A seeming overlap may be twice as large: both faces and their directions are inexact.
            if -2 * TOUCHING < gap < TOUCHING and abs(float(shift @ aside)) < other.half_along(aside):
                exposed, depth = 2 * theme.half_along(way), 2 * other.half_along(way)
                return Stuck(_prolonged(theme, way, 0.5 * depth), way, exposed, depth, frozenset({other.id}))
    return None


def _prolonged(theme: SceneObject, way: FloatArray, by: float) -> SceneObject:
    """The object, ``by`` metres longer at the end opposite to ``way``."""
    axes = theme.world_from_object[:3, :3]
    axis = int(np.argmax(np.abs(way @ axes)))
    extents = theme.extents.copy()
    extents[axis] += by
    moved = rigid(translation=-0.5 * by * way) @ theme.world_from_object
    return replace(theme, world_from_object=moved, extents=extents)


def _near(theme: SceneObject, other: SceneObject) -> bool:
    gap = max(other.bottom - theme.top, theme.bottom - other.top)
    reach = 0.5 * float(np.linalg.norm(theme.extents[:2]) + np.linalg.norm(other.extents[:2]))
    return gap < TOUCHING and float(np.linalg.norm((theme.centre - other.centre)[:2])) < reach


def opening_angle(lid: SceneObject, body: SceneObject | None) -> float:
    """Radians that a lid is open: 0 where it lies flat, a right angle where it stands, more where it leans away.

    Its lower edge is assumed to be the hinge; ``body`` shows on which side of it the box is. Without one, a tilted lid
    is assumed to lean over what it closes, so the angle is at most a right one.
    """
    if _tilt(lid) < CLOSED:
        return 0.0
    out, level, _, _ = _swung(lid, body)
    return float(np.arctan2(out[2], out @ level))


def hinged(
    obj: SceneObject, objects: tuple[SceneObject, ...]
) -> tuple[SceneObject | None, SceneObject | None]:
    """The lid and the box that an object belongs to: (lid, box), None for a missing one.

    A lid is a flat part of something broader than the lid is thick.
    """
    parts = [o for o in objects if o.parent == obj.id and _thin(o)]
    if parts:
        return max(parts, key=lambda o: float(np.sort(o.extents)[1:].prod())), obj
    if obj.parent and _thin(obj):
        return obj, next((o for o in objects if o.id == obj.parent), None)
    return None, obj


def _thin(obj: SceneObject) -> bool:
    thin, middle, _ = np.sort(obj.extents)
    return obj.shape != "region" and bool(thin < 0.25 * middle)


BRIGHTER = 0.25
"""Increase of white, in [0, 1], above which something shines; shadows and angles change less."""
SAME_SPOT = 0.04
"""Largest distance of a lamp's part from its former place, metres."""


def shines(button: SceneObject, before: Scene, after: Scene) -> bool | None:
    """Whether the lamp of a button shines now; None if there is no lamp or it was not seen again."""
    kin = {button.parent, *(part.id for part in before.parts_of(button.parent))} if button.parent else set()
    lamp = [o for o in before.objects if o.id in kin and o.id != button.id]
    if not any("lamp" in o.label.split() or "light" in o.label.split() for o in lamp):
        return None
    found = [
        float(o.rgb.mean() - part.rgb.mean())
        for part in lamp
        for o in after.objects
        if np.linalg.norm((o.centre - part.centre)[:2]) < SAME_SPOT
    ]
    return max(found) > BRIGHTER if found else None
