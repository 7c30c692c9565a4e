"""Connected components in 3D above the table, and masks of several pictures fused into objects.

Two masks show one object if they share their points in 3D.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import convolve
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from gvla2.geometry.transform import FloatArray
from gvla2.perception.frames import BoolArray, ViewFrame
from gvla2.perception.objects import object_of
from gvla2.perception.registration import TablePlane
from gvla2.planning.scene import SceneObject

IntArray = NDArray[np.int64]

CELL = 0.004
"""Side of the cells that points are gathered in, metres."""
REACH = 0.011
"""Largest distance between cells of one cluster, metres."""
LEAST = 14
"""Pixels of all views together that make a cluster; fewer are flying pixels."""


def clusters(frames: Sequence[ViewFrame], masks: Sequence[BoolArray], least: int = LEAST) -> list[IntArray]:
    """The connected components of the masked (H, W) pixels' points, largest first: one image (H, W) per view of
    indices, -1 where none is seen; a component of fewer than ``least`` pixels is none.
    """
    masks = [without_specks(mask) for mask in masks]
    maps = [np.full(mask.shape, -1) for mask in masks]
    points, _ = cloud_of(frames, masks)
    if len(points):
        parts = components(points)
        sizes = np.bincount(parts)
        order = np.argsort(-sizes, kind="stable")
        kept = order[sizes[order] >= least]
        renamed = np.full(len(sizes), -1)
        renamed[kept] = np.arange(len(kept))
        ends = np.cumsum([mask.sum() for mask in masks])
        for image, mask, labels in zip(maps, masks, np.split(renamed[parts], ends[:-1]), strict=True):
            image[mask] = labels
    return maps


def cloud_of(frames: Sequence[ViewFrame], masks: Sequence[BoolArray]) -> tuple[FloatArray, FloatArray]:
    """The points (N, 3), world, metres, and the colours (N, 3) in [0, 1] of the pixels of masks (H, W), one a view."""
    shown = list(zip(frames, masks, strict=True))
    points = np.concatenate([frame.points[mask] for frame, mask in shown])
    return points, np.concatenate([frame.view.image[mask] for frame, mask in shown]) / 255.0


def components(points: FloatArray, reach: float = REACH) -> IntArray:
    """(N,) component of each point (N, 3): joined where cells that hold points lie within ``reach`` metres."""
    cells, inverse, counts = np.unique(
        np.floor(points / CELL).astype(np.int64), axis=0, return_inverse=True, return_counts=True
    )
    centres = (
        np.stack([np.bincount(inverse.reshape(-1), points[:, k]) for k in range(3)], axis=1) / counts[:, None]
    )
    pairs = cKDTree(centres).query_pairs(reach, output_type="ndarray")
    return connected(len(cells), pairs)[inverse.reshape(-1)]


def connected(count: int, pairs: NDArray[np.integer]) -> IntArray:
    """(count,) the connected component of each node, given edges (E, 2)."""
    graph = coo_matrix((np.ones(len(pairs), dtype=np.int8), pairs.T), shape=(count, count))
    return np.asarray(connected_components(graph, directed=False)[1], dtype=np.int64)


def without_specks(mask: BoolArray, least: int = 3) -> BoolArray:
    """The mask (H, W) without pixels that have fewer than ``least`` of eight neighbours in it."""
    kernel = np.ones((3, 3), dtype=np.int8)
    kernel[1, 1] = 0
    return np.asarray(mask & (convolve(mask.astype(np.int8), kernel, mode="constant") >= least))


SHARED = 0.55
"""Share of each mask's points on the other, of those that its picture shows, above which both show one object. A part's
points all lie on the whole, but few of the whole's on the part: they stay two.
"""
IN_SIGHT = 0.015
"""Metres between a point and what a picture measured there, within which the picture shows the point."""
TOUCHING = 0.008
"""Metres between coinciding points: cameras err by millimetres, and pixels are some wide."""
SAMPLE = 400
SAME = 0.8
"""Intersection over union in one picture above which two masks are one."""
WITHIN = 0.9
"""Share of an object's points within another above which it is a part of it."""
STRAY = 0.04
"""Share of an object's points below which a detached piece is a leak of the mask, not the object."""
ABOVE = 0.0015
"""Least metres above the table for a point in a mask to belong to the object; the rest is the mask's soft rim."""


@dataclass(frozen=True)
class MaskCandidate:
    """A mask (H, W) in the picture of frame ``view``: ``score`` in [0, 1]; ``label`` "" if the model gives none.

    Candidates of one ``seed`` >= 0 were prompted by one cluster in 3D: they show one object.
    """

    view: int
    mask: BoolArray
    score: float
    label: str = ""
    seed: int = -1


@dataclass(frozen=True)
class Fused:
    """One object: ``members`` are its candidates, at most one per view; ``parent`` the index of its whole."""

    members: tuple[MaskCandidate, ...]
    parent: int = -1

    @property
    def score(self) -> float:
        """The mean of the members'."""
        return float(np.mean([m.score for m in self.members]))

    @property
    def label(self) -> str:
        """The label with the largest total score, "" if the model gives none."""
        labels = dict.fromkeys(m.label for m in self.members)
        return max(labels, key=lambda word: sum(m.score for m in self.members if m.label == word))


def fuse(frames: Sequence[ViewFrame], candidates: Sequence[MaskCandidate]) -> list[Fused]:
    """The objects that the candidates show, largest first; candidates without a point in 3D are left out."""
    placed = [(one, _points(frames[one.view], one.mask)) for one in _without_doubles(candidates)]
    placed = [(one, cloud) for one, cloud in placed if len(cloud)]
    if not placed:
        return []
    pairs = [
        (i, j)
        for i, (one, cloud) in enumerate(placed)
        for j, (other, beside) in enumerate(placed[:i])
        if one.view != other.view and _one_object(frames, one, other, cloud, beside)
    ]
    groups = connected(len(placed), np.array(pairs, dtype=np.int64).reshape(-1, 2))
    found: list[tuple[tuple[MaskCandidate, ...], FloatArray]] = []
    for group in np.unique(groups):
        own = sorted((placed[i] for i in np.nonzero(groups == group)[0]), key=lambda each: each[0].score)
        best = {one.view: (one, cloud) for one, cloud in own}  # of two in one picture, the surer one
        members, spread = zip(*best.values(), strict=True)
        found.append((members, np.concatenate(spread)))
    found.sort(key=lambda each: -len(each[1]))
    clouds = [cloud for _, cloud in found]
    return [Fused(members, _whole_of(k, clouds)) for k, (members, _) in enumerate(found)]


def objects_of(
    masks: Sequence[Fused], frames: Sequence[ViewFrame], table: TablePlane, least: int
) -> tuple[list[SceneObject], list[str]]:
    """Scene objects of fused masks, with ids ``object0``, ...; and a sentence for each that is too small to place.

    A pixel that two masks claim goes to the part, and between two wholes, to the surer one.
    """
    objects, notes = [], []
    owners = [np.full(f.height.shape, -1) for f in frames]
    for k in sorted(range(len(masks)), key=lambda k: (masks[k].parent >= 0, masks[k].score)):
        for member in masks[k].members:
            owners[member.view][member.mask] = k
    with np.errstate(invalid="ignore"):
        up = [f.known & (f.height > max(ABOVE, 1.5 * table.noise)) for f in frames]
    for k, obj in enumerate(masks):
        cloud, rgb = cloud_of(frames, [(own == k) & high for own, high in zip(owners, up, strict=True)])
        if len(cloud) >= least:
            parts = components(cloud)
            own_parts = (np.bincount(parts) >= STRAY * len(cloud))[parts]
            cloud, rgb = cloud[own_parts], rgb[own_parts]
        if len(cloud) < max(least, 3):
            pixels = sum(int(m.mask.sum()) for m in obj.members)
            notes.append(f"A mask of {pixels} pixels has no depth to place it.")
            continue
        x, y = cloud[:, :2].mean(axis=0)
        made = object_of(cloud, rgb, table.height_at(float(x), float(y)), obj.score, f"object{k}")
        parent = f"object{obj.parent}" if obj.parent >= 0 else ""
        objects.append(replace(made, label=obj.label or made.label, parent=parent))
    there = {o.id for o in objects}
    return [o if o.parent in there else replace(o, parent="") for o in objects], notes


def _without_doubles(candidates: Sequence[MaskCandidate]) -> list[MaskCandidate]:
    """Each mask of a picture once, the surest first."""
    kept: list[MaskCandidate] = []
    for one in sorted(candidates, key=lambda c: -c.score):
        if one.mask.any() and not any(k.view == one.view and iou(k.mask, one.mask) > SAME for k in kept):
            kept.append(one)
    return kept


def iou(one: BoolArray, other: BoolArray) -> float:
    """Intersection over union of two masks; 0 for two empty ones."""
    either = int((one | other).sum())
    return int((one & other).sum()) / either if either else 0.0


def _points(frame: ViewFrame, mask: BoolArray) -> FloatArray:
    known = mask & frame.known
    with np.errstate(invalid="ignore"):
        above = known & (frame.height > ABOVE)
    cloud = frame.points[above if above.any() else known]  # leaks onto the table are not part of an object
    return cloud[:: max(1, len(cloud) // SAMPLE)]


def _one_object(
    frames: Sequence[ViewFrame], a: MaskCandidate, b: MaskCandidate, of_a: FloatArray, of_b: FloatArray
) -> bool:
    if a.seed >= 0 and b.seed >= 0:
        return a.seed == b.seed
    return min(_share_on(frames[b.view], b.mask, of_a), _share_on(frames[a.view], a.mask, of_b)) >= SHARED


def _share_on(frame: ViewFrame, mask: BoolArray, cloud: FloatArray) -> float:
    """Share of the points (N, 3) visible in a picture that lie in a mask (H, W)."""
    _, rows, columns = in_sight(frame, cloud)
    return float(mask[rows, columns].mean()) if len(rows) >= 3 else 0.0


def in_sight(frame: ViewFrame, points: FloatArray) -> tuple[IntArray, IntArray, IntArray]:
    """Which of points (N, 3) the picture shows, as indices (M,), and their rows (M,) and columns (M,)."""
    uv, _ = frame.view.camera.project(points)
    index = np.flatnonzero(frame.view.camera.inside(uv))
    columns, rows = np.floor(uv[index]).astype(np.int64).T
    with np.errstate(invalid="ignore"):
        seen = np.linalg.norm(frame.points[rows, columns] - points[index], axis=1) < IN_SIGHT
    return index[seen], rows[seen], columns[seen]


def _whole_of(k: int, spread: Sequence[FloatArray]) -> int:
    """The smallest larger object that contains the k-th; -1 for none."""
    for j in range(k - 1, -1, -1):
        if len(spread[j]) < 1.5 * len(spread[k]):
            continue
        near = np.isfinite(cKDTree(spread[j]).query(spread[k], distance_upper_bound=0.5 * TOUCHING)[0])
        if near.mean() >= WITHIN:
            return j
    return -1
