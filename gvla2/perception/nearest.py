"""The nearest of some points by a table of cells, and iterated closest points with it: far faster than with a tree.

A look at a scene asks for some millions of them: the loops are compiled. A compiled function calls only those of its
own file, and gets other files' constants as arguments: what is kept on disk is renewed by its own file's changes alone.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

from gvla2.geometry.compiled import compiled
from gvla2.geometry.transform import FloatArray

CELL, MOST_CELLS = 0.003, 72
"""Side of a cell, metres; larger where the points would span more of them."""


class NearestPoints:
    """Looks up the nearest of ``points`` (M, 3), metres, for queries in their box and up to ``reach`` beside it.

    The answer is off by less than two cells of ``cell`` metres. ``table`` (X, Y, Z) has an index for each cell from
    ``low`` (3,) on.
    """

    def __init__(self, points: FloatArray, reach: float) -> None:
        self._points = points
        low, high = points.min(axis=0), points.max(axis=0)
        self.cell = max(CELL, float((high - low).max()) / MOST_CELLS)
        self.low: FloatArray = low - reach
        size = np.ceil((high + reach - self.low) / self.cell).astype(int) + 1
        occupied = np.full(size, -1, dtype=np.int32)
        occupied[self._places(points, size)] = np.arange(len(points))
        at = distance_transform_edt(occupied < 0, return_distances=False, return_indices=True)
        self.table: NDArray[np.int32] = occupied[tuple(at)]

    def query(self, points: FloatArray) -> tuple[FloatArray, NDArray[np.int32]]:
        """Distances (...,) of points (..., 3) from the nearest, metres, and its index (...,)."""
        flat = np.ascontiguousarray(points).reshape(-1, 3)
        index, away = np.empty(len(flat), np.int32), np.empty(len(flat))
        _look_up(flat, self._points, self.table, self.low, self.cell, index, away)
        return away.reshape(points.shape[:-1]), index.reshape(points.shape[:-1])

    def mean_distances(
        self, points: FloatArray, turns: FloatArray, shifts: FloatArray, limit: float
    ) -> FloatArray:
        """(P,) mean distances, each at most ``limit`` metres, of points (N, 3) from the set, turned by ``turns``
        (P, 3, 3) and then moved by ``shifts`` (P, 3).
        """
        points, turns = np.ascontiguousarray(points), np.ascontiguousarray(turns)
        shifts, means = np.ascontiguousarray(shifts), np.empty(len(turns))
        _mean_distances(points, turns, shifts, self._points, self.table, self.low, self.cell, limit, means)
        return means

    def _places(self, points: FloatArray, size: NDArray[np.int_]) -> tuple[NDArray[np.intp], ...]:
        cells = np.clip(((points - self.low) / self.cell).astype(np.intp), 0, size - 1)
        return cells[..., 0], cells[..., 1], cells[..., 2]


@compiled
def _nearest_index(point: FloatArray, table: NDArray[np.int32], low: FloatArray, cell: float) -> int:
    """Index of the nearest of the points in a table of cells; see :class:`NearestPoints`."""
    x = min(max(int((point[0] - low[0]) / cell), 0), table.shape[0] - 1)
    y = min(max(int((point[1] - low[1]) / cell), 0), table.shape[1] - 1)
    z = min(max(int((point[2] - low[2]) / cell), 0), table.shape[2] - 1)
    return int(table[x, y, z])


@compiled
def _look_up(
    points: FloatArray,
    targets: FloatArray,
    table: NDArray[np.int32],
    low: FloatArray,
    cell: float,
    index: NDArray[np.int32],
    away: FloatArray,
) -> None:
    for n in range(len(points)):
        index[n] = _nearest_index(points[n], table, low, cell)
        away[n] = _distance(points[n], targets[index[n]])


@compiled
def _mean_distances(
    points: FloatArray,
    turns: FloatArray,
    shifts: FloatArray,
    targets: FloatArray,
    table: NDArray[np.int32],
    low: FloatArray,
    cell: float,
    limit: float,
    means: FloatArray,
) -> None:
    local = np.empty(3)
    for p in range(len(turns)):
        total = 0.0
        for n in range(len(points)):
            x, y, z = points[n, 0] - shifts[p, 0], points[n, 1] - shifts[p, 1], points[n, 2] - shifts[p, 2]
            for k in range(3):
                local[k] = x * turns[p, 0, k] + y * turns[p, 1, k] + z * turns[p, 2, k]
            total += min(limit, _distance(local, targets[_nearest_index(local, table, low, cell)]))
        means[p] = total / len(points)


@compiled
def explained_share(
    points: FloatArray,
    samples: FloatArray,
    normals: FloatArray,
    table: NDArray[np.int32],
    low: FloatArray,
    cell: float,
    limit: float,
) -> tuple[float, float, float]:
    """Of points (N, 3), the mean distance, each at most ``limit``, and the median one, metres, from the surface of
    which these are samples, and the share that lies on it.
    """
    off, total, on_it = np.empty(len(points)), 0.0, 0
    for n in range(len(points)):
        near = _nearest_index(points[n], table, low, cell)
        off[n] = _distance(points[n], samples[near])
        if off[n] < 0.01:
            # Samples lie some millimetres apart: the distance to the plane at the nearest is that to the surface.
            flat = 0.0
            for k in range(3):
                flat += (points[n, k] - samples[near, k]) * normals[near, k]
            off[n] = max(abs(flat), off[n] - 0.004)
        total += min(off[n], limit)
        if off[n] < 0.006:
            on_it += 1
    return total / len(points), float(np.median(off)), on_it / len(points)


@compiled
def closest_points(
    points: FloatArray,
    targets: FloatArray,
    normals: FloatArray,
    table: NDArray[np.int32],
    low: FloatArray,
    cell: float,
    rounds: int,
    moved: FloatArray,
) -> None:
    """Lay points (N, 3) on a surface of samples (M, 3) with unit normals, point to plane; the farthest fifth is out.

    Changes ``points``, and ``moved`` (4, 4) from where they came. On a ball or a can the turn about the axis is free:
    a little damping keeps it.
    """
    count, reach = len(points), 0.02
    index, gaps = np.empty(count, np.int64), np.empty(count)
    off, row, centre, step = np.empty(3), np.empty(6), np.empty(3), np.empty(6)
    for _ in range(rounds):
        for n in range(count):
            index[n] = _nearest_index(points[n], table, low, cell)
            gaps[n] = _distance(points[n], targets[index[n]])
        limit = max(min(reach, np.sort(gaps)[int(0.8 * (count - 1))]), 0.002)
        used, size = 0, 1e-6
        centre[:] = 0.0
        for n in range(count):
            if gaps[n] <= limit:
                used += 1
                for k in range(3):
                    centre[k] += points[n, k]
        if used < 12:
            return
        for k in range(3):
            centre[k] /= used
        for n in range(count):
            if gaps[n] <= limit:
                size += _distance(points[n], centre) / used
        system, side = 1e-3 * used * np.eye(6), np.zeros(6)
        for n in range(count):
            if gaps[n] <= limit:
                wrong = 0.0
                for k in range(3):
                    row[3 + k] = normals[index[n], k]
                    off[k] = (points[n, k] - centre[k]) / size
                    wrong += (points[n, k] - targets[index[n], k]) * row[3 + k]
                row[0] = off[1] * row[5] - off[2] * row[4]
                row[1] = off[2] * row[3] - off[0] * row[5]
                row[2] = off[0] * row[4] - off[1] * row[3]
                for i in range(6):
                    side[i] -= row[i] * wrong
                    for j in range(6):
                        system[i, j] += row[i] * row[j]
        step[:] = np.linalg.solve(system, side)
        turn = _turn(step, size)
        for n in range(count):
            _move(points[n], turn, centre, step)
        _move(moved[:3, 3], turn, centre, step)
        moved[:3, :3] = turn @ np.ascontiguousarray(moved[:3, :3])
        reach = max(0.006, 0.75 * reach)
        if np.abs(step[3:]).max() < 1e-4 and np.abs(step[:3]).max() / size < 2e-3:
            return


@compiled
def _distance(one: FloatArray, other: FloatArray) -> float:
    """Between two points (3,)."""
    return float(np.sqrt((one[0] - other[0]) ** 2 + (one[1] - other[1]) ** 2 + (one[2] - other[2]) ** 2))


@compiled
def _turn(step: FloatArray, size: float) -> FloatArray:
    """(3, 3) of the rotation vector step[:3] / size, each of its components at most 0.2 (Rodrigues)."""
    x, y, z = min(max(step[0] / size, -0.2), 0.2), min(max(step[1] / size, -0.2), 0.2), step[2] / size
    z = min(max(z, -0.2), 0.2)
    angle: float = np.sqrt(x * x + y * y + z * z) + 1e-12
    skew = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]]) / angle
    turn: FloatArray = np.eye(3) + np.sin(angle) * skew + (1.0 - np.cos(angle)) * (skew @ skew)
    return turn


@compiled
def _move(point: FloatArray, turn: FloatArray, centre: FloatArray, step: FloatArray) -> None:
    """Turn a point (3,) about the centre and shift it by step[3:], in place."""
    x, y, z = point[0] - centre[0], point[1] - centre[1], point[2] - centre[2]
    for k in range(3):
        point[k] = turn[k, 0] * x + turn[k, 1] * y + turn[k, 2] * z + centre[k] + step[3 + k]
