"""Wholes with parts that move: cabinets with drawers, stoves with knobs, boxes with doors, from known geometry."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from gvla2.geometry.transform import FloatArray, rigid
from gvla2.planning.scene import PartJoint, SceneObject

STANDS_OUT = 0.01
"""Metres that a handle reaches beyond everything else of its whole, along the drawer's way."""
BAR = 0.012
"""A drawer's handle is the outermost part of it, this thick, metres: posts that hold it are left out."""
FACE, BROAD = 0.003, 0.03
"""Thickness of a layer that is a drawer's front, metres, and the least share of its points in it."""
KNOB = 0.12
"""A turning part with no longer side than this is a knob, metres; a longer one is a door."""
THIN = 2e-3
"""Least side of an object, metres."""


def joint_of(
    slides: bool, axis: FloatArray, origin: FloatArray, value: float, low: float, high: float
) -> PartJoint:
    """A joint at ``value`` with limits, whose ``axis`` is that of increasing values: zero is closed if it is a limit's
    neighbour or inside, and the part opens towards the farther limit.
    """
    closed = float(np.clip(0.0, low, high))
    end = high if high - closed >= closed - low else low
    sign = 1.0 if end > closed else -1.0
    return PartJoint(
        slides, sign * np.asarray(axis), np.asarray(origin), sign * (value - closed), abs(end - closed)
    )


def part_noun(joint: PartJoint, points: FloatArray) -> str:
    """What a moving part is called where its model has no word for it: drawer, door, or knob."""
    if joint.slides:
        return "drawer"
    return "knob" if float(np.ptp(points, axis=0).max()) <= KNOB else "door"


@dataclass(frozen=True)
class MovingPart:
    """A part's ``name``, its surface ``points`` (N, 3), world metres, and its joint."""

    name: str
    points: FloatArray
    joint: PartJoint


def with_parts(whole: SceneObject, body: FloatArray, parts: Sequence[MovingPart]) -> list[SceneObject]:
    """The whole, its moving parts and their handles, ids after the whole's; ``body`` (N, 3) are points of the whole
    without what moves. All boxes are turned about the vertical like the whole's.
    """
    turn = whole.world_from_object[:3, :3]
    found = [whole]
    for number, part in enumerate(parts):
        handle = handle_points(part, body)
        # Without what stands out, or the boxes of drawers one above the other would hide each other's handles.
        flush = part.points[part.points @ part.joint.axis <= _face(part, body)]
        obj = _part(f"{whole.id}.{number}", part.name, flush if len(handle) else part.points, turn, whole)
        obj = replace(obj, joint=part.joint, opening=_opening(part, turn))
        found.append(obj)
        if len(handle):
            bar = _part(f"{obj.id}.handle", f"{part.name} handle", handle, turn, obj)
            found.append(replace(bar, shape="bar"))
    return found


def handle_points(part: MovingPart, body: FloatArray) -> FloatArray:
    """(M, 3) points of a sliding part that stand out before the front of the whole and of the part itself; none if it
    has no handle.
    """
    joint = part.joint
    if not joint.slides or not len(body) or abs(joint.axis[2]) > 0.5:
        return np.zeros((0, 3))
    along = part.points @ joint.axis
    outer = float(along.max())
    if outer < _front(part, body) + STANDS_OUT:
        return np.zeros((0, 3))
    return part.points[along > outer - BAR]


def _face(part: MovingPart, body: FloatArray) -> float:
    """Coordinate along a sliding part's way of its own front: the outermost layer, near that of its whole, with more in
    it than a handle's posts.
    """
    along = part.points @ part.joint.axis
    along = along[along < _front(part, body) + STANDS_OUT]
    layers = along.max(initial=-np.inf) - FACE * np.arange(STANDS_OUT / FACE + 1)
    broad = [
        top for top in layers if ((along > top - FACE) & (along <= top)).sum() > BROAD * len(part.points)
    ]
    return float(broad[0] if broad else layers[0])


def _front(part: MovingPart, body: FloatArray) -> float:
    """Coordinate along a sliding part's way of the front of its whole, ``body`` (N, 3), moved as far as the part."""
    return float((body @ part.joint.axis).max(initial=-np.inf)) + part.joint.position


def _opening(part: MovingPart, turn: FloatArray) -> float:
    """Inner width of a drawer that is open far enough to put something in, metres."""
    if not part.joint.slides or part.joint.position < 0.3 * part.joint.reach:
        return 0.0
    level = (part.points @ turn)[:, :2]
    return 0.8 * float(np.ptp(level, axis=0).min())


def _part(id_: str, name: str, points: FloatArray, turn: FloatArray, parent: SceneObject) -> SceneObject:
    local = points @ turn
    low, high = local.min(axis=0), local.max(axis=0)
    return replace(
        parent,
        id=id_,
        label=name,
        shape="box",
        world_from_object=rigid(turn, turn @ (0.5 * (low + high))),
        extents=np.maximum(high - low, THIN),
        points=points,
        parent=parent.id,
        opening=0.0,
        known=None,
        joint=None,
    )
