"""One perceived scene against the true objects: what was found, how well, and what does not exist.

A perceived object's points are projected into the views that it was seen in; perceived and true objects are matched by
the overlap of their pixels.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import binary_closing, binary_dilation
from scipy.optimize import linear_sum_assignment
from scipy.spatial import cKDTree
from skimage import morphology

from gvla2.evaluation.perception_truth import BoolArray, TrueObject, box_about, head_noun, measured
from gvla2.geometry.transform import FloatArray, invert_rigid, transform_points
from gvla2.geometry.views import Observation, View
from gvla2.planning.colours import colours_in
from gvla2.planning.scene import Scene, SceneObject

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

_disk: Callable[[int], BoolArray] = morphology.disk


@dataclass(frozen=True)
class LabelMatch:
    """How a label compares with the true one; None if the true one does not mention it.

    ``colour``: the same colour words. ``noun``: the same head noun, the last word ("mustard bottle" is a bottle).
    ``label``: both.
    """

    label: bool | None = None
    colour: bool | None = None
    noun: bool | None = None

    @classmethod
    def of(cls, true: str, perceived: str) -> LabelMatch:
        """The perceived label against the true one; an empty true label is not judged."""
        colours, wanted = colours_in(true), head_noun(true)
        colour = set(colours) == set(colours_in(perceived)) if colours else None
        noun = wanted == head_noun(perceived) if wanted else None
        judged = [one for one in (colour, noun) if one is not None]
        return cls(all(judged) if judged else None, colour, noun)


@dataclass(frozen=True)
class Match:
    """The perceived match of an object. ``index`` of the object in the scene, -1 for none; ``iou`` in [0, 1], over all
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
    """A false object: ``piece_of`` names the object it is a piece of, "" for a phantom."""

    index: int
    piece_of: str


@dataclass(frozen=True)
class ObjectScore:
    """How well a true object was perceived. If it was not found, only ``match`` is meaningful.

    ``extents_mm`` (3,): errors of the side lengths along the true box's axes (negative: perceived too small); None
    along an axis of which less than :data:`IN_SIGHT` is seen. ``centre_mm``: distance of the boxes' centres along the
    other axes.
    """

    true: TrueObject
    match: Match
    perceived: str = ""
    words: LabelMatch = LabelMatch()
    centre_mm: float | None = None
    extents_mm: tuple[float | None, ...] = (None, None, None)

    @property
    def extent_mm(self) -> float | None:
        """The worst side length's error, not negative."""
        return max((abs(side) for side in self.extents_mm if side is not None), default=None)


@dataclass(frozen=True)
class SceneScore:
    """All true objects of a scene, and the perceived objects that match none of them."""

    truths: tuple[ObjectScore, ...]
    strays: tuple[Stray, ...]

    @property
    def found(self) -> float | None:
        """Share of the objects that were found; None if there was nothing to find."""
        return float(np.mean([one.match.found for one in self.truths])) if self.truths else None


def score(truths: Sequence[TrueObject], scene: Scene, observation: Observation) -> SceneScore:
    """Compare a scene with the true objects of the same observation."""
    masks = object_masks(observation, scene.objects)
    matches = match(truths, scene, masks)
    scores = tuple(_score(obj, one, scene) for obj, one in zip(truths, matches, strict=True))
    return SceneScore(scores, tuple(false_objects(truths, matches, scene, masks)))


def _score(true: TrueObject, one: Match, scene: Scene) -> ObjectScore:
    if not one.found or one.box is None:
        return ObjectScore(true, one)
    label = scene.objects[one.index].label
    judged = true.seen >= IN_SIGHT
    off = true.box.world_from_object[:3, :3].T @ (one.box.centre - true.box.centre)
    centre = 1000 * float(np.linalg.norm(off[judged])) if judged.any() else None
    sides = 1000 * extent_errors(true.box, one.box)
    extents = tuple(float(side) if ok else None for side, ok in zip(sides, judged, strict=True))
    return ObjectScore(true, one, label, LabelMatch.of(true.label, label), centre, extents)


def extent_errors(true: SceneObject, seen: SceneObject) -> FloatArray:
    """(3,) errors of the side lengths along the true box's axes, metres.

    Each true axis is compared with the perceived one that is most parallel to it: the order of two level axes is
    arbitrary.
    """
    along = np.abs(true.world_from_object[:3, :3].T @ seen.world_from_object[:3, :3])
    _, order = linear_sum_assignment(-along)
    return np.asarray(seen.extents[order] - true.extents)


def match(truths: Sequence[TrueObject], scene: Scene, masks: BoolArray) -> list[Match]:
    """One match per object, no object twice, with the largest total overlap. ``masks`` (N, P).

    An object with parts is taken with or without them, and so is an object, whichever overlaps more: an umbrella is an
    umbrella with or without its handle. All pieces of a pile are taken together: how finely it is split is not an
    error.
    """
    objects = scene.objects
    place = {obj.id: k for k, obj in enumerate(objects)}
    families = [[k, *(place[part.id] for part in scene.parts_of(o.id))] for k, o in enumerate(objects)]
    together = np.array([masks[family].any(axis=0) for family in families], dtype=bool).reshape(masks.shape)
    alone, joined = (
        np.maximum(overlaps([t.whole for t in truths], each), overlaps([t.bare for t in truths], each))
        for each in (masks, together)
    )
    best = np.maximum(alone, joined)
    heaps = {k: _pieces(obj, masks) for k, obj in enumerate(truths) if obj.count > 1}
    for heap, pieces in heaps.items():
        whole = float(
            overlaps([truths[heap].whole], np.asarray(masks[pieces].any(axis=0, keepdims=True)))[0, 0]
        )
        if pieces and whole > best[heap].max():
            best[heap, pieces[0]] = whole  # stands for all of them
        else:
            pieces.clear()
    matches = [Match(-1, 0.0, None) for _ in truths]
    for row, column in zip(*linear_sum_assignment(-best), strict=True):
        if best[row, column] <= 0:
            continue
        family = families[column] if joined[row, column] > alone[row, column] else [column]
        family = heaps.get(int(row)) or family
        box = box_about([objects[k] for k in family], objects[column])
        matches[row] = Match(int(column), float(best[row, column]), box)
    return matches


def false_objects(
    truths: Sequence[TrueObject], matches: Sequence[Match], scene: Scene, masks: BoolArray
) -> list[Stray]:
    """The objects that no found object explains.

    Parts of a matched object on its object are not errors, nor are pieces of a pile.
    """
    taken = {one.index: obj for one, obj in zip(matches, truths, strict=True) if one.found}
    place = {obj.id: k for k, obj in enumerate(scene.objects)}
    found = []
    for k, obj in enumerate(scene.objects):
        if k in taken:
            continue
        shares = [float((masks[k] & true.whole).sum()) / max(1, int(masks[k].sum())) for true in truths]
        ancestor = _ancestor(obj, scene, place, taken)
        if ancestor is not None and any(
            s > OF_IT and t is ancestor for s, t in zip(shares, truths, strict=True)
        ):
            continue
        if any(s > OF_IT and t.count > 1 for s, t in zip(shares, truths, strict=True)):
            continue
        most = int(np.argmax(shares)) if shares else -1
        found.append(Stray(k, truths[most].name if most >= 0 and shares[most] > OF_IT else ""))
    return found


def overlaps(one: Sequence[BoolArray], other: BoolArray) -> FloatArray:
    """(T, N) intersection over union of masks (P,) with masks (N, P); 0 for two empty ones."""
    a = np.array(one, dtype=np.float32).reshape(len(one), other.shape[1])
    b = other.astype(np.float32)
    both = (a @ b.T).astype(np.float64)
    either = a.sum(axis=1, dtype=np.float64)[:, None] + b.sum(axis=1, dtype=np.float64)[None] - both
    return np.asarray(np.divide(both, either, out=np.zeros_like(both), where=either > 0))


def _pieces(true: TrueObject, masks: BoolArray) -> list[int]:
    """The objects most of whose pixels are the object's, the largest first."""
    sizes = masks.sum(axis=1)
    on = (masks & true.whole).sum(axis=1)
    return [int(k) for k in np.argsort(-sizes, kind="stable") if sizes[k] and on[k] > OF_IT * sizes[k]]


def _ancestor(
    obj: SceneObject, scene: Scene, place: dict[str, int], taken: dict[int, TrueObject]
) -> TrueObject | None:
    """The object that an object's nearest matched ancestor is."""
    for _ in scene.objects:
        if obj.parent not in place:
            return None
        if (k := place[obj.parent]) in taken:
            return taken[k]
        obj = scene.objects[k]
    return None


def object_masks(observation: Observation, objects: Sequence[SceneObject]) -> BoolArray:
    """(N, P) pixels of each object, among those of all views that have a depth (see :func:`measured`).

    A perceiver keeps some thousand points of an object, fewer than its pixels, so gaps as wide as the points' own
    spacing are closed; where points are sparse, nearby pixels in the object's box count as its own too, unless they are
    another's.
    """
    rows: list[list[BoolArray]] = [[] for _ in objects]
    for view, ok in zip(observation.views, measured(observation), strict=True):
        spots = [_projected(view, obj.points) for obj in objects]
        closed = [_closed(view, mask) for mask in spots]
        for k, mask in enumerate(_filled(view, objects, spots, closed)):
            rows[k].append(mask[ok])
    total = sum(int(ok.sum()) for ok in measured(observation))
    return np.array([np.concatenate(row) for row in rows], dtype=bool).reshape(len(objects), total)


def _projected(view: View, points: FloatArray) -> BoolArray:
    """(H, W) the pixels on which world points (N, 3) fall that are in sight."""
    mask = np.zeros(view.image.shape[:2], dtype=bool)
    if not len(points):
        return mask
    uv, depth = view.camera.project(points)
    inside = view.camera.inside(uv)
    columns, rows = np.floor(uv[inside]).astype(int).T
    if view.depth is not None:
        with np.errstate(invalid="ignore"):
            seen = np.abs(np.asarray(depth)[inside] - view.depth[rows, columns]) <= SAME_SURFACE
        rows, columns = rows[seen], columns[seen]
    mask[rows, columns] = True
    return _off_robot(view, mask)


def _closed(view: View, mask: BoolArray) -> BoolArray:
    reach = _spacing(mask)
    # Padded, so that what touches the picture's border is not eaten from there.
    whole = binary_closing(np.pad(mask, reach), _disk(reach))[reach:-reach, reach:-reach]
    return _off_robot(view, np.asarray(whole))


def _filled(
    view: View, objects: Sequence[SceneObject], spots: Sequence[BoolArray], closed: Sequence[BoolArray]
) -> list[BoolArray]:
    """The closed masks, completed around sparse points."""
    sparse = [_spacing(mask) > 1 for mask in spots]
    if view.depth is None or not any(sparse):
        return list(closed)
    points = view.points()
    filled = []
    for k, (obj, mask) in enumerate(zip(objects, closed, strict=True)):
        if sparse[k]:
            near = binary_dilation(mask, _disk(2 * _spacing(spots[k]))) & ~mask
            near[near] = _in_box(obj, points[near])
            others = [other for j, other in enumerate(closed) if j != k]
            mask = mask | _off_robot(view, near & ~np.any([np.zeros_like(near), *others], axis=0))
        filled.append(mask)
    return filled


def _in_box(obj: SceneObject, points: FloatArray) -> BoolArray:
    """(N,) bool: world points (N, 3) in the object's box and not on what it stands on; NaN is nowhere."""
    local = transform_points(invert_rigid(obj.world_from_object), points)
    inside = (np.abs(local) <= 0.5 * obj.extents + MARGIN).all(axis=1)
    if obj.top - obj.bottom > 2 * MARGIN:
        inside &= points[:, 2] > obj.bottom + MARGIN
    return np.asarray(inside)


def _off_robot(view: View, mask: BoolArray) -> BoolArray:
    return mask if view.robot_mask is None else np.asarray(mask & ~view.robot_mask)


def _spacing(mask: BoolArray) -> int:
    """The typical spacing of a mask's pixels; at least 1."""
    spots = np.argwhere(mask)
    if len(spots) < 2:
        return 1
    nearest = np.asarray(cKDTree(spots).query(spots, k=2)[0])[:, 1]
    return int(np.clip(np.ceil(np.percentile(nearest, 90)), 1, WIDEST_GAP))
