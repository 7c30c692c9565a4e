"""Stuck: what is held between other things and sticks out sideways, and which way it comes out."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from gvla2.geometry.transform import FloatArray, invert_rigid, rigid, transform_points
from gvla2.planning.scene import Scene, SceneObject

TOUCHING = 0.012
"""Gap below which two things may touch, metres: perceived faces err by some millimetres each."""
SAMPLES = 41


@dataclass(frozen=True)
class Stuck:
    """``theme`` with the part of it that is hidden added, as far as can be told; ``way`` (3,) level unit, out of what
    holds it; ``exposed`` metres of it stick out; ``hidden`` metres are held, at most.
    """

    theme: SceneObject
    way: FloatArray
    exposed: float
    hidden: float
    holders: frozenset[str]

    @property
    def end(self) -> FloatArray:
        """(3,) middle of the free end."""
        return self.theme.centre + self.way * _half(self.theme, self.way)


def stuck(theme: SceneObject, scene: Scene) -> Stuck | None:
    """How a thing is held sideways, or None when it is not: nothing lies on it, or something carries its middle."""
    if theme.shape == "region" or theme.bottom < scene.table_height + 0.01:
        return None
    others = [o for o in scene.obstacles(frozenset({theme.id})) if o.parent != theme.id]
    return _covered(theme, others) or _flush(theme, others)


def _covered(theme: SceneObject, others: list[SceneObject]) -> Stuck | None:
    """Part of it has something right above and right below, the other part has not."""
    above = [o for o in others if -TOUCHING < o.bottom - theme.top < TOUCHING]
    below = [o for o in others if -TOUCHING < theme.bottom - o.top < TOUCHING]
    if not above or not below:
        return None
    best: Stuck | None = None
    for way in _ways(theme):
        half = _half(theme, way)
        line = theme.centre + np.linspace(half, -half, SAMPLES)[:, None] * way
        held = np.array([_over(above, p) for p in line])
        if not held.any() or held[0]:
            continue
        exposed = 2 * half * float(np.argmax(held)) / (SAMPLES - 1)
        if best is None or exposed > best.exposed:
            holding = frozenset(o.id for o in others if _near(theme, o))
            best = Stuck(theme, way, exposed, 2 * half - exposed, holding)
    return best


def _flush(theme: SceneObject, others: list[SceneObject]) -> Stuck | None:
    """It hangs in the air before the upright face of something bigger: the rest of it is inside."""
    foot = np.array([theme.centre])
    if any(
        o.top < theme.centre[2] and o.top > theme.bottom - TOUCHING and _over([o], foot[0]) for o in others
    ):
        return None
    for other in others:
        if not (other.bottom < theme.bottom and theme.top < other.top + TOUCHING):
            continue
        for way in _ways(other):
            shift = theme.centre - other.centre
            gap = float(shift @ way) - _half(other, way) - _half(theme, way)
            aside = np.array([-way[1], way[0], 0.0])
            # What seems to reach into the other errs by both and by how they are turned: it is in it all the same.
            if -2 * TOUCHING < gap < TOUCHING and abs(float(shift @ aside)) < _half(other, aside):
                exposed, depth = 2 * _half(theme, way), 2 * _half(other, way)
                return Stuck(_prolonged(theme, way, 0.5 * depth), way, exposed, depth, frozenset({other.id}))
    return None


def _prolonged(theme: SceneObject, way: FloatArray, by: float) -> SceneObject:
    """The thing, ``by`` metres longer on the side away from ``way``: half of what may be hidden is likely."""
    axes = theme.world_from_object[:3, :3]
    axis = int(np.argmax(np.abs(way @ axes)))
    extents = theme.extents.copy()
    extents[axis] += by
    moved = rigid(translation=-0.5 * by * way) @ theme.world_from_object
    return replace(theme, world_from_object=moved, extents=extents)


def _ways(thing: SceneObject) -> list[FloatArray]:
    axes = thing.world_from_object[:3, :3]
    flat = [axes[:, i] * [1.0, 1.0, 0.0] for i in range(3) if abs(axes[2, i]) < 0.5]
    return [sign * a / np.linalg.norm(a) for a in flat for sign in (1.0, -1.0)]


def _over(things: list[SceneObject], point: FloatArray) -> bool:
    """Whether a point (3,) is in the footprint of one of them."""
    for thing in things:
        local = transform_points(
            invert_rigid(thing.world_from_object), np.array([point[0], point[1], thing.centre[2]])
        )
        if (np.abs(local[:2]) <= 0.5 * thing.extents[:2]).all():
            return True
    return False


def _near(theme: SceneObject, other: SceneObject) -> bool:
    gap = max(other.bottom - theme.top, theme.bottom - other.top)
    reach = 0.5 * float(np.linalg.norm(theme.extents[:2]) + np.linalg.norm(other.extents[:2]))
    return gap < TOUCHING and float(np.linalg.norm((theme.centre - other.centre)[:2])) < reach


def _half(thing: SceneObject, way: FloatArray) -> float:
    return float(np.abs(way @ thing.world_from_object[:3, :3]) @ (0.5 * thing.extents))
