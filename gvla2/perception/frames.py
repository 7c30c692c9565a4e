"""Views ready for perception: depth with small holes filled, points in the world, heights above the table."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation, uniform_filter

from gvla2.errors import PerceptionError
from gvla2.geometry.transform import FloatArray, transform_points
from gvla2.geometry.views import View, Views
from gvla2.perception.registration import TablePlane, find_table
from gvla2.planning.scene import Box

BoolArray = NDArray[np.bool_]

REACH = 2
"""Pixels either way that a depth is filled in from."""
FEWEST = 4
"""Minimum number of known pixels of one colour for a depth to be filled in."""
ALIKE = 24
"""Levels of 255, in each channel, by which pixels of one surface differ at most."""
STRAIGHT = 0.006
"""Metres by which the known depths may be off a plane: nothing is filled in at a step in depth."""
STEADY = 0.3
"""Damping that keeps a plane through few pixels from tilting, in squared pixels."""
DARK = 4
"""A picture without a brighter pixel (of 255) shows nothing."""


def filled(
    depth: FloatArray, image: NDArray[np.uint8], within: NDArray[np.bool_] | None = None
) -> FloatArray:
    """The depth (H, W), metres, with pixels that are NaN replaced where neighbours of their colour lie in a plane.

    ``image`` (H, W, 3); only pixels of ``within`` (H, W) are replaced, all by default.
    """
    there = np.isfinite(depth)
    side = 2 * REACH + 1
    beside = uniform_filter(there.astype(np.float64), side, mode="constant") * side**2 > FEWEST - 0.5
    rows, columns = np.nonzero(~there & beside & (True if within is None else within))
    down, right = np.mgrid[-REACH : REACH + 1, -REACH : REACH + 1].reshape(2, -1)
    around = (rows[:, None] + REACH + down, columns[:, None] + REACH + right)  # (N, K)
    near = np.pad(depth, REACH, constant_values=np.nan)[around]
    hues = np.pad(image, [(REACH, REACH), (REACH, REACH), (0, 0)])[around].astype(np.int16)
    unlike = np.abs(hues - image[rows, columns][:, None].astype(np.int16)).max(axis=-1)
    known = np.isfinite(near) & (unlike <= ALIKE)
    enough = known.sum(axis=1) >= FEWEST
    rows, columns, near, known = rows[enough], columns[enough], np.nan_to_num(near[enough]), known[enough]
    weight = known / (1.0 + down**2 + right**2)
    basis = np.stack([np.ones(len(down)), down, right])
    left_side = np.einsum("nk,ik,jk->nij", weight, basis, basis) + STEADY * np.diag([0.0, 1.0, 1.0])
    right_side = np.einsum("nk,ik,nk->ni", weight, basis, near)
    plane = np.linalg.solve(left_side, right_side[..., None])[..., 0]
    off = (weight * (near - plane @ basis) ** 2).sum(axis=1) / weight.sum(axis=1)
    straight = off < STRAIGHT**2
    result = depth.copy()
    result[rows[straight], columns[straight]] = plane[straight, 0]
    return result


@dataclass(frozen=True)
class ViewFrame:
    """One view, ready to use, metres.

    ``points`` (H, W, 3) world, NaN where unknown; ``height`` (H, W) above the table.
    """

    view: View
    points: FloatArray
    height: FloatArray

    @property
    def known(self) -> BoolArray:
        """(H, W) pixels that have a point."""
        return np.asarray(np.isfinite(self.points[..., 2]))


def frames_of(views: Views, workspace: Box) -> tuple[list[ViewFrame], TablePlane, list[str]]:
    """The usable views with their points, the table, and a sentence for each unusable view.

    The points of a camera whose own table lies off the common one are turned and lifted onto it: extrinsics err by
    millimetres. Raises :class:`PerceptionError` for an empty workspace, if no view has depth, or if there is no level
    plane under the workspace.
    """
    check_workspace(workspace)
    usable, notes = usable_views(views)
    shown = [(view, view.camera.backproject(depth)) for view, depth, _ in usable]
    table = find_table([points[np.isfinite(points[..., 2])] for _, points in shown], workspace)
    frames = []
    for view, points in shown:
        moved = transform_points(table.onto(points[np.isfinite(points[..., 2])], workspace), points)
        frames.append(ViewFrame(view, moved, moved @ table.normal - table.offset))
    return frames, table, notes


def check_workspace(workspace: Box) -> None:
    """Raise :class:`PerceptionError` for a workspace without a finite extent along each axis."""
    if not (np.isfinite([workspace.low, workspace.high]).all() and (workspace.low < workspace.high).all()):
        raise PerceptionError(
            f"The workspace from {workspace.low} to {workspace.high} is empty; low must be below high."
        )


def usable_views(views: Views) -> tuple[list[tuple[View, FloatArray, BoolArray]], list[str]]:
    """The views that show something, and a sentence for each of the others.

    With each view its depth (H, W), metres, NaN where nothing is known and on the robot, small holes filled; and the
    robot's pixels (H, W) with a rim of one pixel. Raises :class:`PerceptionError` if no view is left.
    """
    usable, notes = [], []
    for view in views:
        depth = np.full(view.image.shape[:2], np.nan)
        if view.depth is not None:
            depth = np.where(np.isfinite(view.depth) & (view.depth > 0), view.depth, np.nan).astype(float)
        robot = np.zeros(depth.shape, dtype=bool)
        if view.robot_mask is not None:
            robot = binary_dilation(view.robot_mask, np.ones((3, 3), bool))
        depth[robot] = np.nan
        depth, reason = filled(depth, view.image, ~robot), ""
        if view.depth is None:
            reason = "it has no depth"
        elif not np.isfinite(depth).any():
            reason = "no pixel has a depth, or all of them show the robot"
        elif view.image.max() <= DARK:
            reason = "its image is black"
        if reason:
            notes.append(f"Camera '{view.name}' is not used: {reason}.")
        else:
            usable.append((view, depth, robot))
    if not usable:
        raise PerceptionError(
            f"No view can be used: {' '.join(notes)} At least one camera must deliver depth."
        )
    return usable, notes


def raised(
    frame: ViewFrame, table: TablePlane, workspace: Box, least: float = 0.004, border: float = 0.03
) -> BoolArray:
    """(H, W) pixels that show what stands on the table, in the workspace or ``border`` metres beside it."""
    with np.errstate(invalid="ignore"):
        beside = frame.points[..., :2] - np.clip(
            frame.points[..., :2], workspace.low[:2] - border, workspace.high[:2] + border
        )
        inside = (np.abs(beside) == 0).all(axis=-1) & (frame.points[..., 2] < workspace.high[2])
        return np.asarray(inside & (frame.height > max(least, 3.3 * table.noise)))
