"""The true objects on the table, with the pixels that show them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from gvla2.evaluation.perception.words import PILE, head_noun
from gvla2.geometry.transform import FloatArray, invert_rigid, rigid, transform_points
from gvla2.geometry.views import Observation
from gvla2.planning.colours import colours_in
from gvla2.planning.scene import Scene, SceneObject
from gvla2.robot.solids import Volume
from gvla2.robot.task import Body, Layout, Primitive

SEEN = 20
"""Pixels of all views together below which a thing counts as hidden and need not be found."""

TOUCH = 0.002
"""Metres between things of one pile."""

ALL_OF_IT = 0.9
"""Share of a whole's pixels above which only the part is visible."""

THIN = 0.004
"""Metres below which a side is too thin to be spanned by pixels."""

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
class TrueThing:
    """One thing to find. ``box`` has its pose and extents; ``label`` is "" if the task does not name it.

    ``kind`` is its head noun. ``whole`` and ``bare`` (P,) mark its pixels among those of all views that have a depth
    (see :func:`measured`): with its named parts, and without. ``seen`` (3,) is the share of each side of the box that
    those pixels span: a thing in a holder is partly hidden. ``part`` marks a named part of another; ``count`` is a
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


def true_things(robot: Segmented, observation: Observation, layout: Layout) -> list[TrueThing]:
    """All things and named parts that at least :data:`SEEN` pixels show; if only a part of its whole is visible, they
    are one thing (a knife in its block is its handle).

    Touching bodies of one label are one pile: the pictures cannot tell them apart.
    """
    names, images = robot.true_masks(observation)
    pixels = np.concatenate([image[ok] for image, ok in zip(images, measured(observation), strict=True)])
    points = _points(observation)
    own = {name: pixels == index for index, name in enumerate(names)}
    nothing = np.zeros(len(pixels), dtype=bool)
    bodies = {body.name: body for body in layout.bodies}
    things: list[TrueThing] = []
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
        things.append(TrueThing(box.id, label, kind, box, whole, bare, np.zeros(3), part=bool(part)))
    wholes = {thing.name: int(thing.whole.sum()) for thing in things}
    shown = [
        thing
        for thing in _piled(things)
        if thing.whole.sum() >= SEEN
        and not (thing.part and thing.whole.sum() > ALL_OF_IT * wholes[thing.name.partition("/")[0]])
    ]
    return [replace(thing, seen=_spanned(thing.box, points[thing.whole])) for thing in shown]


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


def _piled(things: Sequence[TrueThing]) -> list[TrueThing]:
    piles: list[list[TrueThing]] = []
    for thing in things:
        near = [pile for pile in piles if any(_one_pile(thing, other) for other in pile)]
        piles = [pile for pile in piles if all(pile is not other for other in near)]
        piles.append([*(other for pile in near for other in pile), thing])
    return [_pile(pile) if len(pile) > 1 else pile[0] for pile in piles]


def _one_pile(one: TrueThing, other: TrueThing) -> bool:
    flat = "region" in (one.box.shape, other.box.shape)
    if one.part or other.part or flat or not one.label or one.label != other.label:
        return False
    a, b, c = (float(side) + TOUCH for side in one.box.extents)
    d, e, f = (float(side) for side in other.box.extents)
    solid = Body("", (Primitive("box", (d, e, f), (0.0, 0.0, 0.0)),), other.box.world_from_object)
    return Volume(one.box.world_from_object, (a, b, c)).meets(solid, other.box.world_from_object)


def _pile(members: Sequence[TrueThing]) -> TrueThing:
    """Several things as one, its box around all of them along the axes of the lowest."""
    lowest = min(members, key=lambda thing: thing.box.bottom)
    box = box_about([thing.box for thing in members], lowest.box)
    return TrueThing(
        f"{lowest.name}+{len(members) - 1}",
        " ".join([*colours_in(lowest.label), PILE]),
        f"pile of {lowest.kind}s",
        box,
        np.any([thing.whole for thing in members], axis=0),
        np.any([thing.bare for thing in members], axis=0),
        np.zeros(3),
        count=len(members),
    )


def box_about(objects: Sequence[SceneObject], frame: SceneObject) -> SceneObject:
    """``frame`` with the smallest box along its own axes that holds the boxes of all ``objects``."""
    corners: FloatArray = np.concatenate([thing.corners() for thing in objects])
    local = transform_points(invert_rigid(frame.world_from_object), corners)
    low, high = local.min(axis=0), local.max(axis=0)
    middle = frame.world_from_object @ rigid(translation=0.5 * (low + high))
    return replace(frame, world_from_object=middle, extents=high - low)
