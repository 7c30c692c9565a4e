"""Corrects inaccurate cameras' poses and depth scales so that they agree on the table and the objects on it.

Each camera's error is a small turn and shift about its own centre and a scale of its depth, with a prior; the table
top of all cameras is one plane, and points of what two cameras see lie on one surface. Gauss-Newton on all at once:
    min  sum_c |e_c / prior|^2 + sum_plane r^2 / s^2 + sum_pairs huber(n . (p_i - p_j)) / s^2 .
Where the data leave a choice, near cameras count more, since a turn moves distant points.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from gvla2.geometry.transform import FloatArray, invert_rigid, rigid, transform_points
from gvla2.geometry.views import View, Views
from gvla2.perception.frames import find_table
from gvla2.planning.scene import Box

PRIOR = np.array([0.003] * 3 + [0.0015] * 3 + [0.003])  # turn in radians, shift in metres, scale of depth
AGREE = 0.001  # metres between the tables of cameras that need no correction
BAND, TALL = 0.02, 0.4  # metres about the table within which it is looked for; above it objects are
BESIDE = 0.05  # metres about the workspace
OFF_TABLE = 0.012  # metres above the table from which a point belongs to an object
TABLE_SPREAD, PAIR_SPREAD = 0.004, 0.003  # metres
MOST_PLANE, MOST_TABLE, MOST_THINGS, MOST_CLOUD = 5000, 300, 700, 12_000  # points of one camera
REACHES = (0.02, 0.015, 0.01, 0.008, 0.006)  # metres between points that may be one, round by round


@dataclass(frozen=True)
class _Sight:
    """What one camera saw, table's frame: of the ``table`` some points (N, 3), of ``objects`` (M, 3) and their
    ``normals`` (M, 3), away from the camera, many; every ``step``-th is searched for in the other cameras' clouds.
    """

    origin: FloatArray
    table: FloatArray
    objects: FloatArray
    normals: FloatArray
    step: int

    def moved(self, step: FloatArray) -> _Sight:
        """The samples after a correction (7,)."""
        turn = Rotation.from_rotvec(step[:3]).as_matrix()

        def move(points: FloatArray) -> FloatArray:
            return np.asarray((1.0 + step[6]) * (points - self.origin) @ turn.T + self.origin + step[3:6])

        return _Sight(
            self.origin + step[3:6], move(self.table), move(self.objects), self.normals @ turn.T, self.step
        )


def agreed(views: Views, workspace: Box) -> Views:
    """The views with their cameras' poses and their depth corrected; unchanged if their tables agree.

    Raises :class:`~gvla2.errors.PerceptionError` if there is no level plane under the workspace.
    """
    clouds = [_points(view) for view in views]
    if sum(bool(np.isfinite(cloud).any()) for cloud in clouds) < 2:
        return views
    sparse = [cloud[::2, ::2] for cloud in clouds]
    table = find_table([cloud[np.isfinite(cloud[..., 2])] for cloud in sparse], workspace)
    table_from_world = table.frame(workspace)
    half = 0.5 * (workspace.high - workspace.low)[:2] + BESIDE
    clouds = [transform_points(table_from_world, cloud) for cloud in clouds]
    tables = [_table(cloud, half) for cloud in clouds]
    offsets = [abs(float(np.median(table[:, 2]))) if len(table) else 0.0 for table in tables]
    slopes = [_slope(table) * float(half.max()) for table in tables]
    if max(*offsets, *slopes) < AGREE:
        return views
    sights = [
        _sight(transform_points(table_from_world, view.camera.position), cloud, half, table)
        for view, cloud, table in zip(views, clouds, tables, strict=True)
    ]
    total, moved = np.zeros((len(sights), 7)), sights
    for reach in REACHES:
        total += _step(moved, total, reach)
        moved = [s.moved(e) for s, e in zip(sights, total, strict=True)]
    return Views(
        tuple(_corrected(view, error, table_from_world) for view, error in zip(views, total, strict=True))
    )


def _points(view: View) -> FloatArray:
    """(H, W, 3) world points outside the robot, NaN where there are none."""
    if view.depth is None:
        return np.full((*view.image.shape[:2], 3), np.nan)
    depth = np.where(np.isfinite(view.depth) & (view.depth > 0), view.depth, np.nan).astype(np.float64)
    if view.robot_mask is not None:
        depth[view.robot_mask] = np.nan
    return view.camera.backproject(depth)


def _table(points: FloatArray, half: FloatArray) -> FloatArray:
    """(N, 3) some of a camera's points (H, W, 3) that lie on its own table, less what is flat on it."""
    with np.errstate(invalid="ignore"):
        table = points[_inside(points, half) & (np.abs(points[..., 2]) < BAND)]
    if len(table) > 100:
        normal, at = _plane(table[:: max(1, len(table) // MOST_PLANE)])
        table = table[np.abs((table - at) @ normal) < 0.3 * BAND]
    return table[:: max(1, len(table) // MOST_TABLE)]


def _inside(points: FloatArray, half: FloatArray) -> NDArray[np.bool_]:
    return np.asarray((np.abs(points[..., 0]) < half[0]) & (np.abs(points[..., 1]) < half[1]))


def _sight(origin: FloatArray, points: FloatArray, half: FloatArray, table: FloatArray) -> _Sight:
    with np.errstate(invalid="ignore"):
        up = _inside(points, half) & (points[..., 2] > OFF_TABLE) & (points[..., 2] < TALL)
    objects = points[up]
    normals = _normals(points, up)
    known = np.isfinite(normals).all(axis=1)
    objects, normals = objects[known], normals[known]
    few = slice(None, None, max(1, len(objects) // MOST_CLOUD))
    objects, normals = objects[few], normals[few]
    step = max(1, len(objects) // MOST_THINGS)
    return _Sight(origin, table, objects, normals, step)


def _plane(points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Upward unit normal (3,) and a point (3,) of the plane through most of points (N, 3)."""
    normal, middle = _least(points)
    for _ in range(3):
        off = np.abs(points @ normal - middle @ normal)
        normal, middle = _least(points[off <= max(0.002, 1.5 * float(np.median(off)))])
    return normal * np.sign(normal[2] or 1.0), middle


def _least(points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Unit normal (3,) and a point (3,) of the plane nearest to points (N, 3)."""
    middle = points.mean(axis=0)
    spread = points - middle
    return np.linalg.eigh(spread.T @ spread)[1][:, 0], middle


def _slope(points: FloatArray) -> float:
    if len(points) < 50:
        return 0.0
    normal, _ = _plane(points)
    return float(np.hypot(normal[0], normal[1]))


def _normals(points: FloatArray, chosen: NDArray[np.bool_]) -> FloatArray:
    """(N, 3) unit normals at the chosen pixels, from neighbours two apart; NaN beside an edge."""
    rows, columns = np.nonzero(chosen)
    framed = np.pad(points, ((2, 2), (2, 2), (0, 0)), constant_values=np.nan)
    a = framed[rows + 2, columns + 4] - framed[rows + 2, columns]
    b = framed[rows + 4, columns + 2] - framed[rows, columns + 2]
    normal = np.cross(a, b)
    with np.errstate(invalid="ignore", divide="ignore"):
        smooth = (np.linalg.norm(a, axis=1) < 0.05) & (np.linalg.norm(b, axis=1) < 0.05)
        return np.where(smooth[:, None], normal / np.linalg.norm(normal, axis=1, keepdims=True), np.nan)


def _step(sights: Sequence[_Sight], total: FloatArray, reach: float) -> FloatArray:
    """(C, 7) the Gauss-Newton step of all corrections; ``total`` (C, 7) is the correction so far.

    Three more unknowns are the common plane: its height and its slopes.
    """
    count = len(sights)
    size = 7 * count + 3
    A, b = np.zeros((size, size)), np.zeros(size)
    for c in range(count):
        own = np.arange(7 * c, 7 * c + 7)
        A[own, own] += 1.0 / PRIOR**2
        b[own] -= total[c] / PRIOR**2
    up = np.array([[0.0, 0.0, 1.0]])
    for c, sight in enumerate(sights):
        if len(sight.table) < 50:
            continue
        p = sight.table
        J = np.zeros((len(p), size))
        J[:, 7 * c : 7 * c + 7] = _change(sight, p, np.broadcast_to(up, p.shape))
        J[:, -3:] = -np.column_stack([np.ones(len(p)), p[:, 0], p[:, 1]])
        r = p[:, 2]
        w = np.minimum(1.0, 0.005 / np.maximum(np.abs(r - np.median(r)), 1e-9)) / TABLE_SPREAD**2
        A += (J * w[:, None]).T @ J
        b -= (J * w[:, None]).T @ r
    A[-3:, -3:] += np.diag([1e2, 1e2, 1e2])  # the common plane stays unless all cameras disagree
    trees = [cKDTree(s.objects) if len(s.objects) >= 20 else None for s in sights]
    for i, one in enumerate(sights):
        for j, other in enumerate(sights):
            if i == j or trees[i] is None or (tree := trees[j]) is None:
                continue
            some, facing = one.objects[:: one.step], one.normals[:: one.step]
            distance, found = tree.query(some, distance_upper_bound=reach)
            near, k = np.isfinite(distance), np.asarray(found)
            p, q, n = some[near], other.objects[k[near]], other.normals[k[near]]
            # Normals have a side: the two sides of a thin wall are not one surface.
            like = np.einsum("ij,ij->i", n, facing[near]) > 0.8
            p, q, n = p[like], q[like], n[like]
            if len(p) < 10:
                continue
            J = np.zeros((len(p), size))
            J[:, 7 * i : 7 * i + 7] = _change(one, p, n)
            J[:, 7 * j : 7 * j + 7] -= _change(other, q, n)
            r = np.einsum("ij,ij->i", n, p - q)
            w = np.minimum(1.0, PAIR_SPREAD / np.maximum(np.abs(r), 1e-9)) / PAIR_SPREAD**2
            A += (J * w[:, None]).T @ J
            b -= (J * w[:, None]).T @ r
    return np.asarray(np.linalg.solve(A, b)[:-3].reshape(count, 7))


def _change(sight: _Sight, points: FloatArray, normals: FloatArray) -> FloatArray:
    """(N, 7) how n . p changes with a correction of its camera."""
    arm = points - sight.origin
    return np.column_stack([np.cross(arm, normals), normals, np.einsum("ij,ij->i", arm, normals)])


def _corrected(view: View, error: FloatArray, table_from_world: FloatArray) -> View:
    camera, there = view.camera, invert_rigid(table_from_world)
    centre = transform_points(table_from_world, camera.position)
    turn = Rotation.from_rotvec(error[:3]).as_matrix()
    motion = there @ rigid(turn, centre + error[3:6] - turn @ centre) @ table_from_world
    depth = None if view.depth is None else (view.depth * (1.0 + error[6])).astype(np.float32)
    return replace(
        view, camera=replace(camera, world_from_camera=motion @ camera.world_from_camera), depth=depth
    )
