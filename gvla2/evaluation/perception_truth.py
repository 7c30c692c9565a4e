"""The true objects on the table, with the pixels that show them."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from gvla2.geometry.transform import FloatArray, invert_rigid, rigid, transform_points
from gvla2.geometry.views import Observation
from gvla2.planning.colours import SYNONYMS, colours_in
from gvla2.planning.scene import Scene, SceneObject
from gvla2.robot.solids import Volume
from gvla2.robot.task import Body, Layout, Primitive

SEEN = 20
"""Pixels of all views together below which an object counts as hidden and need not be found."""

TOUCH = 0.002
"""Metres between objects of one pile."""

ALL_OF_IT = 0.9
"""Share of a whole's pixels above which only the part is visible."""

THIN = 0.004
"""Metres below which a side is too thin to be spanned by pixels."""

PILE = "pile"
PILES = ("heap", "stack", "tower")
"""Words for several objects that look like one; the choice is a matter of taste."""

BoolArray = NDArray[np.bool_]


@runtime_checkable
class Segmented(Protocol):
    """A simulated robot that knows what each pixel shows. Only perception benchmarks use it."""

    def true_scene(self) -> Scene:
        """Every body as an object, its id the body's name, and its named parts, called ``body/label``."""
        ...

    def true_masks(self, observation: Observation) -> tuple[tuple[str, ...], list[NDArray[np.int32]]]:
        """The ids, and one image (H, W) a view of indices into them; -1 where none is seen.

        A named part's pixels are its own, not the body's.
        """
        ...


@dataclass(frozen=True)
class TrueObject:
    """One object to find. ``box`` has its pose and extents; ``label`` is "" if the task does not name it.

    ``kind`` is its head noun. ``whole`` and ``bare`` (P,) mark its pixels among those of all views that have a depth
    (see :func:`measured`): with its named parts, and without. ``seen`` (3,) is the share of each side of the box that
    those pixels span: an object in a holder is partly hidden. ``part`` marks a named part of another; ``count`` is a
    pile's number of bodies.
    """

    name: str
    label: str
    kind: str
    box: SceneObject
    whole: BoolArray
    bare: BoolArray
    seen: FloatArray
    part: bool = False
    count: int = 1


def measured(observation: Observation) -> list[BoolArray]:
    """The pixels (H, W) of each view that have a depth; the others are useless to a perceiver."""
    return [
        np.ones(view.image.shape[:2], dtype=bool) if view.depth is None else np.isfinite(view.depth)
        for view in observation.views
    ]


def true_objects(robot: Segmented, observation: Observation, layout: Layout) -> list[TrueObject]:
    """All objects and named parts that at least :data:`SEEN` pixels show; if only a part of its whole is visible, they
    are one object (a knife in its block is its handle).

    Touching bodies of one label are one pile: the pictures cannot tell them apart.
    """
    names, images = robot.true_masks(observation)
    pixels = np.concatenate([image[ok] for image, ok in zip(images, measured(observation), strict=True)])
    points = _points(observation)
    own = {name: pixels == index for index, name in enumerate(names)}
    nothing = np.zeros(len(pixels), dtype=bool)
    bodies = {body.name: body for body in layout.bodies}
    objects: list[TrueObject] = []
    for box in robot.true_scene().objects:
        body_name, _, part = box.id.partition("/")
        body = bodies[body_name]
        bare = own.get(box.id, nothing)
        whole = bare
        if not part:
            whole = np.any(
                [bare, *(own.get(f"{box.id}/{label}", nothing) for label, _ in body.parts)], axis=0
            )
        label = part or body.label
        kind = head_noun(label) or body_name
        objects.append(TrueObject(box.id, label, kind, box, whole, bare, np.zeros(3), part=bool(part)))
    wholes = {obj.name: int(obj.whole.sum()) for obj in objects}
    shown = [
        obj
        for obj in _piled(objects)
        if obj.whole.sum() >= SEEN
        and not (obj.part and obj.whole.sum() > ALL_OF_IT * wholes[obj.name.partition("/")[0]])
    ]
    return [replace(obj, seen=_spanned(obj.box, points[obj.whole])) for obj in shown]


def _points(observation: Observation) -> FloatArray:
    """(P, 3) world points of the pixels that have a depth; NaN in views without any."""
    found = []
    for view, ok in zip(observation.views, measured(observation), strict=True):
        found.append(np.full((int(ok.sum()), 3), np.nan) if view.depth is None else view.points()[ok])
    return np.concatenate(found)


def _spanned(box: SceneObject, points: FloatArray) -> FloatArray:
    """(3,) share of the box's sides that points (N, 3) span; 1 for a side thinner than the depth's accuracy."""
    points = points[np.isfinite(points).all(axis=1)]
    if not len(points):
        return np.zeros(3)
    half = 0.5 * box.extents
    local = np.clip(transform_points(invert_rigid(box.world_from_object), points), -half, half)
    spanned = local.max(axis=0) - local.min(axis=0)
    return np.where(box.extents < THIN, 1.0, spanned / np.maximum(box.extents, THIN))


def _piled(objects: Sequence[TrueObject]) -> list[TrueObject]:
    piles: list[list[TrueObject]] = []
    for obj in objects:
        near = [pile for pile in piles if any(_one_pile(obj, other) for other in pile)]
        piles = [pile for pile in piles if all(pile is not other for other in near)]
        piles.append([*(other for pile in near for other in pile), obj])
    return [_pile(pile) if len(pile) > 1 else pile[0] for pile in piles]


def _one_pile(one: TrueObject, other: TrueObject) -> bool:
    flat = "region" in (one.box.shape, other.box.shape)
    if one.part or other.part or flat or not one.label or one.label != other.label:
        return False
    a, b, c = (float(side) + TOUCH for side in one.box.extents)
    d, e, f = (float(side) for side in other.box.extents)
    solid = Body("", (Primitive("box", (d, e, f), (0.0, 0.0, 0.0)),), other.box.world_from_object)
    return Volume(one.box.world_from_object, (a, b, c)).meets(solid, other.box.world_from_object)


def _pile(members: Sequence[TrueObject]) -> TrueObject:
    """Several objects as one, its box around all of them along the axes of the lowest."""
    lowest = min(members, key=lambda obj: obj.box.bottom)
    box = box_about([obj.box for obj in members], lowest.box)
    return TrueObject(
        f"{lowest.name}+{len(members) - 1}",
        " ".join([*colours_in(lowest.label), PILE]),
        f"pile of {lowest.kind}s",
        box,
        np.any([obj.whole for obj in members], axis=0),
        np.any([obj.bare for obj in members], axis=0),
        np.zeros(3),
        count=len(members),
    )


def box_about(objects: Sequence[SceneObject], frame: SceneObject) -> SceneObject:
    """``frame`` with the smallest box along its own axes that holds the boxes of all ``objects``."""
    corners: FloatArray = np.concatenate([obj.corners() for obj in objects])
    local = transform_points(invert_rigid(frame.world_from_object), corners)
    low, high = local.min(axis=0), local.max(axis=0)
    middle = frame.world_from_object @ rigid(translation=0.5 * (low + high))
    return replace(frame, world_from_object=middle, extents=high - low)


def head_noun(label: str) -> str:
    """The last word that is not a colour, in lower case, one word for all piles; "" if there is none."""
    words = re.findall(r"[a-z]+", label.lower())
    colours = {*colours_in(label), *SYNONYMS}
    noun = next((word for word in reversed(words) if word not in colours), "")
    return PILE if noun in PILES else noun
