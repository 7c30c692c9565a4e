"""How far a lid is open, from its perceived plate and the box under it."""

from __future__ import annotations

import numpy as np

from gvla2.planning.scene import SceneObject

FLAT = 0.15
"""Tilt below which a lid lies flat, radians."""


def opening_angle(lid: SceneObject, body: SceneObject | None) -> float:
    """Radians that a lid is open: 0 where it lies flat, a right angle where it stands, more where it leans away.

    Its lower edge is assumed to be the hinge; ``body`` shows on which side of it the box is. Without one, a tilted lid
    is assumed to lean over what it closes, so the angle is at most a right one.
    """
    axes, extents = lid.world_from_object[:3, :3], lid.extents
    thin = int(np.argmin(extents))
    if np.arccos(min(1.0, abs(float(axes[2, thin])))) < FLAT:
        return 0.0
    rising = max((i for i in range(3) if i != thin), key=lambda i: abs(float(axes[2, i])))
    out = axes[:, rising] * (1.0 if axes[2, rising] > 0 else -1.0)
    level = float(np.hypot(out[0], out[1]))
    if body is None:
        return float(np.arctan2(out[2], level))
    hinge = lid.centre - 0.5 * float(extents[rising]) * out
    towards = float((body.centre - hinge)[:2] @ out[:2])
    return float(np.arctan2(out[2], level if towards > 0 else -level))


def hinged(
    thing: SceneObject, things: tuple[SceneObject, ...]
) -> tuple[SceneObject | None, SceneObject | None]:
    """The lid and the box of which a thing is one: (lid, box), None for a missing one.

    A lid is a flat part of something broader than the lid is thick.
    """
    parts = [o for o in things if o.parent == thing.id and _flat(o)]
    if parts:
        return max(parts, key=lambda o: float(np.sort(o.extents)[1:].prod())), thing
    if thing.parent and _flat(thing):
        return thing, next((o for o in things if o.id == thing.parent), None)
    return None, thing


def _flat(thing: SceneObject) -> bool:
    thin, middle, _ = np.sort(thing.extents)
    return thing.shape != "region" and bool(thin < 0.25 * middle)
