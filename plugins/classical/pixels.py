"""Usable pixels of all views, as points in the table's frame, and what space they show to be free."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from gvla2.geometry.camera import Camera
from gvla2.geometry.transform import FloatArray, invert_rigid, transform_points
from gvla2.geometry.views import Views
from gvla2.perception.frames import usable_views
from gvla2.planning.colours import appearance

IntArray = NDArray[np.int64]

ONE_SURFACE = 0.015  # metres of depth between neighbouring pixels of one surface
COLOUR_NOISE = 12.0  # levels of 255: neighbours that differ by much less are averaged


@dataclass(frozen=True)
class TableFrame:
    """One view, ready to use.

    ``image`` (H, W, 3) uint8; ``depth`` (H, W) metres, NaN where nothing is known or where the robot is;
    ``rays`` (H, W, 3) directions whose multiple by depth, added to ``origin`` (3,), is the seen point; ``points``
    (H, W, 3), NaN where depth is. All in the frame of ``frame_from_world`` (4, 4): the world at first, the table's (its
    top at z = 0) later.
    """

    camera: Camera
    image: NDArray[np.uint8]
    depth: FloatArray
    origin: FloatArray
    rays: FloatArray
    points: FloatArray
    frame_from_world: FloatArray

    def moved(self, to_from_here: FloatArray) -> TableFrame:
        """The same view in another frame, given by a rigid (4, 4)."""
        rays = self.rays @ to_from_here[:3, :3].T
        origin = transform_points(to_from_here, self.origin)
        points = origin + rays * self.depth[..., None]
        frame_from_world = to_from_here @ self.frame_from_world
        return replace(self, origin=origin, rays=rays, points=points, frame_from_world=frame_from_world)

    def project(self, points: FloatArray) -> tuple[NDArray[np.bool_], IntArray, IntArray, FloatArray]:
        """Which of points (N, 3) in its frame the picture holds, (N,), and of those the rows, columns and depths."""
        world = transform_points(invert_rigid(self.frame_from_world), points)
        uv, depth = self.camera.project(world)
        inside = self.camera.inside(uv)
        columns, rows = uv[inside].astype(np.int64).T
        return inside, rows, columns, depth[inside]


def usable_frames(views: Views, least: int) -> tuple[list[TableFrame], list[str]]:
    """Frames in the world's frame, and a sentence for each view that cannot be used.

    Pixels of which fewer than ``least`` of eight neighbours are at their depth are left out. Raises
    :class:`PerceptionError` when no view is left.
    """
    usable, notes = usable_views(views)
    frames = []
    for view, depth, _ in usable:
        depth[_support(depth) < least] = np.nan
        origin, rays = view.camera.rays()
        image = view.image
        if np.median(np.abs(np.diff(image.astype(np.int16), axis=1))) > 0:  # less sensor noise; edges stay
            image = np.asarray(cv2.bilateralFilter(image, 5, COLOUR_NOISE, 1.5))
        points = origin + rays * depth[..., None]
        frames.append(TableFrame(view.camera, image, depth, origin, rays, points, np.eye(4)))
    return frames, notes


def _support(depth: FloatArray) -> IntArray:
    """(H, W) how many of a pixel's eight neighbours are at its depth: few on edges, and where most depth was lost."""
    count = np.zeros(depth.shape, dtype=np.int64)
    for shift in ((0, 1), (1, -1), (1, 0), (1, 1)):  # each neighbour is the other's neighbour
        near = np.abs(np.roll(depth, shift, axis=(0, 1)) - depth) < ONE_SURFACE
        count += np.add(near, np.roll(near, np.negative(shift), axis=(0, 1)), dtype=np.int64)
    return count


def seen_through(frames: Sequence[TableFrame], points: FloatArray, margin: float = 0.01) -> NDArray[np.bool_]:
    """(N,) bool: points (N, 3), in the frames' own frame, that some camera looked through to something behind.

    A point nearer than ``margin`` metres to the surface behind it does not count.
    """
    free = np.zeros(len(points), dtype=bool)
    for frame in frames:
        inside, rows, columns, depth = frame.project(points)
        free[inside] |= frame.depth[rows, columns] > depth + margin  # NaN compares false: unknown is not free
    return free


@dataclass(frozen=True)
class Pixels:
    """N pixels: ``view``, ``row``, ``column`` (N,); ``points`` (N, 3) in the frames' frame, metres; ``rgb`` (N, 3)
    in [0, 1]; ``look`` (N, 3) colour coordinates (see ``gvla2.planning.colours``); ``maps`` one (H, W) a view, the
    pixel's place in the list or -1.
    """

    view: IntArray
    row: IntArray
    column: IntArray
    points: FloatArray
    rgb: FloatArray
    look: FloatArray
    maps: tuple[IntArray, ...]

    def __len__(self) -> int:
        return len(self.view)

    def neighbours(self, jump: float) -> IntArray:
        """(E, 2) pairs of chosen pixels that touch along a side in one image, less than ``jump`` metres apart."""
        pairs = []
        for index in self.maps:
            for one, other in ((index[:, :-1], index[:, 1:]), (index[:-1], index[1:])):
                both = (one >= 0) & (other >= 0)
                pairs.append(np.stack([one[both], other[both]], axis=1))
        touching: IntArray = np.concatenate(pairs)
        return np.asarray(touching[np.linalg.norm(np.subtract(*self.points[touching.T]), axis=1) < jump])


def choose(
    frames: Sequence[TableFrame], masks: Sequence[NDArray[np.bool_]], *, on_plane: bool = False
) -> Pixels:
    """The pixels of ``masks``, one (H, W) a frame.

    With ``on_plane`` their points are where the rays cross z = 0: the noise of the depth then has no say.
    """
    spots = [np.nonzero(mask) for mask in masks]
    starts = np.cumsum([0, *(len(rows) for rows, _ in spots)])
    maps = tuple(np.full(mask.shape, -1, dtype=np.int64) for mask in masks)
    for index, spot, start, end in zip(maps, spots, starts, starts[1:], strict=False):
        index[spot] = np.arange(start, end)
    shown = list(zip(frames, spots, strict=True))
    points = [plane_crossings(frame, at[0], at[1]) if on_plane else frame.points[at] for frame, at in shown]
    rgb = np.concatenate([frame.image[at] for frame, at in shown]) / 255.0
    view = np.repeat(np.arange(len(spots)), np.diff(starts))
    row, column = np.concatenate(spots, axis=1)
    return Pixels(view, row, column, np.concatenate(points), rgb, appearance_of(rgb), maps)


def plane_crossings(frame: TableFrame, rows: IntArray, columns: IntArray, height: float = 0.0) -> FloatArray:
    """(N, 3) points where the pixels' rays cross z = ``height`` of the frame's frame."""
    rays = frame.rays[rows, columns]
    slope = np.where(np.abs(rays[:, 2]) > 1e-6, rays[:, 2], np.nan)
    return np.asarray(frame.origin + rays * ((height - frame.origin[2]) / slope)[:, None])


def appearance_of(rgb: FloatArray) -> FloatArray:
    """``appearance`` (N, 3) of colours (N, 3), worked out once a distinct colour."""
    packed: IntArray = np.ravel_multi_index(tuple(np.rint(rgb * 255).astype(np.int64).T), (256, 256, 256))
    distinct, inverse = np.unique(packed, return_inverse=True)
    table = np.stack([distinct >> 16, (distinct >> 8) & 255, distinct & 255], axis=1) / 255.0
    return np.asarray(appearance(table)[inverse])
