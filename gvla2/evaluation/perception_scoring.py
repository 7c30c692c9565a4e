"""A perceived scene against the true objects that the pixels show: what was found, how well, and what does not exist.

A perceived object's points are projected into the views that it was seen in; perceived and true objects are matched by
the overlap of their pixels. Masks (P,) are over the pixels of all views that have a depth, see :func:`measured`.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_closing, binary_dilation
from scipy.optimize import linear_sum_assignment
from scipy.spatial import cKDTree
from skimage import morphology

from gvla2.geometry.transform import FloatArray, invert_rigid, rigid, transform_points
from gvla2.geometry.views import Observation, View
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
FOUND = 0.5
"""Intersection over union above which an object is found."""
OF_IT = 0.5
"""Share of a perceived object's pixels on a true one above which it is a piece of that one."""
IN_SIGHT = 0.8
"""Share of a side that pixels must span for its length to be judged: the length of a knife in a block is hidden."""
SAME_SURFACE = 0.012
"""Metres between a point's depth and the picture's within which the point is seen there: noisy depth included."""
WIDEST_GAP = 8
"""Pixels between projected points beyond which they are not joined."""
MARGIN = 0.002
"""Metres about a box within which a pixel counts as in it, and above its foot from which it is not on the table."""

BoolArray = NDArray[np.bool_]
_disk: Callable[[int], BoolArray] = morphology.disk


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

    ``mask`` (P,) marks its pixels, those of its named parts included. ``seen`` (3,) is the share of each side of the
    box that those pixels span: an object in a holder is partly hidden. ``part`` marks a named part of another;
    ``bodies`` is a pile's number of bodies.
    """

    name: str
    label: str
    box: SceneObject
    mask: BoolArray
    seen: FloatArray
    part: bool = False
    bodies: int = 1


@dataclass(frozen=True)
class ObjectScore:
    """How well a true object was perceived: ``index`` of its match in the scene, -1 for none; ``iou`` in [0, 1].

    Of an object that was found, ``label`` and ``colour`` say whether the words are right (None: not judged),
    ``extents_mm`` (3,) how much longer the sides along the true box's axes were perceived, and ``centre_mm`` the
    distance of the boxes' centres; axes that are seen by less than :data:`IN_SIGHT` do not count.
    """

    true: TrueObject
    index: int = -1
    iou: float = 0.0
    perceived: str = ""
    label: bool | None = None
    colour: bool | None = None
    centre_mm: float | None = None
    extents_mm: tuple[float | None, ...] = (None, None, None)

    @property
    def found(self) -> bool:
        """Whether the overlap is enough."""
        return self.iou > FOUND

    @property
    def extent_mm(self) -> float | None:
        """The worst side length's error, not negative."""
        return max((abs(side) for side in self.extents_mm if side is not None), default=None)


@dataclass(frozen=True)
class SceneScore:
    """All true objects of a scene, and the false ones: perceived, with the true object each is a piece of, or ""."""

    objects: tuple[ObjectScore, ...]
    false: tuple[tuple[int, str], ...]


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
    valid = measured(observation)
    pixels = np.concatenate([image[ok] for image, ok in zip(images, valid, strict=True)])
    points = np.concatenate(
        [
            np.full((int(ok.sum()), 3), np.nan) if view.depth is None else view.points()[ok]
            for view, ok in zip(observation.views, valid, strict=True)
        ]
    )
    labels = {body.name: body.label for body in layout.bodies}
    objects: list[TrueObject] = []
    for box in robot.true_scene().objects:
        body, _, part = box.id.partition("/")
        own = [k for k, name in enumerate(names) if name == box.id or name.startswith(f"{box.id}/")]
        mask = np.isin(pixels, own)
        objects.append(TrueObject(box.id, part or labels[body], box, mask, np.zeros(3), bool(part)))
    sizes = {obj.name: int(obj.mask.sum()) for obj in objects}
    return [
        replace(obj, seen=_spanned(obj.box, points[obj.mask]))
        for obj in _piled(objects)
        if obj.mask.sum() >= SEEN
        and not (obj.part and obj.mask.sum() > ALL_OF_IT * sizes[obj.name.partition("/")[0]])
    ]


def _spanned(box: SceneObject, points: FloatArray) -> FloatArray:
    """(3,) share of the box's sides that points (N, 3) span; 1 for a side thinner than the depth's accuracy."""
    points = points[np.isfinite(points).all(axis=1)]
    if not len(points):
        return np.zeros(3)
    half = 0.5 * box.extents
    spanned = np.ptp(
        np.clip(transform_points(invert_rigid(box.world_from_object), points), -half, half), axis=0
    )
    return np.where(box.extents < THIN, 1.0, spanned / np.maximum(box.extents, THIN))


def _piled(objects: Sequence[TrueObject]) -> list[TrueObject]:
    """The objects, those of a pile as one, its box around all of them along the axes of the lowest."""
    piles: list[list[TrueObject]] = []
    for obj in objects:
        near = [pile for pile in piles if any(_touch(obj, other) for other in pile)]
        piles = [pile for pile in piles if all(pile is not other for other in near)]
        piles.append([*(other for pile in near for other in pile), obj])
    made = []
    for pile in piles:
        lowest = min(pile, key=lambda obj: obj.box.bottom)
        name = lowest.name if len(pile) == 1 else f"{lowest.name}+{len(pile) - 1}"
        box, mask = (
            box_about([obj.box for obj in pile], lowest.box),
            np.any([obj.mask for obj in pile], axis=0),
        )
        made.append(replace(lowest, name=name, box=box, mask=mask, bodies=len(pile)))
    return made


def _touch(one: TrueObject, other: TrueObject) -> bool:
    """Whether two objects of one label touch; named parts and flat regions are no piles."""
    flat = "region" in (one.box.shape, other.box.shape)
    if one.part or other.part or flat or not one.label or one.label != other.label:
        return False
    a, b, c = (float(side) + TOUCH for side in one.box.extents)
    d, e, f = map(float, other.box.extents)
    solid = Body("", (Primitive("box", (d, e, f), (0.0, 0.0, 0.0)),), other.box.world_from_object)
    return Volume(one.box.world_from_object, (a, b, c)).meets(solid, other.box.world_from_object)


def box_about(objects: Sequence[SceneObject], frame: SceneObject) -> SceneObject:
    """``frame`` with the smallest box along its own axes that holds the boxes of all ``objects``."""
    corners: FloatArray = np.concatenate([obj.corners() for obj in objects])
    local = transform_points(invert_rigid(frame.world_from_object), corners)
    low, high = local.min(axis=0), local.max(axis=0)
    middle = frame.world_from_object @ rigid(translation=0.5 * (low + high))
    return replace(frame, world_from_object=middle, extents=high - low)


def score(truths: Sequence[TrueObject], scene: Scene, observation: Observation) -> SceneScore:
    """Compare a scene with the true objects of the same observation.

    Each true object has one match, none is matched twice, with the largest total overlap. A perceived object counts
    with or without its parts, whichever overlaps more. Pieces of a pile are taken together: how finely it is split is
    no error, nor are parts of a matched object on that object.
    """
    objects, masks = scene.objects, object_masks(observation, scene.objects)
    place = {obj.id: k for k, obj in enumerate(objects)}
    above = [list(_ancestors(k, scene, place)) for k in range(len(objects))]
    families = [[j for j in range(len(objects)) if j == k or k in above[j]] for k in range(len(objects))]
    joined = np.array([masks[f].any(axis=0) for f in families], dtype=bool).reshape(masks.shape)
    trues = np.array([true.mask for true in truths], dtype=bool).reshape(len(truths), masks.shape[1])
    alone, together = overlaps(trues, masks), overlaps(trues, joined)
    best = np.maximum(alone, together)
    on = (trues.astype(np.float32) @ masks.T.astype(np.float32)) / np.maximum(1, masks.sum(axis=1))  # (T, N)
    piles: dict[int, list[int]] = {}
    for row in [row for row, true in enumerate(truths) if true.bodies > 1]:
        pieces = sorted(np.flatnonzero(on[row] > OF_IT).tolist(), key=lambda k: -int(masks[k].sum()))
        union = overlaps(trues[[row]], np.any(masks[pieces], axis=0, keepdims=True))[0, 0]
        if pieces and union > best[row].max():
            best[row, pieces[0]], piles[row] = union, pieces  # the largest stands for all of them
    matches: dict[int, int] = {}
    scores = [ObjectScore(true) for true in truths]
    rows, columns = linear_sum_assignment(-best)
    for row, column in zip(rows.tolist(), columns.tolist(), strict=True):
        if best[row, column] > FOUND:
            matches[column] = row
            family = families[column] if together[row, column] > alone[row, column] else [column]
            box = box_about([objects[k] for k in piles.get(row) or family], objects[column])
            scores[row] = _score(truths[row], column, float(best[row, column]), box)
        elif best[row, column] > 0:
            scores[row] = ObjectScore(truths[row], column, float(best[row, column]))
    false = []
    for k in set(range(len(objects))) - matches.keys():
        owners = np.flatnonzero(on[:, k] > OF_IT).tolist()
        a_part = any(a in matches and matches[a] in owners for a in above[k])
        if not a_part and not any(truths[row].bodies > 1 for row in owners):
            false.append((k, truths[int(np.argmax(on[:, k]))].name if len(owners) else ""))
    return SceneScore(tuple(scores), tuple(false))


def _score(true: TrueObject, index: int, iou: float, box: SceneObject) -> ObjectScore:
    judged = true.seen >= IN_SIGHT
    off = true.box.world_from_object[:3, :3].T @ (box.centre - true.box.centre)
    centre = 1000 * float(np.linalg.norm(off[judged])) if judged.any() else None
    sides = 1000 * extent_errors(true.box, box)
    extents = tuple(float(side) if ok else None for side, ok in zip(sides, judged, strict=True))
    label, colour = judged_label(true.label, box.label)
    if true.bodies > 1:  # whether many are a heap, a tower or a row is a matter of taste
        label = colour
    return ObjectScore(true, index, iou, box.label, label, colour, centre, extents)


def judged_label(true: str, perceived: str) -> tuple[bool | None, bool | None]:
    """Whether a label and its colour words are right; None where the true label does not mention them.

    A label is right when its colours and its head noun, the last word, are ("mustard bottle" is a bottle).
    """
    colours, noun = colours_in(true), _head_noun(true)
    colour = set(colours) == set(colours_in(perceived)) if colours else None
    named = noun == _head_noun(perceived) if noun else None
    judged = [one for one in (colour, named) if one is not None]
    return (all(judged) if judged else None), colour


def _head_noun(label: str) -> str:
    """The last word that is not a colour, in lower case; "" if there is none."""
    colours = {*colours_in(label), *SYNONYMS}
    return next((w for w in reversed(re.findall(r"[a-z]+", label.lower())) if w not in colours), "")


def _ancestors(index: int, scene: Scene, place: dict[str, int]) -> Iterator[int]:
    for _ in scene.objects:
        if (parent := scene.objects[index].parent) not in place:
            return
        yield (index := place[parent])


def extent_errors(true: SceneObject, seen: SceneObject) -> FloatArray:
    """(3,) errors of the side lengths along the true box's axes, metres.

    Each true axis is compared with the perceived one that is most parallel to it: the order of two level axes is
    arbitrary.
    """
    along = np.abs(true.world_from_object[:3, :3].T @ seen.world_from_object[:3, :3])
    _, order = linear_sum_assignment(-along)
    return np.asarray(seen.extents[order] - true.extents)


def overlaps(one: BoolArray, other: BoolArray) -> FloatArray:
    """(T, N) intersection over union of masks (T, P) with masks (N, P); 0 for two empty ones."""
    both = (one.astype(np.float32) @ other.T.astype(np.float32)).astype(np.float64)
    either = one.sum(axis=1)[:, None] + other.sum(axis=1)[None] - both
    return np.asarray(np.divide(both, either, out=np.zeros_like(both), where=either > 0))


def object_masks(observation: Observation, objects: Sequence[SceneObject]) -> BoolArray:
    """(N, P) pixels of each object, among those of all views that have a depth (see :func:`measured`).

    A perceiver keeps some thousand points of an object, fewer than its pixels, so gaps as wide as the points' own
    spacing are closed; where points are sparse, pixels nearby that lie in the object's box count too.
    """
    rows: list[list[BoolArray]] = [[] for _ in objects]
    valid = measured(observation)
    for view, ok in zip(observation.views, valid, strict=True):
        points = None if view.depth is None else view.points()
        for row, obj in zip(rows, objects, strict=True):
            row.append(_mask(view, obj, points)[ok])
    total = sum(int(ok.sum()) for ok in valid)
    return np.array([np.concatenate(row) for row in rows], dtype=bool).reshape(len(objects), total)


def _mask(view: View, obj: SceneObject, measured_points: FloatArray | None) -> BoolArray:
    """(H, W) the pixels that an object's points cover where they are in sight, without the robot's.

    ``measured_points`` (H, W, 3) are the view's own, world.
    """
    mask = np.zeros(view.image.shape[:2], dtype=bool)
    if not len(obj.points):
        return mask
    uv, depth = view.camera.project(obj.points)
    inside = view.camera.inside(uv)
    columns, rows = np.floor(uv[inside]).astype(int).T
    if view.depth is not None:
        with np.errstate(invalid="ignore"):
            seen = np.abs(np.asarray(depth)[inside] - view.depth[rows, columns]) <= SAME_SURFACE
        rows, columns = rows[seen], columns[seen]
    mask[rows, columns] = True
    reach = _spacing(mask)
    # Padded, so that what touches the picture's border is not eaten from there.
    mask = binary_closing(np.pad(mask, reach), _disk(reach))[reach:-reach, reach:-reach]
    if reach > 1 and measured_points is not None:
        near = binary_dilation(mask, _disk(2 * reach)) & ~mask
        near[near] = _in_box(obj, measured_points[near])
        mask = mask | near
    return mask if view.robot_mask is None else np.asarray(mask & ~view.robot_mask)


def _in_box(obj: SceneObject, points: FloatArray) -> BoolArray:
    """(N,) bool: world points (N, 3) in the object's box and not on what it stands on; NaN is nowhere."""
    local = transform_points(invert_rigid(obj.world_from_object), points)
    inside = (np.abs(local) <= 0.5 * obj.extents + MARGIN).all(axis=1)
    flat = obj.top - obj.bottom <= 2 * MARGIN
    return np.asarray(inside & (flat | (points[:, 2] > obj.bottom + MARGIN)))


def _spacing(mask: BoolArray) -> int:
    """The typical spacing of a mask's pixels; at least 1."""
    spots = np.argwhere(mask)
    if len(spots) < 2:
        return 1
    nearest = np.asarray(cKDTree(spots).query(spots, k=2)[0])[:, 1]
    return int(np.clip(np.ceil(np.percentile(nearest, 90)), 1, WIDEST_GAP))
