"""Laying a scan onto the seen surface of an object, and judging how well it explains what all cameras measured."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import correlate1d
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from gvla2.geometry.camera import Camera
from gvla2.geometry.compiled import compiled
from gvla2.geometry.transform import FloatArray, invert_rigid, rigid, transform_points
from gvla2.geometry.views import View
from gvla2.perception.nearest import NearestPoints, closest_points, explained_share
from gvla2.perception.scans import TRUNCATED, TURNS, KnownScan
from gvla2.planning.colours import appearance

TALLER = 0.02
"""Metres by which a resting pose may differ in height from the seen surface."""
COARSE, BACK, FINE = 60, 60, 200
"""Seen points, points of the scan's upper side, and seen points again: of a coarse start and of the refinement."""
CHECKED = 40
"""Starts of a scan that are checked in reverse."""
POSES, ALIKE = 4, 2
"""Starts of a scan that are refined, and the most of them in one resting pose where there are others."""
LEANS, AS_LIKELY = 0.2, 1.5
"""Lean that may only seem so, radians, and by how much less likely, in log-odds, the scan may be without it."""
AS_WELL = 0.002
"""A turned scan fits as well if the seen points are, on average, hardly farther from it, metres."""
ROUNDS = 14
"""Iterations of closest points."""
JUDGED = 2000
"""Samples of a scan that the cameras judge, about; half of those of a small one."""
NEAR = 0.008
"""Metres between the placed scan and the measured depth within which a pixel shows the scan."""
GAP = 0.012
"""Metres that the scan's surface lies before the measured depth when the camera looked through it."""
EDGE = 2
"""Pixels from a picture's edge within which what it shows may go on beyond it."""
BINS = 6
ODDS = (13.5, 1.85, 4.6, 16.0, 2.1)
"""Log-odds of a fit: a constant, and what is taken off for each millimetre of its gap, for the shares unexplained and
looked through, and for ten units of colour. By logistic regression on the right and the wrong fits of fifteen scans in
90 scenes, half of them seen by cameras that err; a wrong fit weighs three times a right one.
"""


@dataclass(frozen=True)
class Sight:
    """A camera; what it measured (H, W), metres, NaN where unknown or the robot is; and its looks (H, W, 3)."""

    camera: Camera
    depth: FloatArray
    image: FloatArray

    @cached_property
    def lens(self) -> FloatArray:
        """(5, 4) for compiled loops: three rows take a point to its pixel, a fourth to its depth; the last one is where
        the camera is, and a 1.
        """
        to_camera = self.camera.camera_from_world[:3]
        return np.vstack([self.camera.K @ to_camera, to_camera[2], [*self.camera.position, 1.0]])


Sights = Sequence[Sight]


@dataclass(frozen=True)
class SeenPoints:
    """An object's seen surface: ``points`` (N, 3) world, metres; what each camera measured; the table's height.

    ``looks`` (N, 3) of the points, NaN where no camera shows one, see :func:`~gvla2.planning.colours.appearance`.
    """

    points: FloatArray
    looks: FloatArray
    sights: Sights
    table: float

    @cached_property
    def nearest(self) -> NearestPoints:
        """The nearest of its points."""
        return NearestPoints(self.points, TRUNCATED)

    @cached_property
    def height(self) -> float:
        """Of its highest points over the table, metres."""
        return float(np.percentile(self.points[:, 2], 99.0)) - self.table

    @cached_property
    def cut(self) -> bool:
        """Whether it reaches the edge of each picture that shows it: no camera sees all of its outline."""
        whole = []
        for sight in self.sights:
            camera = sight.camera
            uv, z = camera.project(self.points)
            index = np.flatnonzero(camera.inside(uv))
            columns, rows = np.floor(uv[index]).astype(int).T
            here = uv[index][np.abs(sight.depth[rows, columns] - z[index]) < NEAR]
            edge = ((here < EDGE) | (here > np.array([camera.width, camera.height]) - EDGE)).any()
            whole.append(len(here) >= 0.5 * len(self.points) and not edge)
        return not any(whole)


@dataclass(frozen=True)
class Fit:
    """A scan placed by ``world_from_scan`` (4, 4), from the frame about its box's middle.

    ``gap`` is the mean truncated distance of the seen points from the scan, ``residual`` the median one, metres;
    ``explained`` the share of seen points that lie on it; ``through`` the share of its surface that cameras looked
    through, or that would lie in the table; ``colour`` the mean difference of looks between its surface and the
    pictures.
    """

    scan: KnownScan
    world_from_scan: FloatArray
    gap: float
    residual: float
    explained: float
    through: float
    colour: float
    support: float

    @property
    def odds(self) -> float:
        """Log-odds that the scan is the object."""
        constant, gap, missed, through, colour = ODDS
        return (
            constant
            - gap * 1e3 * self.gap
            - missed * (1.0 - self.explained)
            - through * self.through
            - colour * 0.1 * self.colour
        )


def coarse_starts(
    scan: KnownScan, seen: SeenPoints, taller: float = TALLER
) -> tuple[float, list[FloatArray]] | None:
    """The best poses (4, 4) of a scan on the table and the best one's mean distance, metres.

    None if no resting pose has the seen height, but for ``taller`` metres.
    """
    turns, low, high = scan.lying
    heights = high[:, 0, 2] - low[:, 0, 2]
    fits = np.abs(heights - seen.height) <= taller
    if not fits.any():
        return None
    turns = turns[fits].reshape(-1, 3, 3)  # (P, 3, 3)
    low, high = low[fits].reshape(-1, 3), high[fits].reshape(-1, 3)
    # What is clearly taller than a scan that stands on the table, or lower, stands a little above it, or is sunk.
    off = (seen.height - heights)[fits].repeat(len(TURNS))
    rise = np.where(np.abs(off) > NEAR, off, 0.0)
    # The scan's own outline is laid where the seen outline is; of one that pictures cut off, along each of its sides.
    seen_low, seen_high = seen.points[:, :2].min(axis=0), seen.points[:, :2].max(axis=0)
    shares = np.array([0.5]) if not seen.cut else np.array([0.0, 0.5, 1.0])
    share = np.stack(np.meshgrid(shares, shares), axis=-1).reshape(-1, 1, 2)
    level = share * (seen_low - low[:, :2]) + (1.0 - share) * (seen_high - high[:, :2])  # (S, P, 2)
    shifts = np.concatenate(
        [level, np.broadcast_to((seen.table + rise - low[:, 2])[:, None], (*level.shape[:2], 1))], axis=-1
    )
    shifts, turns = shifts.reshape(-1, 3), np.tile(turns, (len(share), 1, 1))
    spread = seen.points[:: max(1, len(seen.points) // COARSE)]
    forth = scan.nearest.mean_distances(spread, turns, shifts, TRUNCATED)
    # The best ones are checked in reverse: does the scan's upper side lie where something is seen?
    checked = np.argsort(forth, kind="stable")[:CHECKED]
    some = slice(None, None, max(1, len(scan.points) // (2 * BACK)))
    placed = scan.points[some] @ turns[checked].transpose(0, 2, 1) + shifts[checked, None]
    upper = turns[checked, 2] @ scan.normals[some].T > 0.2
    away = np.minimum(seen.nearest.query(placed)[0], TRUNCATED)
    back = (away * upper).sum(axis=1) / np.maximum(upper.sum(axis=1), 1)
    gaps = forth[checked] + np.where(upper.any(axis=1), back, TRUNCATED)
    best = np.argsort(gaps, kind="stable")
    # A can lies as well on its lid: each resting pose has a place among the best.
    lying = checked[best] % len(low) // len(TURNS)
    among = np.tril(lying[:, None] == lying, -1).sum(axis=1)
    best = best[np.argsort(among >= ALIKE, kind="stable")][:POSES]
    return float(gaps[best[0]]), [rigid(turns[i], shifts[i]) for i in checked[best]]


def refined(scan: KnownScan, seen: SeenPoints, pose: FloatArray, fine: int = FINE) -> FloatArray:
    """The pose (4, 4) after iterated closest points, point to plane, the farthest fifth of the pairs left out; about
    ``fine`` of the seen points are used.
    """
    points = seen.points[:: max(1, len(seen.points) // fine)]
    scan_from_world = invert_rigid(pose)
    nearest = scan.nearest
    closest_points(
        transform_points(scan_from_world, points), scan.points, scan.normals, nearest.table, nearest.low,
        nearest.cell, ROUNDS, scan_from_world,
    )  # fmt: skip
    return invert_rigid(scan_from_world)


def visible(
    points: FloatArray, normals: FloatArray, pose: FloatArray, seen: SeenPoints
) -> tuple[int, int, list[NDArray[np.int64]]]:
    """Of the samples (M, 3) of a surface with unit normals, placed by ``pose`` (4, 4): how many the cameras show, how
    many they looked through, and for each camera the indices, rows and columns (3, K) of those that it shows.
    """
    points, normals = np.ascontiguousarray(points), np.ascontiguousarray(normals)
    shown, through, where = 0, 0, []
    for sight in seen.sights:
        here, beyond, found = _sighted(points, normals, pose, sight.lens, sight.depth)
        shown, through = shown + here, through + beyond
        where.append(found)
    return shown, through, where


@compiled
def _sighted(
    points: FloatArray,
    normals: FloatArray,
    pose: FloatArray,
    lens: FloatArray,
    depth: FloatArray,
) -> tuple[int, int, NDArray[np.int64]]:
    """:func:`visible` for one camera."""
    shown, through, point = 0, 0, np.empty(3)
    found = np.empty((3, len(points)), np.int64)
    for n in range(len(points)):
        for k in range(3):
            x, y, z = points[n, 0], points[n, 1], points[n, 2]
            point[k] = pose[k, 0] * x + pose[k, 1] * y + pose[k, 2] * z + pose[k, 3]
        facing, away = 0.0, 0.0
        for k in range(3):
            towards = lens[4, k] - point[k]
            x, y, z = normals[n, 0], normals[n, 1], normals[n, 2]
            facing += (pose[k, 0] * x + pose[k, 1] * y + pose[k, 2] * z) * towards
            away += towards * towards
        if facing <= 0.25 * np.sqrt(away):
            continue
        u, v, ahead = _pixel(lens, point[0], point[1], point[2])
        if not (0.0 <= u < depth.shape[1] and 0.0 <= v < depth.shape[0]):
            continue
        before = depth[int(v), int(u)] - ahead  # NaN compares false: unknown says nothing
        if abs(before) < NEAR:
            found[0, shown], found[1, shown], found[2, shown] = n, int(v), int(u)
            shown += 1
        elif before > GAP:
            through += 1
    return shown, through, found[:, :shown].copy()


@compiled
def _pixel(lens: FloatArray, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Where a :attr:`Sight.lens` has a point, in pixels (NaN behind the camera), and the point's depth, metres."""
    u = lens[0, 0] * x + lens[0, 1] * y + lens[0, 2] * z + lens[0, 3]
    v = lens[1, 0] * x + lens[1, 1] * y + lens[1, 2] * z + lens[1, 3]
    w = lens[2, 0] * x + lens[2, 1] * y + lens[2, 2] * z + lens[2, 3]
    ahead = lens[3, 0] * x + lens[3, 1] * y + lens[3, 2] * z + lens[3, 3]
    return (u / w, v / w, ahead) if ahead > 0.0 else (np.nan, np.nan, ahead)


@compiled
def mark_free(
    state: NDArray[np.float32],
    low: FloatArray,
    cell: float,
    lens: FloatArray,
    depth: FloatArray,
    behind: float,
) -> None:
    """Set those of the cells (H, R, C) from ``low`` (3,) on to -1 where a camera measured something more than
    ``behind`` metres behind their middles.
    """
    levels, rows, columns = state.shape
    for level in range(levels):
        z = low[2] + cell * (level + 0.5)
        for row in range(rows):
            x = low[0] + cell * (row + 0.5)
            for column in range(columns):
                u, v, ahead = _pixel(lens, x, low[1] + cell * (column + 0.5), z)
                inside = 0.0 <= u < depth.shape[1] and 0.0 <= v < depth.shape[0]
                if inside and depth[int(v), int(u)] > ahead + behind:
                    state[level, row, column] = -1.0


def judged(scan: KnownScan, seen: SeenPoints, pose: FloatArray) -> Fit:
    """How well a placed scan explains what all cameras measured."""
    points, nearest = seen.points[:: max(1, len(seen.points) // 700)], scan.nearest
    local = np.ascontiguousarray(transform_points(invert_rigid(pose), points))
    gap, residual, explained = explained_share(
        local, scan.points, scan.normals, nearest.table, nearest.low, nearest.cell, TRUNCATED
    )
    some = slice(None, None, max(2, len(scan.points) // JUDGED))
    samples, looks = scan.points[some], np.ascontiguousarray(scan.looks[some])
    shown, through, where = visible(samples, scan.normals[some], pose, seen)
    off, compared = 0.0, 0
    for sight, found in zip(seen.sights, where, strict=True):
        if found.shape[1] >= 5:
            off += _unlike(sight.image, looks, found)
            compared += found.shape[1]
    heights = samples @ pose[2, :3] + pose[2, 3]
    sunk = np.count_nonzero(heights < seen.table - NEAR) / len(samples)  # nothing reaches into the table
    return Fit(
        scan,
        pose,
        gap=gap,
        residual=residual,
        explained=explained,
        support=explained * len(seen.points),
        through=through / max(1, through + shown) + sunk,
        colour=off / compared if compared else 100.0,
    )


@compiled
def _unlike(image: FloatArray, looks: FloatArray, found: NDArray[np.int64]) -> float:
    """Sum of the differences, each at most 60, between a picture's looks (H, W, 3) and those of the samples (M, 3) that
    it shows, ``found`` (3, K) as in :func:`visible`; each camera's exposure may be another.
    """
    count, total = found.shape[1], 0.0
    brighter = np.empty(count)
    for k in range(count):
        brighter[k] = image[found[1, k], found[2, k], 2] - looks[found[0, k], 2]
    exposure = np.median(brighter)
    for k in range(count):
        square = (brighter[k] - exposure) ** 2
        for c in range(2):
            square += (image[found[1, k], found[2, k], c] - looks[found[0, k], c]) ** 2
        total += min(np.sqrt(square), 60.0)
    return total


def turned(fit: Fit, seen: SeenPoints) -> Fit:
    """The fit at the turn about the vertical at which the colours agree best, where the shape allows others.

    The surface of a can or a bottle does not tell how it is turned; its label does.
    """
    poses = np.tile(fit.world_from_scan, (len(TURNS) - 1, 1, 1))
    poses[:, :3, :3] = TURNS[1:] @ poses[:, :3, :3]  # about the scan's middle, which stays
    some = seen.points[:: max(1, len(seen.points) // FINE)]
    gaps = fit.scan.nearest.mean_distances(some, poses[:, :3, :3], poses[:, :3, 3], TRUNCATED)
    found = [fit, *(judged(fit.scan, seen, pose) for pose in poses[gaps < fit.gap + AS_WELL])]
    return max(found, key=lambda one: one.odds)


def levelled(fit: Fit, seen: SeenPoints) -> Fit:
    """The fit at rest on a level surface, if that explains what is seen about as well: an object seen from one side
    seems to lean.
    """
    turn = fit.world_from_scan[:3, :3]
    rests: FloatArray = fit.scan.rests
    rest = rests[int(np.argmax(rests[:, 2] @ turn[2]))]
    axis = np.cross(turn[2], rest[2])  # in the scan's frame: from its present vertical to that of the rest
    angle = float(np.arcsin(min(1.0, float(np.linalg.norm(axis)))))
    if turn[2] @ rest[2] < 0.0 or not 1e-3 < angle < LEANS:
        return fit
    upright = turn @ Rotation.from_rotvec(-axis / np.linalg.norm(axis) * angle).as_matrix()
    if upright[2] @ rest[2] < np.cos(0.01):
        return fit
    pivot = seen.points.mean(axis=0)  # what is seen stays in place
    local = transform_points(invert_rigid(fit.world_from_scan), pivot)
    level = judged(fit.scan, seen, rigid(upright, pivot - upright @ local))
    return level if level.odds > fit.odds - AS_LIKELY else fit


def sights_of(views: Iterable[View]) -> list[Sight]:
    """What the cameras with depth saw."""
    sights = []
    for view in views:
        if view.depth is None:
            continue
        depth = np.asarray(view.depth, dtype=np.float64)
        hidden = ~np.isfinite(depth) | (depth <= 0)
        if view.robot_mask is not None:
            hidden |= view.robot_mask
        sights.append(Sight(view.camera, np.where(hidden, np.nan, depth), appearance(view.image / 255.0)))
    return sights


def seen_surface(points: FloatArray, sights: Sights, table: float) -> SeenPoints:
    """The seen surface of one object, its looks from the views."""
    points = without_strays(points)
    looks = np.full(points.shape, np.nan)
    for sight in sights:
        uv, z = sight.camera.project(points)
        index = np.flatnonzero(sight.camera.inside(uv))
        columns, rows = np.floor(uv[index]).astype(int).T
        own = np.abs(sight.depth[rows, columns] - z[index]) < NEAR
        looks[index[own]] = sight.image[rows[own], columns[own]]
    return SeenPoints(points, looks, sights, table)


def without_strays(points: FloatArray, reach: float = 0.007, least: int = 4) -> FloatArray:
    """The points (N, 3) that have ``least`` others within ``reach`` metres: flying pixels hang alone in the air."""
    if len(points) <= least:
        return points
    gaps = np.asarray(cKDTree(points).query(points, k=least + 1, distance_upper_bound=reach)[0])
    kept = np.isfinite(gaps[:, -1])
    return points[kept] if kept.sum() > 0.5 * len(points) else points


def histogram(looks: FloatArray) -> FloatArray:
    """Shares of looks (N, 3) in bins of hue and lightness, smoothed over neighbours: light and noise move them."""
    edges = [np.linspace(-75.0, 75.0, BINS + 1), np.linspace(-75.0, 75.0, BINS + 1), np.linspace(0, 50, 4)]
    inside = np.clip(looks, [-74.9, -74.9, 0.1], [74.9, 74.9, 49.9])
    counts = np.histogramdd(inside, edges)[0]
    for axis in range(3):
        counts = correlate1d(counts, [0.5, 1.0, 0.5], axis, mode="constant")
    return np.asarray(counts.ravel() / max(counts.sum(), 1e-9))
