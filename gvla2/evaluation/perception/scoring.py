"""One perceived scene against the truth: what was found, how well, and what does not exist."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment

from gvla2.evaluation.perception.masks import object_masks
from gvla2.evaluation.perception.matching import Match, Stray, false_objects, match
from gvla2.evaluation.perception.truth import TrueThing
from gvla2.evaluation.perception.words import Words, compare
from gvla2.geometry.transform import FloatArray
from gvla2.geometry.views import Observation
from gvla2.planning.scene import Scene, SceneObject

IN_SIGHT = 0.8
"""Share of a side that pixels must span for its length to be judged: the length of a knife in a block is hidden."""

_UNJUDGED = Words(None, None, None)


@dataclass(frozen=True)
class ThingScore:
    """How well a true thing was perceived. If it was not found, only ``match`` is meaningful.

    ``extents_mm`` (3,): errors of the side lengths along the true box's axes (negative: perceived too small); None
    along an axis of which less than :data:`IN_SIGHT` is seen. ``centre_mm``: distance of the boxes' centres along the
    other axes.
    """

    thing: TrueThing
    match: Match
    perceived: str = ""
    words: Words = _UNJUDGED
    centre_mm: float | None = None
    extents_mm: tuple[float | None, ...] = (None, None, None)

    @property
    def extent_mm(self) -> float | None:
        """The worst side length's error, not negative."""
        return max((abs(side) for side in self.extents_mm if side is not None), default=None)


@dataclass(frozen=True)
class SceneScore:
    """All true things of a scene, and the perceived objects that match none of them."""

    things: tuple[ThingScore, ...]
    strays: tuple[Stray, ...]

    @property
    def found(self) -> float | None:
        """Share of the things that were found; None if there was nothing to find."""
        return float(np.mean([one.match.found for one in self.things])) if self.things else None


def score(things: Sequence[TrueThing], scene: Scene, observation: Observation) -> SceneScore:
    """Compare a scene with the true things of the same observation."""
    masks = object_masks(observation, scene.objects)
    matches = match(things, scene, masks)
    scores = tuple(_score(thing, one, scene) for thing, one in zip(things, matches, strict=True))
    return SceneScore(scores, tuple(false_objects(things, matches, scene, masks)))


def _score(thing: TrueThing, one: Match, scene: Scene) -> ThingScore:
    if not one.found or one.box is None:
        return ThingScore(thing, one)
    label = scene.objects[one.index].label
    judged = thing.seen >= IN_SIGHT
    off = thing.box.world_from_object[:3, :3].T @ (one.box.centre - thing.box.centre)
    centre = 1000 * float(np.linalg.norm(off[judged])) if judged.any() else None
    sides = 1000 * extent_errors(thing.box, one.box)
    extents = tuple(float(side) if ok else None for side, ok in zip(sides, judged, strict=True))
    return ThingScore(thing, one, label, compare(thing.label, label), centre, extents)


def extent_errors(true: SceneObject, seen: SceneObject) -> FloatArray:
    """(3,) errors of the side lengths along the true box's axes, metres.

    Each true axis is compared with the perceived one that is most parallel to it: the order of two level axes is
    arbitrary.
    """
    along = np.abs(true.world_from_object[:3, :3].T @ seen.world_from_object[:3, :3])
    _, order = linear_sum_assignment(-along)
    return np.asarray(seen.extents[order] - true.extents)
