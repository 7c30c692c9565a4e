"""The table top, and corrections of inaccurate cameras so that they agree on it and on the objects on it.

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

from gvla2.errors import PerceptionError
from gvla2.geometry.transform import FloatArray, invert_rigid, rigid, transform_points
from gvla2.geometry.views import View, Views
from gvla2.planning.scene import Box

BELOW = 0.15  # metres below the workspace within which the table is searched for
HYPOTHESES, SAMPLE, SEED = 128, 3000, 0
LEAST_POINTS, LEAST_SHARE = 200, 0.1  # points in the workspace, and share of them on one plane, for a table
NO_ROOM = 50.0  # metres from the workspace where nothing is measured: depth in millimetres lies there
MOST_TILT = np.deg2rad(15.0)
SLICED = 2.0  # a steep plane with this multiple of the widest level plane's points is the table itself
MOST_CORRECTION = 0.015  # metres between a camera's own table and the common one
FLAT = 0.008  # metres from the table's plane within which points are its own
PRIOR = np.array([0.003] * 3 + [0.0015] * 3 + [0.003])  # turn in radians, shift in metres, scale of depth
AGREE = 0.001  # metres between the tables of cameras that need no correction
BAND, TALL = 0.02, 0.4  # metres about the table within which it is looked for; above it objects are
BESIDE = 0.05  # metres about the workspace
OFF_TABLE = 0.012  # metres above the table from which a point belongs to an object
TABLE_SPREAD, PAIR_SPREAD = 0.004, 0.003  # metres
MOST_TABLE, MOST_OBJECTS, MOST_CLOUD = 300, 700, 12_000  # points of one camera
UP = np.array([0.0, 0.0, 1.0])
REACHES = (0.02, 0.015, 0.01, 0.008, 0.006)  # metres between points that may be one, round by round


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

    def onto(self, points: FloatArray, workspace: Box) -> FloatArray:
        """(4, 4) the smallest motion of one camera's points (N, 3) that lays its own table onto this plane.

        No motion for a camera that sees another surface there: its plane is far off, or steep.
        """
        near = _near(points, workspace)
        near = near[np.abs(near @ self.normal - self.offset) < MOST_CORRECTION]
        if len(near) < LEAST_POINTS:
            return np.eye(4)
        normal, offset = _settled(near, self.normal, float(np.median(near @ self.normal)))
        middle = near.mean(axis=0)
        middle = middle + (offset - normal @ middle) * normal  # on the camera's own plane
        off = float(self.offset - self.normal @ middle)
        axis = np.cross(normal, self.normal)
        if np.linalg.norm(axis) >= 0.02 or abs(off) >= MOST_CORRECTION:
            return np.eye(4)
        turn = Rotation.from_rotvec(axis).as_matrix()  # small: the sine is the angle
        return rigid(turn, middle - turn @ middle + off * self.normal)


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
    normals = np.concatenate([normals, np.tile(UP, (64, 1))])
    offsets = np.einsum("ij,ij->i", normals, anchors)
    held = _held(sample, normals, offsets)
    best = int(np.argmax(held))
    _check_tilt(tilted, _held(sample, tilted, np.einsum("ij,ij->i", tilted, corners)), int(held[best]))
    normal, offset = _settled(points, normals[best], float(offsets[best]))
    residual = np.abs(points @ normal - offset)
    own = residual < FLAT
    if own.sum() < max(LEAST_POINTS, LEAST_SHARE * len(points)):
        raise PerceptionError(
            f"No level plane lies under the workspace: the best holds {int(own.sum())} of {len(points)} points."
        )
    return TablePlane(normal, offset, 1.4826 * float(np.median(residual[own])))


def _near(points: FloatArray, workspace: Box) -> FloatArray:
    """The points (N, 3) that lie above and slightly below the workspace."""
    low = workspace.low - [0.0, 0.0, BELOW]
    inside = np.ones(len(points), dtype=bool)
    for axis, column in enumerate(points.T):  # much faster than all columns at once
        inside &= (column >= low[axis]) & (column <= workspace.high[axis])
    return np.asarray(points[inside])


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


def _settled(points: FloatArray, normal: FloatArray, offset: float) -> tuple[FloatArray, float]:
    """The plane ``normal`` . x = ``offset``, laid through those of points (N, 3) that are ever nearer to it."""
    some = points[:: max(1, len(points) // 30_000)]
    for width in (FLAT, 0.7 * FLAT, 0.5 * FLAT):
        near = some[np.abs(some @ normal - offset) < width]
        if len(near) < 30:
            break
        centre = near.mean(axis=0)
        normal = np.linalg.eigh(np.cov((near - centre).T))[1][:, 0]
        normal = normal * np.sign(normal[2] or 1.0)
        offset = float(normal @ centre)
    return normal, offset


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

    Raises :class:`PerceptionError` if there is no level plane under the workspace.
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
        normal, offset = _settled(table, UP, float(np.median(table[:, 2])))
        table = table[np.abs(table @ normal - offset) < 0.3 * BAND]
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
    step = max(1, len(objects) // MOST_OBJECTS)
    return _Sight(origin, table, objects, normals, step)


def _slope(points: FloatArray) -> float:
    if len(points) < 50:
        return 0.0
    normal, _ = _settled(points, UP, float(np.median(points[:, 2])))
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
    for c, sight in enumerate(sights):
        if len(sight.table) < 50:
            continue
        p = sight.table
        J = np.zeros((len(p), size))
        J[:, 7 * c : 7 * c + 7] = _change(sight, p, np.broadcast_to(UP, p.shape))
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
