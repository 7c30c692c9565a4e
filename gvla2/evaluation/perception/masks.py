"""The pixels of perceived objects: their points projected into the views that they were seen in."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from scipy.ndimage import binary_closing, binary_dilation
from scipy.spatial import cKDTree
from skimage import morphology

from gvla2.evaluation.perception.truth import BoolArray, measured
from gvla2.geometry.transform import FloatArray, invert_rigid, transform_points
from gvla2.geometry.views import Observation, View
from gvla2.planning.scene import SceneObject

SAME_SURFACE = 0.012
"""Metres between a point's depth and the picture's within which the point is seen there: noisy depth included."""

WIDEST_GAP = 8
"""Pixels between projected points beyond which they are not joined."""

MARGIN = 0.002
"""Metres about a box within which a pixel counts as in it, and above its foot from which it is not on the table."""


_disk: Callable[[int], BoolArray] = morphology.disk


def object_masks(observation: Observation, objects: Sequence[SceneObject]) -> BoolArray:
    """(N, P) pixels of each object, among those of all views that have a depth (see :func:`measured`).

    A perceiver keeps some thousand points of an object, fewer than its pixels, so gaps as wide as the points' own
    spacing are closed; where points are sparse, nearby pixels in the object's box count as its own too, unless they are
    another's.
    """
    rows: list[list[BoolArray]] = [[] for _ in objects]
    for view, ok in zip(observation.views, measured(observation), strict=True):
        spots = [_projected(view, thing.points) for thing in objects]
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
    for k, (thing, mask) in enumerate(zip(objects, closed, strict=True)):
        if sparse[k]:
            near = binary_dilation(mask, _disk(2 * _spacing(spots[k]))) & ~mask
            near[near] = _in_box(thing, points[near])
            others = [other for j, other in enumerate(closed) if j != k]
            mask = mask | _off_robot(view, near & ~np.any([np.zeros_like(near), *others], axis=0))
        filled.append(mask)
    return filled


def _in_box(thing: SceneObject, points: FloatArray) -> BoolArray:
    """(N,) bool: world points (N, 3) in the object's box and not on what it stands on; NaN is nowhere."""
    local = transform_points(invert_rigid(thing.world_from_object), points)
    inside = (np.abs(local) <= 0.5 * thing.extents + MARGIN).all(axis=1)
    if thing.top - thing.bottom > 2 * MARGIN:
        inside &= points[:, 2] > thing.bottom + MARGIN
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
