"""Laying a scan onto the seen surface of an object, and judging how well it explains what all cameras measured."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import correlate1d
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from gvla2.geometry.camera import Camera
from gvla2.geometry.transform import FloatArray, invert_rigid, rigid, transform_points
from gvla2.geometry.views import View
from gvla2.perception.nearest import NearestPoints, closest_points
from gvla2.perception.scans import TRUNCATED, KnownScan
from gvla2.planning.colours import appearance

TALLER = 0.02
"""Metres by which a resting pose may differ in height from the seen surface."""
TURNS = Rotation.from_rotvec(np.outer(np.arange(20) * (2 * np.pi / 20), [0.0, 0.0, 1.0])).as_matrix()
"""(20, 3, 3) turns about the vertical that are tried for each resting pose."""
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


class Sight(NamedTuple):
    """A camera; what it measured (H, W), metres, NaN where unknown or the robot is; and its looks (H, W, 3)."""

    camera: Camera
    depth: FloatArray
    image: FloatArray


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
    def cut(self) -> bool:
        """Whether it reaches the edge of each picture that shows it: no camera sees all of its outline."""
        whole = []
        for camera, depth, _ in self.sights:
            uv, z = camera.project(self.points)
            index = np.flatnonzero(camera.inside(uv))
            columns, rows = np.floor(uv[index]).astype(int).T
            here = uv[index][np.abs(depth[rows, columns] - z[index]) < NEAR]
            edge = ((here < EDGE) | (here > np.array([camera.width, camera.height]) - EDGE)).any()
            whole.append(len(here) >= 0.5 * len(self.points) and not edge)
        return not any(whole)


Sighting = tuple[FloatArray, NDArray[np.intp], NDArray[np.intp], NDArray[np.intp], FloatArray]
"""A camera's looks (H, W, 3); the indices (K,) of points that it has, their rows and columns, and how far behind each
the measured depth is, metres."""


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
    top = float(np.percentile(seen.points[:, 2], 99.0)) - seen.table
    heights = np.ptp(scan.corners @ scan.rests[:, 2].T, axis=0)
    fits = np.abs(heights - top) <= taller
    rests = scan.rests[fits]
    if not len(rests):
        return None
    # What is clearly taller than a scan that stands on the table, or lower, stands a little above it, or is sunk.
    rise = np.where(np.abs(top - heights) > NEAR, top - heights, 0.0)[fits].repeat(len(TURNS))
    turns = (TURNS @ rests[:, None]).reshape(-1, 3, 3)  # (P, 3, 3)
    lain = turns @ scan.corners.T  # (P, 3, H)
    low, high = lain.min(axis=2), lain.max(axis=2)
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
    forth = _truncated(scan.nearest, (spread - shifts[:, None]) @ turns).mean(axis=1)
    # The best ones are checked in reverse: does the scan's upper side lie where something is seen?
    checked = np.argsort(forth, kind="stable")[:CHECKED]
    some = slice(None, None, max(1, len(scan.points) // (2 * BACK)))
    placed = scan.points[some] @ turns[checked].transpose(0, 2, 1) + shifts[checked, None]
    upper = turns[checked, 2] @ scan.normals[some].T > 0.2
    back = (_truncated(seen.nearest, placed) * upper).sum(axis=1) / np.maximum(upper.sum(axis=1), 1)
    gaps = forth[checked] + np.where(upper.any(axis=1), back, TRUNCATED)
    best = np.argsort(gaps, kind="stable")
    # A can lies as well on its lid: each resting pose has a place among the best.
    lying = checked[best] % (len(TURNS) * len(rests)) // len(TURNS)
    among = np.array([np.count_nonzero(lying[:k] == lying[k]) for k in range(len(best))])
    best = best[np.argsort(among >= ALIKE, kind="stable")][:POSES]
    return float(gaps[best[0]]), [rigid(turns[i], shifts[i]) for i in checked[best]]


def _truncated(nearest: NearestPoints, points: FloatArray) -> FloatArray:
    """Distances of points (..., 3) from the nearest, at most :data:`TRUNCATED` metres."""
    return np.minimum(nearest.query(points)[0], TRUNCATED)


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


def sightings(points: FloatArray, normals: FloatArray, seen: SeenPoints) -> Iterator[Sighting]:
    """Of a surface's points (M, 3) with unit normals, what each camera in turn has in its picture and facing it."""
    for camera, depths, image in seen.sights:
        towards = camera.position - points
        facing = np.einsum("ij,ij->i", normals, towards) > 0.25 * np.linalg.norm(towards, axis=1)
        uv, z = camera.project(points[facing])
        inside = camera.inside(uv)
        columns, rows = np.floor(uv[inside]).astype(int).T
        before = depths[rows, columns] - z[inside]  # NaN compares false: unknown says nothing
        yield image, np.flatnonzero(facing)[inside], rows, columns, before


def judged(scan: KnownScan, seen: SeenPoints, pose: FloatArray) -> Fit:
    """How well a placed scan explains what all cameras measured."""
    points = seen.points[:: max(1, len(seen.points) // 700)]
    local = transform_points(invert_rigid(pose), points)
    gaps, nearest = scan.nearest.query(local)
    # Samples lie some millimetres apart: the distance to the plane at the nearest is that to the surface.
    flat = np.abs(np.einsum("ij,ij->i", local - scan.points[nearest], scan.normals[nearest]))
    off = np.where(gaps < 0.01, np.maximum(flat, gaps - 0.004), gaps)
    shown, through, differences = 0, 0, []
    some = slice(None, None, max(2, len(scan.points) // JUDGED))
    placed, turned = transform_points(pose, scan.points[some]), scan.normals[some] @ pose[:3, :3].T
    looks = scan.looks[some]
    for image, index, rows, columns, before in sightings(placed, turned, seen):
        here = np.abs(before) < NEAR
        shown += int(here.sum())
        through += int((before > GAP).sum())
        if here.sum() >= 5:
            difference = image[rows[here], columns[here]] - looks[index[here]]
            difference[:, 2] -= np.median(difference[:, 2])  # each camera's exposure may be another
            differences.append(np.linalg.norm(difference, axis=1))
    colour = float(np.minimum(np.concatenate(differences), 60.0).mean()) if differences else 100.0
    sunk = float((placed[:, 2] < seen.table - NEAR).mean())  # nothing reaches into the table
    return Fit(
        scan,
        pose,
        gap=float(np.minimum(off, TRUNCATED).mean()),
        residual=float(np.median(off)),
        explained=float((off < 0.006).mean()),
        support=float((off < 0.006).mean()) * len(seen.points),
        through=through / max(1, through + shown) + sunk,
        colour=colour,
    )


def turned(fit: Fit, seen: SeenPoints) -> Fit:
    """The fit at the turn about the vertical at which the colours agree best, where the shape allows others.

    The surface of a can or a bottle does not tell how it is turned; its label does.
    """
    middle = fit.world_from_scan[:3, 3]
    around = rigid(None, middle) @ np.stack([rigid(turn) for turn in TURNS[1:]]) @ rigid(None, -middle)
    found = [fit]
    for motion in around:
        pose = motion @ fit.world_from_scan
        points = transform_points(invert_rigid(pose), seen.points[:: max(1, len(seen.points) // FINE)])
        if _truncated(fit.scan.nearest, points).mean() < fit.gap + AS_WELL:
            found.append(judged(fit.scan, seen, pose))
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
    for camera, depth, image in sights:
        uv, z = camera.project(points)
        index = np.flatnonzero(camera.inside(uv))
        columns, rows = np.floor(uv[index]).astype(int).T
        own = np.abs(depth[rows, columns] - z[index]) < NEAR
        looks[index[own]] = image[rows[own], columns[own]]
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
