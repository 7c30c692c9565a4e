"""The part hierarchy of a scene: parts and wholes, what stands in what, and pieces of one object seen apart.

Geometry comes first. A flat part that covers the top of its whole is a lid, a level bar in front of an upright face a
handle, a small flat round part a button. A part that was seen badly, or stands open, may be recognised only by its
label: :data:`NAMED` are the only words in the skills, and they are about labels, never about an instruction.
"""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np

from gvla2.geometry.transform import FloatArray, invert_rigid, transform_points
from gvla2.planning.scene import ROUND, Scene, SceneObject

NAMED = {
    "lid": frozenset(["lid", "cap", "cover", "stopper", "cork"]),
    "handle": frozenset(["handle", "grip", "haft"]),
    "button": frozenset(["button", "switch", "pushbutton", "knob"]),
}
"""Labels of parts that open, that are pulled and that are pressed."""

CLOSE = 0.012
"""Objects with a smaller vertical gap may touch, metres: perceived heights are off by a few millimetres."""
CENTRED = 0.012
"""The horizontal distance between the middles of a cap and of what it closes is less than this, metres."""
THIN = 0.25
"""A flat part is thinner than this share of its middle side."""
COVERING = 0.6
"""A lid is at least this share as long and as broad as what it covers."""
KNOB = 0.12
"""Longest side of a turning part that is a knob and no door, metres."""
AJAR = 0.15
"""A drawer or door is open beyond this share of its reach."""
BUTTON_WIDTH, BUTTON_TOP = 0.08, 0.15
"""Greatest width of a button, and greatest height of its top above the table, metres."""


def is_lid(obj: SceneObject, scene: Scene) -> bool:
    """Whether it is a lid: a flat part that lies on its whole, or labelled as one."""
    if called(obj, "lid"):
        return True
    body = scene.whole_of(obj)
    if body is None or obj.shape not in ("plate", "disc") or called(obj, "button"):
        return False
    thin, middle, _ = sorted(float(v) for v in obj.extents)
    upright = abs(float(obj.world_from_object[2, int(obj.extents.argmin())])) > 0.95
    covers = all(
        a > COVERING * b for a, b in zip(sorted(obj.extents)[1:], sorted(body.extents[:2]), strict=True)
    )
    return thin < THIN * middle and upright and covers and abs(obj.bottom - body.top) < CLOSE


def is_handle(obj: SceneObject) -> bool:
    """Whether it is a handle: a level bar that is a part, or labelled as one."""
    if called(obj, "handle"):
        return True
    level = abs(float(obj.world_from_object[2, int(obj.extents.argmax())])) < 0.3
    return bool(obj.parent) and obj.shape == "bar" and level


def is_button(obj: SceneObject, scene: Scene) -> bool:
    """Whether it is a button: small, round, low and flat (or a part), or labelled as one; not what turns."""
    if obj.joint is not None and not obj.joint.slides:
        return False
    if called(obj, "button"):
        return True
    small = obj.extents[:2].max() <= BUTTON_WIDTH and obj.top - scene.table_height <= BUTTON_TOP
    flat = bool(obj.extents[2] <= obj.extents[:2].max())
    return bool(obj.shape in ("disc", "cylinder") and small and (flat or obj.parent))


def button_of(obj: SceneObject, scene: Scene) -> SceneObject | None:
    """The object itself if it is a button, or its only button; None if it has none, or several."""
    if is_button(obj, scene):
        return obj
    buttons = [part for part in scene.parts_of(obj.id) if is_button(part, scene)]
    named = [b for b in buttons if called(b, "button")] or buttons
    return named[0] if len(named) == 1 else None


def knob_of(obj: SceneObject, scene: Scene) -> SceneObject | None:
    """The object itself if it is a knob, a small part that turns, or its only knob; None if it has none, or several."""
    knobs = [
        p for p in (obj, *scene.parts_of(obj.id)) if p.joint and not p.joint.slides and max(p.extents) <= KNOB
    ]
    return knobs[0] if len(knobs) == 1 else None


def is_ajar(part: SceneObject) -> bool | None:
    """Whether a drawer or door is open by more than a little; None if its joint is not known, or it is a knob."""
    if part.joint is None or (not part.joint.slides and max(part.extents) <= KNOB):
        return None
    return part.joint.position > AJAR * part.joint.reach


def closed_by(cap: SceneObject, scene: Scene) -> SceneObject | None:
    """The round object closed by the part ``cap``, which sits on its upper end; None if it is no cap.

    A lid on a round object turns, one on a box swings: nothing else distinguishes them before they move.
    """
    body = scene.whole_of(cap)
    if body is None or body.shape not in ROUND or abs(cap.bottom - body.top) > CLOSE:
        return None
    off = float(np.linalg.norm(cap.centre[:2] - body.centre[:2]))
    flat = cap.top - cap.bottom < 0.5 * (body.top - body.bottom)
    return body if off < CENTRED and flat else None


def cap_of(obj: SceneObject, scene: Scene) -> SceneObject | None:
    """The object itself if it is a cap, or the cap that closes it."""
    if closed_by(obj, scene) is not None:
        return obj
    return next((o for o in scene.objects if o.parent == obj.id and closed_by(o, scene) is not None), None)


def root_of(obj: SceneObject, scene: Scene) -> SceneObject:
    """The outermost whole that it is a part of; the object itself if it is no part."""
    for _ in scene.objects:
        above = scene.whole_of(obj)
        if above is None:
            break
        obj = above
    return obj


def called(obj: SceneObject, part: str) -> bool:
    """Whether its label is one of a ``part``: "lid", "handle" or "button"."""
    return bool(NAMED[part] & set(re.findall(r"[a-z]+", obj.label.lower())))


SLIM, UPRIGHT = 0.03, 0.95
"""A stick is slimmer than this in both directions, metres, and upright by this cosine."""

CLEAR = 0.03
"""An object drawn out of something ends this far above it, metres."""


def assembled(obj: SceneObject, scene: Scene) -> SceneObject:
    """The object and its parts as one object: all their points, and one box around the same vertical axis."""
    parts = [p for p in scene.parts_of(obj.id) if p.shape != "region"]
    if not parts:
        return to_its_end(obj, scene)
    corners = np.concatenate([obj.corners(), *(p.corners() for p in parts)])
    local = transform_points(invert_rigid(obj.world_from_object), corners)
    low, high = local.min(axis=0), local.max(axis=0)
    up = int(np.argmax(np.abs(obj.world_from_object[2, :3])))
    half = np.maximum(-low, high)
    extents = np.where(np.arange(3) == up, high - low, 2.0 * half)
    shift = np.where(np.arange(3) == up, 0.5 * (low + high), 0.0)
    pose = obj.world_from_object.copy()
    pose[:3, 3] += pose[:3, :3] @ shift
    broader = bool((np.delete(extents - obj.extents, up) > 0.006).any())
    points = np.concatenate([obj.points, *(p.points for p in parts)])
    shape = "other" if broader and obj.shape in ROUND else obj.shape
    whole = replace(obj, world_from_object=pose, extents=extents, points=points, shape=shape)
    return to_its_end(whole, scene)


def holders(obj: SceneObject, scene: Scene) -> tuple[SceneObject, ...]:
    """What the object stands in or on: its foot is within their footprint, at a height where they touch."""
    return tuple(
        o for o in scene.obstacles(frozenset({obj.id}))
        if o.top > obj.bottom - CLOSE and o.bottom < obj.bottom + CLOSE and _over(obj, o)
        and (o.top < obj.top or o.opening > float(obj.extents[:2].min()))
    )  # fmt: skip


def inside(obj: SceneObject, holder: SceneObject) -> bool:
    """Whether the object reaches down into the holder instead of resting on its top.

    A stick cannot stand on its end: if it seems to, it is stuck in what is below.
    """
    at_top = holder.top > obj.bottom - CLOSE
    return holder.top > obj.bottom + CLOSE or (at_top and (holder.opening > 0.0 or stick(obj)))


def stick(obj: SceneObject) -> bool:
    """Whether it is upright and so slim that it would not stand by itself."""
    tall = int(np.argmax(obj.extents))
    rest = np.delete(obj.extents, tall)
    upright = abs(float(obj.world_from_object[2, tall])) > UPRIGHT
    return upright and float(rest.max()) < SLIM and float(obj.extents[tall]) > 2.0 * float(rest.max())


def to_its_end(obj: SceneObject, scene: Scene) -> SceneObject:
    """A stick with its box extended to the bottom of what it is stuck in, since its end is hidden there."""
    depth = max(
        (obj.bottom - h.bottom for h in holders(obj, scene) if stick(obj) and inside(obj, h)),
        default=0.0,
    )
    if depth <= CLOSE:
        return obj
    tall = int(np.argmax(obj.extents))
    extents, pose = obj.extents.copy(), obj.world_from_object.copy()
    up = float(np.sign(pose[2, tall]))
    extents[tall] += depth
    pose[:3, 3] -= up * 0.5 * depth * pose[:3, tall]
    return replace(obj, world_from_object=pose, extents=extents)


def way_out(obj: SceneObject, scene: Scene) -> FloatArray:
    """(3,) unit: the direction in which an object leaves what it stands in: along itself for a stick, else up."""
    tall = int(np.argmax(obj.extents))
    along = obj.world_from_object[:3, tall]
    if not stick(obj) or not any(inside(obj, h) for h in holders(obj, scene)):
        return np.array([0.0, 0.0, 1.0])
    return np.asarray(along if along[2] > 0 else -along)


def rise(obj: SceneObject, scene: Scene) -> float:
    """Height by which the object must be lifted to leave what it stands in, metres; 0 if it stands in nothing.

    Its hidden end is assumed to reach the bottom of what it stands in.
    """
    about = [h for h in holders(obj, scene) if inside(obj, h)]
    return max((h.top - min(h.bottom, obj.bottom) for h in about), default=0.0)


def _over(obj: SceneObject, other: SceneObject) -> bool:
    foot = obj.centre
    lean = obj.world_from_object[:3, :3]
    tall = int(np.argmax(obj.extents))
    if abs(lean[2, tall]) > 0.7:  # the lower end of something long, which may lean
        foot = obj.centre - np.sign(lean[2, tall]) * lean[:, tall] * 0.5 * obj.extents[tall]
    return other.covers(foot)


ON_AXIS = 0.01
"""The middle of what is on a stick's end is closer than this to the stick's axis, metres."""
SHARED = 0.5
"""Two objects are one if more than this share of one's box is inside the other's."""
GRID = 7


def joined(theme: SceneObject, scene: Scene) -> tuple[SceneObject, Scene]:
    """The uppermost of the objects in one piece with ``theme``, which can be grasped, and the scene with the others as
    its parts; the parts of other objects stay theirs.
    """
    one, wholes = {theme.id}, [o for o in scene.objects if not o.parent and o.shape != "region"]
    for _ in wholes:  # what belongs to it, then what belongs to that
        one |= {o.id for o in wholes if any(i != o.id and _one_piece(scene[i], o) for i in one)}
    upper = max((scene[i] for i in one), key=lambda o: o.top)
    main = upper if upper.top > theme.top + CLOSE and not theme.parent else theme
    for other in scene.objects:
        if other.id in one - {main.id}:
            scene = scene.with_object(replace(other, parent=main.id))
    return scene[main.id], scene


def _one_piece(obj: SceneObject, other: SceneObject) -> bool:
    lower, upper = sorted((obj, other), key=lambda o: o.bottom)
    off = float(np.linalg.norm((upper.centre - lower.centre)[:2]))
    if stick(lower) and abs(upper.bottom - lower.top) < CLOSE and off < ON_AXIS:
        return True
    hollow = obj.opening > 0.0 or other.opening > 0.0
    smaller = float(np.prod(other.extents)) < float(np.prod(obj.extents))
    return smaller and not hollow and _share(other, obj) > SHARED


def _share(one: SceneObject, other: SceneObject) -> float:
    """Share of the box of ``one`` that is inside the box of ``other``."""
    steps = (np.arange(GRID) + 0.5) / GRID - 0.5
    grid = np.stack(np.meshgrid(steps, steps, steps), axis=-1).reshape(-1, 3) * one.extents
    local = transform_points(
        invert_rigid(other.world_from_object), transform_points(one.world_from_object, grid)
    )
    return float((np.abs(local) <= 0.5 * other.extents).all(axis=1).mean())
