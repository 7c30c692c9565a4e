"""Which perceived object is which true thing, by the overlap of their pixels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment

from gvla2.evaluation.perception.truth import BoolArray, TrueThing, box_about
from gvla2.geometry.transform import FloatArray
from gvla2.planning.scene import Scene, SceneObject

FOUND = 0.5
"""Intersection over union above which a thing is found."""

OF_IT = 0.5
"""Share of an object's pixels on a thing above which it is a piece of that thing."""


@dataclass(frozen=True)
class Match:
    """The perceived match of a thing. ``index`` of the object in the scene, -1 for none; ``iou`` in [0, 1], over all
    views together; ``box`` is the object, with its parts if they made it match.
    """

    index: int
    iou: float
    box: SceneObject | None

    @property
    def found(self) -> bool:
        """Whether the overlap is enough."""
        return self.iou > FOUND


@dataclass(frozen=True)
class Stray:
    """A false object: ``piece_of`` names the thing it is a piece of, "" for a phantom."""

    index: int
    piece_of: str


def match(things: Sequence[TrueThing], scene: Scene, masks: BoolArray) -> list[Match]:
    """One match per thing, no object twice, with the largest total overlap. ``masks`` (N, P).

    An object with parts is taken with or without them, and so is a thing, whichever overlaps more: an umbrella is an
    umbrella with or without its handle. All pieces of a pile are taken together: how finely it is split is not an
    error.
    """
    objects = scene.objects
    place = {thing.id: k for k, thing in enumerate(objects)}
    families = [[k, *(place[part.id] for part in scene.parts_of(o.id))] for k, o in enumerate(objects)]
    together = np.array([masks[family].any(axis=0) for family in families], dtype=bool).reshape(masks.shape)
    alone, joined = (
        np.maximum(overlaps([t.whole for t in things], each), overlaps([t.bare for t in things], each))
        for each in (masks, together)
    )
    best = np.maximum(alone, joined)
    heaps = {k: _pieces(thing, masks) for k, thing in enumerate(things) if thing.count > 1}
    for heap, pieces in heaps.items():
        whole = float(
            overlaps([things[heap].whole], np.asarray(masks[pieces].any(axis=0, keepdims=True)))[0, 0]
        )
        if pieces and whole > best[heap].max():
            best[heap, pieces[0]] = whole  # stands for all of them
        else:
            pieces.clear()
    matches = [Match(-1, 0.0, None) for _ in things]
    for row, column in zip(*linear_sum_assignment(-best), strict=True):
        if best[row, column] <= 0:
            continue
        family = families[column] if joined[row, column] > alone[row, column] else [column]
        family = heaps.get(int(row)) or family
        box = box_about([objects[k] for k in family], objects[column])
        matches[row] = Match(int(column), float(best[row, column]), box)
    return matches


def false_objects(
    things: Sequence[TrueThing], matches: Sequence[Match], scene: Scene, masks: BoolArray
) -> list[Stray]:
    """The objects that no found thing explains.

    Parts of a matched object on its thing are not errors, nor are pieces of a pile.
    """
    taken = {one.index: thing for one, thing in zip(matches, things, strict=True) if one.found}
    place = {thing.id: k for k, thing in enumerate(scene.objects)}
    found = []
    for k, thing in enumerate(scene.objects):
        if k in taken:
            continue
        shares = [float((masks[k] & true.whole).sum()) / max(1, int(masks[k].sum())) for true in things]
        ancestor = _ancestor(thing, scene, place, taken)
        if ancestor is not None and any(
            s > OF_IT and t is ancestor for s, t in zip(shares, things, strict=True)
        ):
            continue
        if any(s > OF_IT and t.count > 1 for s, t in zip(shares, things, strict=True)):
            continue
        most = int(np.argmax(shares)) if shares else -1
        found.append(Stray(k, things[most].name if most >= 0 and shares[most] > OF_IT else ""))
    return found


def overlaps(one: Sequence[BoolArray], other: BoolArray) -> FloatArray:
    """(T, N) intersection over union of masks (P,) with masks (N, P); 0 for two empty ones."""
    a = np.array(one, dtype=np.float32).reshape(len(one), other.shape[1])
    b = other.astype(np.float32)
    both = (a @ b.T).astype(np.float64)
    either = a.sum(axis=1, dtype=np.float64)[:, None] + b.sum(axis=1, dtype=np.float64)[None] - both
    return np.asarray(np.divide(both, either, out=np.zeros_like(both), where=either > 0))


def _pieces(thing: TrueThing, masks: BoolArray) -> list[int]:
    """The objects most of whose pixels are the thing's, the largest first."""
    sizes = masks.sum(axis=1)
    on = (masks & thing.whole).sum(axis=1)
    return [int(k) for k in np.argsort(-sizes, kind="stable") if sizes[k] and on[k] > OF_IT * sizes[k]]


def _ancestor(
    thing: SceneObject, scene: Scene, place: dict[str, int], taken: dict[int, TrueThing]
) -> TrueThing | None:
    """The thing that an object's nearest matched ancestor is."""
    for _ in scene.objects:
        if thing.parent not in place:
            return None
        if (k := place[thing.parent]) in taken:
            return taken[k]
        thing = scene.objects[k]
    return None
