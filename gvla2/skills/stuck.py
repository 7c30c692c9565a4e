"""Stuck: objects held between others that stick out sideways, and the direction in which they come out."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from gvla2.geometry.transform import FloatArray, rigid
from gvla2.planning.scene import Scene, SceneObject

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
