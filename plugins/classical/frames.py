"""Usable pixels of all views, as points in the table's frame, and what space they show to be free."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from gvla2.errors import PerceptionError
from gvla2.geometry.camera import Camera
from gvla2.geometry.transform import FloatArray, invert_rigid, transform_points
from gvla2.geometry.views import View
from gvla2.perception.frames import why_not
from gvla2.perception.holes import filled

IntArray = NDArray[np.int64]

ONE_SURFACE = 0.015  # metres of depth between neighbouring pixels of one surface
COLOUR_NOISE = 12.0  # levels of 255: neighbours that differ by much less are averaged


@dataclass(frozen=True)
class TableFrame:
    """One view, ready to use.

    ``image`` (H, W, 3) uint8; ``depth`` (H, W) metres, NaN where nothing is known or where the robot is;
    ``rays`` (H, W, 3) directions whose multiple by depth, added to ``origin`` (3,), is the seen point; ``points``
    (H, W, 3), NaN where depth is; ``lost`` (H, W) where no depth was measured, away from the robot. All in the frame
    of ``frame_from_world`` (4, 4): the world at first, the table (its top at z = 0) later.
    """

    camera: Camera
    image: NDArray[np.uint8]
    depth: FloatArray
    origin: FloatArray
    rays: FloatArray
    points: FloatArray
    lost: NDArray[np.bool_]
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


def usable_frames(views: Iterable[View], robot_margin: int, least: int) -> tuple[list[TableFrame], list[str]]:
    """Frames in the world's frame, and a sentence for each view that cannot be used; pixels are left out of which
    fewer than ``least`` of eight neighbours are at their depth.

    Raises :class:`PerceptionError` when no view is left.
    """
    frames: list[TableFrame] = []
    notes: list[str] = []
    for view in views:
        depth = np.full(view.image.shape[:2], np.nan) if view.depth is None else view.depth.astype(np.float64)
        depth[~(np.isfinite(depth) & (depth > 0))] = np.nan
        robot = (
            np.zeros(depth.shape, np.uint8) if view.robot_mask is None else view.robot_mask.astype(np.uint8)
        )
        robot = np.asarray(cv2.dilate(robot, np.ones((3, 3)), iterations=robot_margin))
        depth[robot > 0] = np.nan
        depth = filled(depth, view.image, robot == 0)
        lost = np.isnan(depth) & (robot == 0)
        depth[_support(depth) < least] = np.nan
        if reason := why_not(view, depth):
            notes.append(f"Camera '{view.name}' is not used: {reason}.")
            continue
        origin, rays = view.camera.rays()
        points = origin + rays * depth[..., None]
        image = view.image
        grainy = np.median(np.abs(np.diff(image.astype(np.int16), axis=1))) > 0
        if grainy:  # less of the sensor's noise; edges stay
            image = np.asarray(cv2.bilateralFilter(image, 5, COLOUR_NOISE, 1.5))
        frames.append(TableFrame(view.camera, image, depth, origin, rays, points, lost, np.eye(4)))
    if not frames:
        raise PerceptionError(
            "No view can be used: " + " ".join(notes) + " At least one camera must deliver depth and colour."
        )
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
