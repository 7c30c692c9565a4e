"""Caps: what closes a round thing at its top, and comes off by turning."""

from __future__ import annotations

import numpy as np

from gvla2.planning.scene import Scene, SceneObject
from gvla2.skills.holds import ROUND
from gvla2.skills.parts import CLOSE

CENTRED = 0.012
"""A cap's middle is this near to the axis of what it closes, metres."""


def closed_by(cap: SceneObject, scene: Scene) -> SceneObject | None:
    """The round thing whose upper end the part ``cap`` sits on; None when it is no cap.

    A lid on a round thing turns, one on a box swings: nothing else tells them apart before they move.
    """
    body = next((o for o in scene.objects if o.id == cap.parent), None)
    if body is None or body.shape not in ROUND or abs(cap.bottom - body.top) > CLOSE:
        return None
    off = float(np.linalg.norm(cap.centre[:2] - body.centre[:2]))
    flat = cap.top - cap.bottom < 0.5 * (body.top - body.bottom)
    return body if off < CENTRED and flat else None


def cap_of(thing: SceneObject, scene: Scene) -> SceneObject | None:
    """The cap that a thing is, or that closes it."""
    if closed_by(thing, scene) is not None:
        return thing
    return next((o for o in scene.objects if o.parent == thing.id and closed_by(o, scene) is not None), None)
