"""Parts: lids, caps, handles and buttons, recognised by how a part sits on its whole, or else by its name.

Geometry comes first. A flat part that covers the top of its whole is a lid, a level bar in front of an upright face a
handle, a small flat round part a button. A part that was seen badly, or stands open, may be recognised only by its
label: :data:`NAMED` are the only words in the skills, and they are about labels, never about an instruction.
"""

from __future__ import annotations

import re

import numpy as np

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
BUTTON_WIDTH, BUTTON_TOP = 0.08, 0.15
"""Greatest width of a button, and greatest height of its top above the table, metres."""


def is_lid(thing: SceneObject, scene: Scene) -> bool:
    """Whether it is a lid: a flat part that lies on its whole, or labelled as one."""
    if called(thing, "lid"):
        return True
    body = scene.whole_of(thing)
    if body is None or thing.shape not in ("plate", "disc") or called(thing, "button"):
        return False
    thin, middle, _ = sorted(float(v) for v in thing.extents)
    upright = abs(float(thing.world_from_object[2, int(thing.extents.argmin())])) > 0.95
    covers = all(
        a > COVERING * b for a, b in zip(sorted(thing.extents)[1:], sorted(body.extents[:2]), strict=True)
    )
    return thin < THIN * middle and upright and covers and abs(thing.bottom - body.top) < CLOSE


def is_handle(thing: SceneObject) -> bool:
    """Whether it is a handle: a level bar that is a part, or labelled as one."""
    if called(thing, "handle"):
        return True
    level = abs(float(thing.world_from_object[2, int(thing.extents.argmax())])) < 0.3
    return bool(thing.parent) and thing.shape == "bar" and level


def is_button(thing: SceneObject, scene: Scene) -> bool:
    """Whether it is a button: small, round, low and flat (or a part), or labelled as one."""
    if called(thing, "button"):
        return True
    small = thing.extents[:2].max() <= BUTTON_WIDTH and thing.top - scene.table_height <= BUTTON_TOP
    flat = bool(thing.extents[2] <= thing.extents[:2].max())
    return bool(thing.shape in ("disc", "cylinder") and small and (flat or thing.parent))


def button_of(thing: SceneObject, scene: Scene) -> SceneObject | None:
    """The object itself if it is a button, or its only button; None if it has none, or several."""
    if is_button(thing, scene):
        return thing
    buttons = [part for part in scene.parts_of(thing.id) if is_button(part, scene)]
    named = [b for b in buttons if called(b, "button")] or buttons
    return named[0] if len(named) == 1 else None


def closed_by(cap: SceneObject, scene: Scene) -> SceneObject | None:
    """The round object closed by the part ``cap``, which sits on its upper end; None if it is no cap.

    A lid on a round thing turns, one on a box swings: nothing else distinguishes them before they move.
    """
    body = scene.whole_of(cap)
    if body is None or body.shape not in ROUND or abs(cap.bottom - body.top) > CLOSE:
        return None
    off = float(np.linalg.norm(cap.centre[:2] - body.centre[:2]))
    flat = cap.top - cap.bottom < 0.5 * (body.top - body.bottom)
    return body if off < CENTRED and flat else None


def cap_of(thing: SceneObject, scene: Scene) -> SceneObject | None:
    """The object itself if it is a cap, or the cap that closes it."""
    if closed_by(thing, scene) is not None:
        return thing
    return next((o for o in scene.objects if o.parent == thing.id and closed_by(o, scene) is not None), None)


def root_of(thing: SceneObject, scene: Scene) -> SceneObject:
    """The outermost whole that it is a part of; the object itself if it is no part."""
    for _ in scene.objects:
        above = scene.whole_of(thing)
        if above is None:
            break
        thing = above
    return thing


def called(thing: SceneObject, part: str) -> bool:
    """Whether its label is one of a ``part``: "lid", "handle" or "button"."""
    return bool(NAMED[part] & set(re.findall(r"[a-z]+", thing.label.lower())))
