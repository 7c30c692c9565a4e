"""An object that cameras saw once as a mesh for a gallery: what no camera saw is completed by symmetry.

Most things that stand on a table look the same, or nearly so, after half a turn about their vertical axis. Where space
was not seen, the space opposite is asked: whether it is free, or where its surface is. What was seen stays as it is, so
that a mug keeps its one handle.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import label, map_coordinates
from scipy.spatial import cKDTree

from gvla2.errors import PerceptionError
from gvla2.geometry.mesh import TriangleMesh
from gvla2.geometry.transform import FloatArray
from gvla2.geometry.views import Views
from gvla2.perception.clusters import cloud_of, clusters
from gvla2.perception.frames import BoolArray, ViewFrame, frames_of, raised
from gvla2.perception.objects import footprint
from gvla2.perception.registration import agreed
from gvla2.planning.scene import Scene, SceneObject
from gvla2.reconstruction.carving import Field, surface_of

STEP, MOST_STEPS = 0.003, 100
"""Spacing of the grid, metres, and the most steps along the object's longest side: then it is coarser."""
BAND = 3.0
"""Steps behind a seen surface that count as the object's inside; deeper, nothing is known."""
BORDER = 0.06
"""Metres around the workspace where objects are taught too."""
ONE_SURFACE = 0.015
"""Metres of depth between neighbouring pixels of one surface."""
MARGIN = 0.004
"""Metres around an object's box within which a pixel is its own."""
LEAST = 150
"""Minimum number of pixels that show an object to be taught."""
TOP = 0.01
"""Metres below the highest points that are an object's top."""
BESIDE = np.stack(np.meshgrid([-0.002, 0.0, 0.002], [-0.002, 0.0, 0.002]), axis=-1).reshape(-1, 2)
"""(9, 2) metres beside a middle where the axis is looked for as well: seen outlines are off by about half a pixel."""
FEW, HIDDEN = 400, 0.5
"""Points that the axis is found by, and what a turned point counts that no camera can confirm, in bands."""
ON_TABLE = 0.008
"""An object whose lowest points are at most this high above the table, metres, stands on it."""
PIECE = 0.2
"""Share of an object's pixels on a connected body from which that is a part of it."""
WITHIN = 0.8
"""Share of a smaller body's pixels within an object's outline from which it is a piece of it."""


@dataclass(frozen=True)
class Taught:
    """What one look taught.

    ``mesh``: closed, with colours, metres, z up, its foot at z = 0 and its axis through the origin. ``seen``: the share
    of its surface that a camera saw. ``objects``: the ids of the scene's objects that it consists of.
    """

    mesh: TriangleMesh
    seen: float
    objects: tuple[str, ...]


def taught(views: Views, scene: Scene, ids: Sequence[str], *, alone: bool = False) -> Taught:
    """The objects ``ids`` of a scene as one mesh, with all that hangs together with them unless ``alone``.

    Of the scene's objects only their boxes are used. Raises :class:`PerceptionError` if too few pixels show them, or if
    no table is seen.
    """
    frames, table, _ = frames_of(agreed(views, scene.workspace), scene.workspace)
    up = [raised(frame, table, scene.workspace, border=BORDER) for frame in frames]
    solid = {
        obj.id: _pixels(frames, up, obj) for obj in scene.objects if obj.shape != "region" or obj.id in ids
    }
    own = [np.logical_or.reduce(masks) for masks in zip(*(solid[one] for one in ids), strict=True)]
    if not alone:
        own = _bodies(frames, up, own)
    shown = _count(own)
    if shown < LEAST:
        raise PerceptionError(
            f"Only {shown} pixels of all cameras show it; {LEAST} are needed to teach an object. Choose a run in which "
            "the cameras are nearer to it and nothing hides it."
        )
    points, colours = cloud_of(frames, own)
    foot = table.height_at(*points[:, :2].mean(axis=0).tolist())
    lowest = float(np.percentile(points[:, 2], 2.0))
    if alone and lowest > foot + ON_TABLE:
        foot = lowest  # it stands on something else
    within = [
        one
        for one, masks in solid.items()
        if _count([a & b for a, b in zip(masks, own, strict=True)]) > 0.5 * max(1, _count(masks))
    ]
    mesh, seen = _completed(frames, up, own, points, colours, foot)
    return Taught(mesh, seen, tuple(within))


def _pixels(frames: Sequence[ViewFrame], up: Sequence[BoolArray], obj: SceneObject) -> list[BoolArray]:
    """(H, W) a view, which of the raised pixels are in an object's box."""
    found = []
    for frame, mask in zip(frames, up, strict=True):
        own = np.zeros_like(mask)
        own[mask] = obj.distances(frame.points[mask]) <= MARGIN
        found.append(own)
    return found


def _count(masks: Sequence[BoolArray]) -> int:
    return sum(int(mask.sum()) for mask in masks)


def _bodies(
    frames: Sequence[ViewFrame], up: Sequence[BoolArray], own: Sequence[BoolArray]
) -> list[BoolArray]:
    """The pixels of the connected bodies that most of an object's ``own`` pixels belong to, and of pieces within."""
    maps = clusters(frames, up)
    counts = np.bincount(np.concatenate([image[mask] for image, mask in zip(maps, own, strict=True)]) + 1)[1:]
    if not counts.sum():
        return list(own)
    chosen = set(np.flatnonzero(counts >= PIECE * counts.sum()).tolist())
    clouds = {
        number: cloud_of(frames, [image == number for image in maps])[0]
        for number in range(max(int(image.max()) for image in maps) + 1)
    }
    yaw, low, high = footprint(np.concatenate([clouds[number] for number in chosen])[:, :2])
    turn = _level(yaw)
    for number, cloud in clouds.items():
        plan = cloud[:, :2] @ turn
        if ((plan >= low - MARGIN) & (plan <= high + MARGIN)).all(axis=1).mean() > WITHIN:
            chosen.add(number)
    return [np.isin(image, sorted(chosen)) for image in maps]


def _level(yaw: float) -> FloatArray:
    """(2, 2) whose columns are the axes of a frame turned by ``yaw`` radians."""
    return np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])


def _completed(
    frames: Sequence[ViewFrame],
    up: Sequence[BoolArray],
    own: Sequence[BoolArray],
    points: FloatArray,
    colours: FloatArray,
    foot: float,
) -> tuple[TriangleMesh, float]:
    """The closed surface about an object's seen points (N, 3) with colours (N, 3), that stands at the height ``foot``
    in the world, in the frame of :class:`Taught`; and the share of it that was seen.
    """
    axis = _axis_of(frames, up, own, points)
    opposite = _half_turn(points, axis)
    yaw, low, high = footprint(np.concatenate([points, opposite])[:, :2])
    top = float(np.percentile(points[:, 2], 99.8))
    step = max(STEP, float(max(*(high - low), top - foot)) / MOST_STEPS)
    turn = _level(yaw)
    middle = turn @ (0.5 * (low + high))
    half = 0.5 * (high - low)
    shape = [int(np.ceil(side / step)) + 4 for side in (2 * half[0], 2 * half[1], top - foot)]
    local = np.stack(np.meshgrid(*[step * np.arange(n) for n in shape], indexing="ij"), axis=-1)
    local -= [0.5 * step * (shape[0] - 1), 0.5 * step * (shape[1] - 1), 1.5 * step]
    grid = np.concatenate([local[..., :2] @ turn.T + middle, local[..., 2:] + foot], axis=-1).reshape(-1, 3)
    free = _free(frames, up, own, grid, BAND * step)
    unseen = free <= -BAND * step
    free[unseen] = _free(frames, up, own, _half_turn(grid[unseen], axis), BAND * step)
    outside = np.maximum((np.abs(local[..., :2]) - half).max(axis=-1), local[..., 2] - (top - foot))
    inside = -np.maximum(free.reshape(shape), np.maximum(outside, -local[..., 2]))
    parts, count = label(inside > 0)
    if not count:
        raise PerceptionError("What is seen of it encloses nothing: it is thinner than the cameras can tell.")
    largest = int(np.argmax(np.bincount(parts.ravel())[1:])) + 1
    inside[(parts != largest) & (parts > 0)] = -0.5 * step
    for side in range(3):
        for end in (0, -1):
            layer = np.moveaxis(inside, side, 0)[end]
            np.minimum(layer, -0.5 * step, out=layer)
    mesh = surface_of(Field(inside.astype(np.float32), local[0, 0, 0], step))
    placed = np.column_stack([mesh.vertices[:, :2] @ turn.T + middle, mesh.vertices[:, 2] + foot])
    gap, nearest = cKDTree(points).query(placed)
    other, across_nearest = cKDTree(opposite).query(placed)
    mirrored = np.asarray(other + step < gap)
    rgb = np.where(mirrored[:, None], colours[across_nearest], colours[nearest])
    frame = np.column_stack([placed[:, :2] - axis, mesh.vertices[:, 2]])
    areas = mesh.areas
    seen = np.asarray(gap < 2 * step)[mesh.faces].mean(axis=1)
    return replace(mesh, vertices=frame, colours=rgb), float((seen @ areas) / areas.sum())


def _axis_of(
    frames: Sequence[ViewFrame], up: Sequence[BoolArray], own: Sequence[BoolArray], points: FloatArray
) -> FloatArray:
    """(2,) x and y of the vertical axis of an object seen at points (N, 3).

    The middle of all that is seen, or of the top where its far side is hidden, or a place just beside either: that at
    which the points, after half a turn, agree best with what the cameras measured.
    """
    high = points[points[:, 2] > np.percentile(points[:, 2], 99.0) - TOP]
    band = BAND * STEP
    few = points[:: max(1, len(points) // FEW)]

    def disagreement(axis: FloatArray) -> float:
        free = _free(frames, up, own, _half_turn(few, axis), band)
        return float(np.where(free <= -band, HIDDEN * band, np.abs(free)).mean())

    found = []
    for seen in (points, high):
        yaw, low, top = footprint(seen[:, :2])
        found += [_level(yaw) @ (0.5 * (low + top)) + beside for beside in BESIDE]
    return min(found, key=disagreement)


def _half_turn(points: FloatArray, axis: FloatArray) -> FloatArray:
    """Points (N, 3) after half a turn about the vertical axis through ``axis`` (2,)."""
    return np.asarray(np.array([*(2 * axis), 0.0]) + points * [-1.0, -1.0, 1.0])


def _free(
    frames: Sequence[ViewFrame],
    up: Sequence[BoolArray],
    own: Sequence[BoolArray],
    points: FloatArray,
    band: float,
) -> FloatArray:
    """(N,) how far points (N, 3) lie before what cameras measured there, metres, at most ``band``: they are free.

    Negative behind it, and -``band`` where nothing is known. What other objects hide is unknown.
    """
    free = np.full(len(points), -band)
    for frame, raised_pixels, own_pixels in zip(frames, up, own, strict=True):
        uv, z = frame.view.camera.project(points)
        index = np.flatnonzero(frame.view.camera.inside(uv) & (z > 1e-6))
        columns, rows = np.floor(uv[index]).astype(int).T
        depth = _depth(frame, uv[index], rows, columns)
        before = np.clip(depth - z[index], -band, band)
        foreign = (raised_pixels & ~own_pixels)[rows, columns] & (before < band)
        before[foreign | np.isnan(before)] = -band
        free[index] = np.maximum(free[index], before)
    return free


def _depth(frame: ViewFrame, uv: FloatArray, rows: NDArray[np.intp], columns: NDArray[np.intp]) -> FloatArray:
    """(N,) the depth at places (N, 2) in a picture, metres: between pixels of one surface on the plane through them."""
    depth = frame.view.camera.project(frame.points.reshape(-1, 3))[1].reshape(frame.height.shape)
    own = depth[rows, columns]
    at = np.clip(uv - 0.5, 0.0, np.array(depth.shape)[::-1] - 1.0)[:, ::-1].T
    with np.errstate(invalid="ignore", divide="ignore"):
        between = 1.0 / map_coordinates(1.0 / depth, at, order=1)
    return np.where(np.abs(between - own) < ONE_SURFACE, between, own)
