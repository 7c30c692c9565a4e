"""Wholes: an object together with its perceived parts, and what it stands in."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gvla2.geometry.transform import FloatArray, invert_rigid, transform_points
from gvla2.planning.scene import ROUND, Scene, SceneObject
from gvla2.skills.parts import CLOSE

SLIM, UPRIGHT = 0.03, 0.95
"""A stick is slimmer than this in both directions, metres, and upright by this cosine."""

CLEAR = 0.03
"""An object drawn out of something ends this far above it, metres."""


def assembled(thing: SceneObject, scene: Scene) -> SceneObject:
    """The object and its parts as one object: all their points, and one box around the same vertical axis."""
    parts = [p for p in scene.parts_of(thing.id) if p.shape != "region"]
    if not parts:
        return to_its_end(thing, scene)
    corners = np.concatenate([thing.corners(), *(p.corners() for p in parts)])
    local = transform_points(invert_rigid(thing.world_from_object), corners)
    low, high = local.min(axis=0), local.max(axis=0)
    up = int(np.argmax(np.abs(thing.world_from_object[2, :3])))
    half = np.maximum(-low, high)
    extents = np.where(np.arange(3) == up, high - low, 2.0 * half)
    shift = np.where(np.arange(3) == up, 0.5 * (low + high), 0.0)
    pose = thing.world_from_object.copy()
    pose[:3, 3] += pose[:3, :3] @ shift
    broader = bool((np.delete(extents - thing.extents, up) > 0.006).any())
    points = np.concatenate([thing.points, *(p.points for p in parts)])
    shape = "other" if broader and thing.shape in ROUND else thing.shape
    whole = replace(thing, world_from_object=pose, extents=extents, points=points, shape=shape)
    return to_its_end(whole, scene)


def holders(thing: SceneObject, scene: Scene) -> tuple[SceneObject, ...]:
    """What the object stands in or on: its foot is within their footprint, at a height where they touch."""
    return tuple(
        o for o in scene.obstacles(frozenset({thing.id}))
        if o.top > thing.bottom - CLOSE and o.bottom < thing.bottom + CLOSE and _over(thing, o) and o.top < thing.top
    )  # fmt: skip


def inside(thing: SceneObject, holder: SceneObject) -> bool:
    """Whether the object reaches down into the holder instead of resting on its top.

    A stick cannot stand on its end: if it seems to, it is stuck in what is below.
    """
    at_top = holder.top > thing.bottom - CLOSE
    return holder.top > thing.bottom + CLOSE or (at_top and (holder.opening > 0.0 or stick(thing)))


def stick(thing: SceneObject) -> bool:
    """Whether it is upright and so slim that it would not stand by itself."""
    tall = int(np.argmax(thing.extents))
    rest = np.delete(thing.extents, tall)
    upright = abs(float(thing.world_from_object[2, tall])) > UPRIGHT
    return upright and float(rest.max()) < SLIM and float(thing.extents[tall]) > 2.0 * float(rest.max())


def to_its_end(thing: SceneObject, scene: Scene) -> SceneObject:
    """A stick with its box extended to the bottom of what it is stuck in, since its end is hidden there."""
    depth = max(
        (thing.bottom - h.bottom for h in holders(thing, scene) if stick(thing) and inside(thing, h)),
        default=0.0,
    )
    if depth <= CLOSE:
        return thing
    tall = int(np.argmax(thing.extents))
    extents, pose = thing.extents.copy(), thing.world_from_object.copy()
    up = float(np.sign(pose[2, tall]))
    extents[tall] += depth
    pose[:3, 3] -= up * 0.5 * depth * pose[:3, tall]
    return replace(thing, world_from_object=pose, extents=extents)


def way_out(thing: SceneObject, scene: Scene) -> FloatArray:
    """(3,) unit: the direction in which an object leaves what it stands in: along itself for a stick, else up."""
    tall = int(np.argmax(thing.extents))
    along = thing.world_from_object[:3, tall]
    if not stick(thing) or not any(inside(thing, h) for h in holders(thing, scene)):
        return np.array([0.0, 0.0, 1.0])
    return np.asarray(along if along[2] > 0 else -along)


def rise(thing: SceneObject, scene: Scene) -> float:
    """Height by which the object must be lifted to leave what it stands in, metres; 0 if it stands in nothing.

    Its hidden end is assumed to reach the bottom of what it stands in.
    """
    about = [h for h in holders(thing, scene) if inside(thing, h)]
    return max((h.top - min(h.bottom, thing.bottom) for h in about), default=0.0)


def _over(thing: SceneObject, other: SceneObject) -> bool:
    foot = thing.centre
    lean = thing.world_from_object[:3, :3]
    tall = int(np.argmax(thing.extents))
    if abs(lean[2, tall]) > 0.7:  # the lower end of something long, which may lean
        foot = thing.centre - np.sign(lean[2, tall]) * lean[:, tall] * 0.5 * thing.extents[tall]
    return other.covers(foot)
