"""Joined: objects that perception separated but that must be one piece.

Perception separates objects by colour: the shaded side of a bottle, the handle at the end of a shaft. But two objects
cannot be in the same place, and nothing stands on the end of a stick. Whoever grasps one moves the other, too.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gvla2.geometry.transform import invert_rigid, transform_points
from gvla2.planning.scene import Scene, SceneObject
from gvla2.skills.parts import CLOSE
from gvla2.skills.wholes import stick

CENTRED = 0.01
"""The middle of what is on a stick's end is closer than this to the stick's axis, metres."""
SHARED = 0.5
"""Two objects are one if more than this share of one's box is inside the other's."""
GRID = 7


def joined(theme: SceneObject, scene: Scene) -> tuple[SceneObject, Scene]:
    """The uppermost of the objects in one piece with ``theme``, which can be grasped, and the scene with the others as
    its parts; the parts of other objects stay theirs.
    """
    one = {theme.id}
    grown = True
    while grown:
        grown = False
        for other in scene.objects:
            if other.id in one or other.parent or other.shape == "region":
                continue
            if any(_one_piece(scene[i], other) for i in one):
                one.add(other.id)
                grown = True
    upper = max((scene[i] for i in one), key=lambda o: o.top)
    main = upper if upper.top > theme.top + CLOSE and not theme.parent else theme
    for other in scene.objects:
        if other.id in one - {main.id}:
            scene = scene.with_object(replace(other, parent=main.id))
    return scene[main.id], scene


def _one_piece(thing: SceneObject, other: SceneObject) -> bool:
    lower, upper = sorted((thing, other), key=lambda o: o.bottom)
    off = float(np.linalg.norm((upper.centre - lower.centre)[:2]))
    if stick(lower) and abs(upper.bottom - lower.top) < CLOSE and off < CENTRED:
        return True
    hollow = thing.opening > 0.0 or other.opening > 0.0
    smaller = float(np.prod(other.extents)) < float(np.prod(thing.extents))
    return smaller and not hollow and _share(other, thing) > SHARED


def _share(one: SceneObject, other: SceneObject) -> float:
    """Share of the box of ``one`` that is inside the box of ``other``."""
    steps = (np.arange(GRID) + 0.5) / GRID - 0.5
    grid = np.stack(np.meshgrid(steps, steps, steps), axis=-1).reshape(-1, 3) * one.extents
    local = transform_points(
        invert_rigid(other.world_from_object), transform_points(one.world_from_object, grid)
    )
    return float((np.abs(local) <= 0.5 * other.extents).all(axis=1).mean())
