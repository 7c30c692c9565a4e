"""Depth that a camera lost here and there, as on dark surfaces, from what is measured about it on the same surface."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation, uniform_filter
from scipy.spatial.transform import Rotation

from gvla2.errors import PerceptionError
from gvla2.geometry.transform import FloatArray, invert_rigid, rigid, transform_points
from gvla2.geometry.views import View
from gvla2.planning.scene import Box

REACH = 2
"""Pixels either way that a depth is filled in from."""
FEWEST = 4
"""Known pixels of one colour that tell it."""
ALIKE = 24
"""Levels of 255, in each channel, by which pixels of one surface differ at most."""
STRAIGHT = 0.006
"""Metres by which the known depths may be off a plane: nothing is filled in at a step in depth."""
STEADY = 0.3
"""What keeps a plane through few pixels from tilting, in squared pixels."""


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


BoolArray = NDArray[np.bool_]

BELOW = 0.15
"""Metres below the workspace within which the table is searched for."""
DARK = 4
"""A picture without a brighter pixel (of 255) shows nothing."""
HYPOTHESES, SAMPLE, SEED = 128, 3000, 0
LEAST_POINTS, LEAST_SHARE = 200, 0.1
"""Least points in the workspace, and least share of them on one level plane, for a table."""
NO_ROOM = 50.0
"""Metres from the workspace where nothing is measured: depth in millimetres lies there."""
MOST_TILT = np.deg2rad(15.0)
SLICED = 2.0
"""A steep plane with so many times the points of the widest level one is what the table is."""
MOST_CORRECTION = 0.015
"""Largest error of a camera at the table, metres; beyond it, it sees another surface."""


@dataclass(frozen=True)
class ViewFrame:
    """One view, ready to use.

    ``points`` (H, W, 3) world, metres, NaN where unknown; ``height`` (H, W) metres above the table. ``corrected`` is
    the offset of the camera's table from the common one, metres.
    """

    view: View
    points: FloatArray
    height: FloatArray
    corrected: float = 0.0

    @property
    def known(self) -> BoolArray:
        """(H, W) pixels that have a point."""
        return np.asarray(np.isfinite(self.points[..., 2]))


@dataclass(frozen=True)
class TablePlane:
    """A nearly level plane ``normal`` . x = ``offset``; ``noise`` is its points' robust deviation, metres."""

    normal: FloatArray
    offset: float
    noise: float

    def frame(self, workspace: Box) -> FloatArray:
        """(4, 4) table_from_world: its top at z = 0, z its normal, origin under the workspace's centre, x along x."""
        x = np.cross([0.0, 1.0, 0.0], self.normal)
        x = x / np.linalg.norm(x)
        middle = 0.5 * (workspace.low + workspace.high)
        axes = np.stack([x, np.cross(self.normal, x), self.normal], axis=1)
        return invert_rigid(rigid(axes, [*middle[:2], self.height_over(workspace)]))

    def height_at(self, x: float, y: float) -> float:
        """World z of the plane there."""
        return float((self.offset - self.normal[0] * x - self.normal[1] * y) / self.normal[2])

    def height_over(self, workspace: Box) -> float:
        """World z of the plane at the workspace's middle."""
        x, y, _ = 0.5 * (workspace.low + workspace.high)
        return self.height_at(float(x), float(y))


def frames_of(views: Iterable[View], workspace: Box) -> tuple[list[ViewFrame], TablePlane, list[str]]:
    """The usable views with their points, the table, and a sentence for each unusable view.

    A camera whose own table lies off the common one is turned and lifted until they agree: extrinsics err by
    millimetres. Raises :class:`PerceptionError` if no view has depth, or there is no level plane under the workspace.
    """
    low, high = np.asarray(workspace.low, dtype=np.float64), np.asarray(workspace.high, dtype=np.float64)
    if not (np.isfinite(low).all() and np.isfinite(high).all() and (low < high).all()):
        raise PerceptionError(f"The workspace from {low} to {high} is empty; low must be below high.")
    frames, notes = [], []
    for view in views:
        points = _points(view)
        if reason := why_not(view, points):
            notes.append(f"Camera '{view.name}' is not used: {reason}.")
        else:
            frames.append(ViewFrame(view, points, points[..., 2]))
    if not frames:
        raise PerceptionError(
            f"No view can be used: {' '.join(notes)} At least one camera must deliver depth."
        )
    table = find_table([f.points[f.known] for f in frames], workspace)
    return [_set_right(f, table, workspace) for f in frames], table, notes


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


def _points(view: View) -> FloatArray:
    if view.depth is None:
        return np.full((*view.image.shape[:2], 3), np.nan)
    depth = view.depth.astype(np.float64)
    depth[~(np.isfinite(depth) & (depth > 0))] = np.nan
    robot = np.zeros(depth.shape, dtype=bool)
    if view.robot_mask is not None:
        robot = binary_dilation(view.robot_mask, np.ones((3, 3), bool))
    depth[robot] = np.nan
    return view.camera.backproject(filled(depth, view.image, ~robot))


def why_not(view: View, points: FloatArray) -> str:
    """Why a view is unusable, "" if it is usable; ``points`` (H, W, ...) are NaN where unknown."""
    if view.depth is None:
        return "it has no depth"
    if not np.isfinite(points).any():
        return "no pixel has a depth, or all of them show the robot"
    return "its image is black" if view.image.max() <= DARK else ""


def _near(points: FloatArray, workspace: Box) -> FloatArray:
    """The points (N, 3) that lie above and slightly below the workspace."""
    low = workspace.low - [0.0, 0.0, BELOW]
    inside = np.ones(len(points), dtype=bool)
    for axis, column in enumerate(points.T):  # much faster than all columns at once
        inside &= (column >= low[axis]) & (column <= workspace.high[axis])
    return np.asarray(points[inside])


def find_table(clouds: Sequence[FloatArray], workspace: Box) -> TablePlane:
    """The widest nearly level plane under the workspace in points (N, 3) of some views: RANSAC over triples, then
    least squares over the plane's own points. Raises :class:`PerceptionError` where there is none, or where the widest
    plane is tilted by more than 15 degrees.
    """
    measured = np.concatenate(clouds)
    points = _near(measured, workspace)
    if len(points) < LEAST_POINTS:
        away = measured - 0.5 * (workspace.low + workspace.high)
        far = float(np.median(np.linalg.norm(away, axis=1))) if len(away) else 0.0
        units = " Is the depth in metres?" if far > NO_ROOM else ""
        raise PerceptionError(
            f"Only {len(points)} of the measured points lie in the workspace {workspace.low} to {workspace.high}; "
            f"a table top needs hundreds. Most are about {far:.3g} m away from its middle.{units} Check the cameras' "
            "poses and the workspace."
        )
    rng = np.random.default_rng(SEED)
    sample = points[rng.integers(0, len(points), SAMPLE)]
    triples = sample[rng.integers(0, len(sample), (HYPOTHESES, 3))]
    normals = np.cross(triples[:, 1] - triples[:, 0], triples[:, 2] - triples[:, 0])
    length = np.linalg.norm(normals, axis=1)
    level = (np.abs(normals[:, 2]) >= np.cos(MOST_TILT) * length) & (length > 1e-4)
    steep = ~level & (length > 1e-4)
    tilted, corners = normals[steep] / length[steep, None], triples[steep, 0]
    normals = normals[level] / length[level, None] * np.sign(normals[level, 2:])
    anchors = np.concatenate([triples[level, 0], sample[:64]])
    normals = np.concatenate([normals, np.tile([0.0, 0.0, 1.0], (64, 1))])
    offsets = np.einsum("ij,ij->i", normals, anchors)
    held = _held(sample, normals, offsets)
    best = int(np.argmax(held))
    _check_tilt(tilted, _held(sample, tilted, np.einsum("ij,ij->i", tilted, corners)), int(held[best]))
    normal, offset = _settled(points, normals[best], float(offsets[best]), 0.008)
    residual = np.abs(points @ normal - offset)
    own = residual < 0.008
    if own.sum() < max(LEAST_POINTS, LEAST_SHARE * len(points)):
        raise PerceptionError(
            f"No level plane lies under the workspace: the best holds {int(own.sum())} of {len(points)} points."
        )
    return TablePlane(normal, offset, 1.4826 * float(np.median(residual[own])))


def _held(points: FloatArray, normals: FloatArray, offsets: FloatArray) -> NDArray[np.int64]:
    """(P,) how many of points (N, 3) lie on each plane ``normals`` (P, 3) . x = ``offsets`` (P,)."""
    return np.asarray((np.abs(points @ normals.T - offsets) < 0.006).sum(axis=0))


def _check_tilt(normals: FloatArray, held: NDArray[np.int64], level: int) -> None:
    """Raise :class:`PerceptionError` if one of the steep planes ``normals`` (P, 3), which hold ``held`` (P,) points, is
    much wider than the widest ``level`` one: that one would be a slice of it.
    """
    if held.max(initial=0) > SLICED * level:
        tilt = np.rad2deg(np.arccos(abs(normals[int(np.argmax(held)), 2])))
        raise PerceptionError(
            f"The widest plane under the workspace is tilted by {tilt:.0f} degrees; a table's top may be tilted by "
            f"{np.rad2deg(MOST_TILT):.0f}. Check the cameras' poses: the z axis of their world must point up."
        )


def _settled(points: FloatArray, normal: FloatArray, offset: float, band: float) -> tuple[FloatArray, float]:
    some = points[:: max(1, len(points) // 30_000)]
    for width in (band, 0.7 * band, 0.5 * band):
        near = some[np.abs(some @ normal - offset) < width]
        if len(near) < 30:
            break
        centre = near.mean(axis=0)
        normal = np.linalg.eigh(np.cov((near - centre).T))[1][:, 0]
        normal = normal * np.sign(normal[2] or 1.0)
        offset = float(normal @ centre)
    return normal, offset


def _set_right(frame: ViewFrame, table: TablePlane, workspace: Box) -> ViewFrame:
    """The frame with its own table aligned to the common one: two turns and one shift, all that a plane determines."""
    points, off = frame.points, 0.0
    near = _near(points[frame.known], workspace)
    near = near[np.abs(near @ table.normal - table.offset) < MOST_CORRECTION]
    if len(near) >= LEAST_POINTS:
        normal, offset = _settled(near, table.normal, float(np.median(near @ table.normal)), 0.008)
        middle = near.mean(axis=0)
        middle = middle + (offset - normal @ middle) * normal  # on the camera's own plane
        off = float(table.offset - table.normal @ middle)
        axis = np.cross(normal, table.normal)
        if np.linalg.norm(axis) < 0.02 and abs(off) < MOST_CORRECTION:
            turn = Rotation.from_rotvec(axis).as_matrix()  # small: the sine is the angle
            points = transform_points(rigid(turn, middle - turn @ middle + off * table.normal), points)
    return replace(frame, points=points, height=points @ table.normal - table.offset, corrected=off)
