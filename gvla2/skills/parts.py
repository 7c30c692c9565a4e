"""Parts: lids, caps, handles and buttons, recognised by how a part sits on its whole, or else by its name.

Geometry comes first. A flat part that covers its whole's top is a lid, a level bar before an upright face a handle, a
small flat round thing a button. What was seen badly, or stands open, may only be known by what its perceiver calls it:
:data:`NAMED` is all of words that the skills know, and it is about labels, never about an instruction.
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
"""What perceivers call a part that opens, that is pulled, and that is pressed."""

CLOSE = 0.012
"""Things whose gap in height is smaller may touch, metres: perceived heights err by some millimetres each."""
CENTRED = 0.012
"""The horizontal distance between the middles of a cap and of what it closes is less than this, metres."""
THIN = 0.25
"""A flat part is thinner than this share of its middle side."""
COVERING = 0.6
"""A lid is at least this share as long and as broad as what it covers."""
BUTTON_WIDTH, BUTTON_TOP = 0.08, 0.15
"""A round thing no wider, whose top is no higher above the table, may be a button, metres."""


def is_lid(thing: SceneObject, scene: Scene) -> bool:
    """Whether it opens something: a flat part that lies on its whole, or what is called a lid."""
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
    """Whether something is pulled by it: a level bar that is a part, or what is called a handle."""
    if called(thing, "handle"):
        return True
    level = abs(float(thing.world_from_object[2, int(thing.extents.argmax())])) < 0.3
    return bool(thing.parent) and thing.shape == "bar" and level


def is_button(thing: SceneObject, scene: Scene) -> bool:
    """Whether it can be pressed: small, round, low and flat (or on something), or called a button."""
    if called(thing, "button"):
        return True
    small = thing.extents[:2].max() <= BUTTON_WIDTH and thing.top - scene.table_height <= BUTTON_TOP
    flat = bool(thing.extents[2] <= thing.extents[:2].max())
    return bool(thing.shape in ("disc", "cylinder") and small and (flat or thing.parent))


def button_of(thing: SceneObject, scene: Scene) -> SceneObject | None:
    """The button that a thing is, or the one that is a part of it; None where it has none, or several."""
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
    """The cap that a thing is, or the cap that closes it."""
    if closed_by(thing, scene) is not None:
        return thing
    return next((o for o in scene.objects if o.parent == thing.id and closed_by(o, scene) is not None), None)


def root_of(thing: SceneObject, scene: Scene) -> SceneObject:
    """The whole that it is a part of in the end; itself where it is none."""
    for _ in scene.objects:
        above = scene.whole_of(thing)
        if above is None:
            break
        thing = above
    return thing


def called(thing: SceneObject, part: str) -> bool:
    """Whether a perceiver calls it a lid, a handle or a button."""
    return bool(NAMED[part] & set(re.findall(r"[a-z]+", thing.label.lower())))
