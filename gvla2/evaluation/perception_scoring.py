"""A perceived scene against the true objects that the pixels show: found, named, errors of the boxes, false objects."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from gvla2.geometry.transform import FloatArray, invert_rigid, rigid, transform_points
from gvla2.geometry.views import Observation
from gvla2.planning.colours import SYNONYMS, colours_in
from gvla2.planning.scene import Scene, SceneObject
from gvla2.robot.task import Layout

SEEN = 20
"""Pixels of all views together below which an object counts as hidden and need not be found."""
THIN = 0.004
"""Metres below which a side is too thin to be spanned by pixels."""
IN_SIGHT = 0.8
"""Share of each side that pixels must span for the box to be judged: the length of a knife in a block is hidden."""
ALL_OF_IT = 0.9
"""Share of a body's pixels above which only its part is visible: a knife in its block is its handle."""
MARGIN = 0.01
"""Metres around a box within which a centre counts as in it."""
APART = 1e3
"""Metres: the cost of a pair that cannot be one object."""


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
    """One object or named part to find. ``box`` has its pose and extents; ``label`` is "" if the task does not name it.

    ``in_sight`` says whether its pixels span all sides of the box: an object in a holder is partly hidden.
    """

    name: str
    label: str
    box: SceneObject
    in_sight: bool


@dataclass(frozen=True)
class ObjectScore:
    """How well a true object was perceived: ``index`` of its match in the scene, -1 for none.

    ``named`` says whether the label is right (None: not judged). ``centre_mm`` is the distance of the boxes' centres,
    ``side_mm`` the error of the worst side length; both only of an object that is all in sight.
    """

    true: TrueObject
    index: int = -1
    perceived: str = ""
    named: bool | None = None
    centre_mm: float | None = None
    side_mm: float | None = None

    def summary(self) -> dict[str, Any]:
        """The numbers by name, for a row of results."""
        own = {name: getattr(self, name) for name in ("perceived", "named", "centre_mm", "side_mm")}
        return {"object": self.true.name, "true": self.true.label, "found": self.index >= 0, **own}


def true_objects(robot: Segmented, observation: Observation, layout: Layout) -> list[TrueObject]:
    """All objects that at least :data:`SEEN` pixels with a depth show, and their named parts, unless nothing else is
    visible of the object.
    """
    names, images = robot.true_masks(observation)
    views = [
        (view.points(), image)
        for view, image in zip(observation.views, images, strict=True)
        if view.depth is not None
    ]
    labels = {body.name: body.label for body in layout.bodies}
    objects: list[TrueObject] = []
    sizes: dict[str, int] = {}
    for box in robot.true_scene().objects:
        body, _, part = box.id.partition("/")
        own = [k for k, name in enumerate(names) if name == box.id or name.startswith(f"{box.id}/")]
        points = np.concatenate([found[np.isin(image, own)] for found, image in views])
        points = points[np.isfinite(points).all(axis=1)]
        sizes[box.id] = len(points)
        if len(points) >= SEEN and not (part and len(points) > ALL_OF_IT * sizes[body]):
            in_sight = bool((_spanned(box, points) >= IN_SIGHT).all())
            objects.append(TrueObject(box.id, part or labels[body], box, in_sight))
    return objects


def _spanned(box: SceneObject, points: FloatArray) -> FloatArray:
    """(3,) share of the box's sides that points (N, 3) span; 1 for a side thinner than the depth's accuracy."""
    half = 0.5 * box.extents
    local = transform_points(invert_rigid(box.world_from_object), points)
    spanned = np.ptp(np.clip(local, -half, half), axis=0)
    return np.where(box.extents < THIN, 1.0, spanned / np.maximum(box.extents, THIN))


def score(truths: Sequence[TrueObject], scene: Scene) -> tuple[list[ObjectScore], list[int]]:
    """The true objects with their matches, and the indices of perceived objects that do not exist.

    Each true object has at most one match, the nearest by the boxes' centres, where one of them lies in the other's
    box. A perceived object that holds several true ones of one label (a tower of bricks) stands for all of them; their
    boxes are not judged. A false object's centre lies in no true box.
    """
    true_centres = np.array([true.box.centre for true in truths]).reshape(-1, 3)
    centres = np.array([obj.centre for obj in scene.objects]).reshape(-1, 3)
    shape = len(truths), len(centres)
    in_true = np.array([_holds(true.box, centres) for true in truths], bool).reshape(shape)
    holding = np.array([_holds(obj, true_centres) for obj in scene.objects], bool).reshape(shape[::-1]).T
    distances = np.linalg.norm(true_centres[:, None] - centres[None], axis=2)
    cost = np.where(in_true | holding, distances, APART)
    rows, columns = linear_sum_assignment(cost)
    matches = {int(r): int(c) for r, c in zip(rows, columns, strict=True) if cost[r, c] < APART}
    scores = []
    for row, true in enumerate(truths):
        alike = np.array([other.label == true.label for other in truths])
        pile = [int(k) for k in np.flatnonzero(holding[row]) if (holding[:, k] & alike).sum() > 1]
        if pile:
            scores.append(ObjectScore(true, pile[0], scene.objects[pile[0]].label))
        elif row in matches:
            scores.append(_judged(true, matches[row], scene))
        else:
            scores.append(ObjectScore(true))
    real = {one.index for one in scores} | set(np.flatnonzero(in_true.any(axis=0)).tolist())
    return scores, [k for k in range(len(centres)) if k not in real]


def _holds(box: SceneObject, points: FloatArray) -> NDArray[np.bool_]:
    """(N,) whether points (N, 3) lie in the box, or close to it."""
    local = transform_points(invert_rigid(box.world_from_object), points)
    return np.asarray((np.abs(local) <= 0.5 * box.extents + MARGIN).all(axis=1))


def _judged(true: TrueObject, index: int, scene: Scene) -> ObjectScore:
    """The score of a pair; the perceived object is measured with or without its parts, whichever is nearer."""
    seen = scene.objects[index]
    named = label_right(true.label, seen.label)
    if not true.in_sight:
        return ObjectScore(true, index, seen.label, named)
    errors = [
        (1000 * float(np.linalg.norm(box.centre - true.box.centre)), box)
        for box in (seen, _whole(seen, scene))
    ]
    centre, box = min(errors, key=lambda error: error[0])
    return ObjectScore(
        true, index, seen.label, named, centre, 1000 * float(np.abs(side_errors(true.box, box)).max())
    )


def _whole(obj: SceneObject, scene: Scene) -> SceneObject:
    """The object with the smallest box along its own axes that holds its parts too."""
    family = [obj, *(other for other in scene.objects if other.parent == obj.id)]
    local = transform_points(
        invert_rigid(obj.world_from_object), np.concatenate([one.corners() for one in family])
    )
    low, high = local.min(axis=0), local.max(axis=0)
    middle = obj.world_from_object @ rigid(translation=0.5 * (low + high))
    return replace(obj, world_from_object=middle, extents=high - low)


def label_right(true: str, perceived: str) -> bool | None:
    """Whether a label's colours and its head noun, the last word, are right: "mustard bottle" is a bottle.

    None where the true label has neither.
    """
    judged = []
    if colours := colours_in(true):
        judged.append(set(colours) == set(colours_in(perceived)))
    if noun := _head_noun(true):
        judged.append(noun == _head_noun(perceived))
    return all(judged) if judged else None


def _head_noun(label: str) -> str:
    """The last word that is not a colour, in lower case; "" if there is none."""
    colours = {*colours_in(label), *SYNONYMS}
    return next((w for w in reversed(re.findall(r"[a-z]+", label.lower())) if w not in colours), "")


def side_errors(true: SceneObject, seen: SceneObject) -> FloatArray:
    """(3,) errors of the side lengths along the true box's axes, metres.

    Each true axis is compared with the perceived one that is most parallel to it: the order of two level axes is
    arbitrary.
    """
    along = np.abs(true.world_from_object[:3, :3].T @ seen.world_from_object[:3, :3])
    _, order = linear_sum_assignment(-along)
    return np.asarray(seen.extents[order] - true.extents)
