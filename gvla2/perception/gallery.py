"""Registering a scan to the seen surface of an object: many coarse starts, the best refined, scored in all views."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from gvla2.geometry.camera import Camera
from gvla2.geometry.transform import FloatArray, invert_rigid, rigid, transform_points
from gvla2.geometry.views import Observation
from gvla2.perception.labels import Naming
from gvla2.perception.scans import KnownScan, check_names, diameter, read_scans
from gvla2.planning.colours import appearance
from gvla2.planning.scene import KnownShape, Scene, SceneObject

YAWS = 20
"""Turns about the vertical tried for each resting pose."""
COARSE, BACK, FINE = 60, 60, 260
"""Seen points, points of the scan's upper side, and seen points again: of a coarse start and of the refinement."""
TRUNCATED = 0.02
"""Metres at which a point's distance is truncated."""
TALLER = 0.02
"""Metres by which a resting pose may differ in height from the seen surface."""
ROUNDS = 14
NEAR = 0.008
"""Metres between the placed scan and the measured depth within which a pixel shows the scan."""
GAP = 0.012
"""Metres that the scan's surface lies before the measured depth when the camera looked through it."""


@dataclass(frozen=True)
class Seen:
    """An object's seen surface: ``points`` (N, 3) world, metres; the cameras with what each measured.

    ``depths`` (H, W) metres, NaN where nothing is known, and ``looks`` (H, W, 3), see
    :func:`~gvla2.planning.colours.appearance`, one a camera; ``table`` is the table's height there.
    """

    points: FloatArray
    looks: FloatArray
    tree: cKDTree
    cameras: tuple[Camera, ...]
    depths: tuple[FloatArray, ...]
    images: tuple[FloatArray, ...]
    table: float


@dataclass(frozen=True)
class Fit:
    """A scan placed by ``world_from_scan`` (4, 4), from the frame about its box's middle.

    ``gap`` is the mean truncated distance of the seen points from the scan, ``residual`` the median one, metres;
    ``explained`` the share of seen points that lie on it; ``through`` the share of its surface that cameras looked
    through, or that would lie in the table; ``colour`` the mean difference of looks between its surface and the
    pictures, over ``count`` compared points.
    """

    scan: KnownScan
    world_from_scan: FloatArray
    gap: float
    residual: float
    explained: float
    through: float
    colour: float
    count: int


def coarse_starts(scan: KnownScan, seen: Seen, keep: int = 4) -> list[tuple[float, FloatArray]]:
    """The best poses (4, 4) of a scan on the table with their mean distances, metres; empty if no resting pose has the
    seen height.
    """
    top = float(np.percentile(seen.points[:, 2], 99.0)) - seen.table
    spread = seen.points[:: max(1, len(seen.points) // COARSE)]
    middle = 0.5 * (seen.points[:, :2].min(axis=0) + seen.points[:, :2].max(axis=0))
    poses: list[FloatArray] = []
    for rest in scan.rests:
        lain = scan.points @ rest.T
        low, high = float(lain[:, 2].min()), float(lain[:, 2].max())
        if abs(high - low - top) > TALLER:
            continue
        for yaw in np.arange(YAWS) * (2 * np.pi / YAWS):
            turn = Rotation.from_euler("z", yaw).as_matrix() @ rest
            # Where the seen outline is, the scan's own outline is laid.
            flat = scan.points @ turn[:2].T
            off = 0.5 * (flat.min(axis=0) + flat.max(axis=0))
            poses.append(rigid(turn, [*(middle - off), seen.table - low]))
    if not poses:
        return []
    there = np.stack([transform_points(invert_rigid(pose), spread) for pose in poses])
    forth = np.minimum(scan.tree.query(there, distance_upper_bound=TRUNCATED)[0], TRUNCATED).mean(axis=1)
    # Only half of the starts are checked in reverse: does the scan's upper side lie where something is seen?
    order = np.argsort(forth, kind="stable")[: max(8, len(poses) // 2)]
    gaps = forth.copy() + TRUNCATED
    sample = np.arange(0, len(scan.points), max(1, len(scan.points) // (2 * BACK)))
    for i in order:
        upper = sample[scan.normals[sample] @ poses[i][2, :3] > 0.2][:BACK]
        placed = transform_points(poses[i], scan.points[upper])
        back = seen.tree.query(placed, distance_upper_bound=TRUNCATED)[0]
        gaps[i] = forth[i] + float(np.minimum(back, TRUNCATED).mean()) if len(upper) else forth[i] + TRUNCATED
    best = np.argsort(gaps, kind="stable")[:keep]
    return [(float(gaps[i]), poses[i]) for i in best]


def refined(scan: KnownScan, seen: Seen, pose: FloatArray) -> FloatArray:
    """The pose (4, 4) after iterated closest points, point to plane, the farthest fifth of the pairs left out."""
    points = seen.points[:: max(1, len(seen.points) // FINE)]
    reach = TRUNCATED
    for _ in range(ROUNDS):
        local = transform_points(invert_rigid(pose), points)
        gaps, nearest = nearest_on(scan, local)
        used = gaps <= max(min(reach, float(np.percentile(gaps, 80))), 0.002)
        if used.sum() < 12:
            break
        target, normal = scan.points[nearest[used]], scan.normals[nearest[used]]
        centre = local[used].mean(axis=0)
        arms = local[used] - centre
        rows = np.concatenate([np.cross(arms, normal), normal], axis=1)
        wrong = np.einsum("ij,ij->i", local[used] - target, normal)
        # A little damping: on a ball or a can the turn about its axis is free.
        size = float(np.linalg.norm(arms, axis=1).mean()) + 1e-6
        scaling = np.array([1 / size] * 3 + [1.0] * 3)
        scaled = rows * scaling
        normal_matrix = scaled.T @ scaled + 1e-2 * len(rows) * np.eye(6) * 0.1
        step = scaling * np.linalg.solve(normal_matrix, -scaled.T @ wrong)
        turn = Rotation.from_rotvec(np.clip(step[:3], -0.2, 0.2)).as_matrix()
        moved = rigid(turn, centre - turn @ centre + step[3:])
        pose = pose @ invert_rigid(moved)
        reach = max(0.006, 0.75 * reach)
        if np.abs(step[3:]).max() < 1e-4 and np.abs(step[:3]).max() < 2e-3:
            break
    return pose


def nearest_on(scan: KnownScan, points: FloatArray) -> tuple[FloatArray, NDArray[np.intp]]:
    """Distances (N,) of points (N, 3) in the scan's frame from its nearest samples, and the samples' indices (N,)."""
    gaps, nearest = scan.tree.query(points)
    return np.asarray(gaps, dtype=np.float64), np.asarray(nearest, dtype=np.intp)


def judged(scan: KnownScan, seen: Seen, pose: FloatArray) -> Fit:
    """How well a placed scan explains what all cameras measured."""
    points = seen.points[:: max(1, len(seen.points) // 700)]
    local = transform_points(invert_rigid(pose), points)
    gaps, nearest = nearest_on(scan, local)
    # Samples lie some millimetres apart: the distance to the plane at the nearest is that to the surface.
    flat = np.abs(np.einsum("ij,ij->i", local - scan.points[nearest], scan.normals[nearest]))
    off = np.where(gaps < 0.01, np.maximum(flat, gaps - 0.004), gaps)
    shown, through, differences = 0, 0, []
    placed, turned = transform_points(pose, scan.points), scan.normals @ pose[:3, :3].T
    for camera, depths, image in zip(seen.cameras, seen.depths, seen.images, strict=True):
        towards = np.einsum("ij,ij->i", turned, camera.position - placed)
        facing = towards > 0.25 * np.linalg.norm(camera.position - placed, axis=1)
        uv, z = camera.project(placed[facing])
        inside = camera.inside(uv)
        columns, rows = np.floor(uv[inside]).astype(int).T
        before = depths[rows, columns] - z[inside]  # NaN compares false: unknown says nothing
        here = np.abs(before) < NEAR
        shown += int(here.sum())
        through += int((before > GAP).sum())
        differences.append(
            np.stack([image[rows[here], columns[here]], scan.looks[facing][inside][here]], axis=1)
        )
    colour, count = _colour_gap(differences)
    sunk = float((placed[:, 2] < seen.table - NEAR).mean())  # nothing reaches into the table
    return Fit(
        scan,
        pose,
        float(np.minimum(off, TRUNCATED).mean()),
        float(np.median(off)),
        float((off < 0.006).mean()),
        through / max(1, through + shown) + sunk,
        colour,
        count,
    )


def _colour_gap(pairs: Sequence[FloatArray]) -> tuple[float, int]:
    """Median difference of looks (N, 2, 3) over all cameras; each camera's exposure may be another."""
    gaps = []
    for both in pairs:
        if len(both) >= 10:
            off = both[:, 0] - both[:, 1]
            off[:, 2] -= np.median(off[:, 2])
            gaps.append(np.linalg.norm(off, axis=1))
    if not gaps:
        return 100.0, 0
    every = np.concatenate(gaps)
    return float(np.mean(np.minimum(every, 60.0))), len(every)


def seen_surface(
    points: FloatArray, cameras: Sequence[Camera], depths: Sequence[FloatArray], images: Sequence[FloatArray],
    table: float,
) -> Seen:  # fmt: skip
    """The seen surface of one object; ``images`` (H, W, 3) are looks already. Looks of points come from the views."""
    points = without_strays(points)
    looks = np.full(points.shape, np.nan)
    for camera, depth, image in zip(cameras, depths, images, strict=True):
        uv, z = camera.project(points)
        inside = camera.inside(uv)
        columns, rows = np.floor(uv[inside]).astype(int).T
        own = np.nonzero(inside)[0][np.abs(depth[rows, columns] - z[inside]) < NEAR]
        columns, rows = np.floor(uv[own]).astype(int).T
        looks[own] = image[rows, columns]
    return Seen(points, looks, cKDTree(points), tuple(cameras), tuple(depths), tuple(images), table)


def without_strays(points: FloatArray, reach: float = 0.007, least: int = 4) -> FloatArray:
    """The points (N, 3) that have ``least`` others within ``reach`` metres: flying pixels hang alone in the air."""
    if len(points) <= least:
        return points
    gaps = np.asarray(cKDTree(points).query(points, k=least + 1, distance_upper_bound=reach)[0])
    kept = np.isfinite(gaps[:, -1])
    return points[kept] if kept.sum() > 0.5 * len(points) else points


def look_of(image: np.ndarray) -> FloatArray:
    """(H, W, 3) looks of a picture of bytes."""
    return appearance(image / 255.0)


LEAST = 40
"""Least seen points for an object to be recognised."""
REFINED = 10
"""Number of scans refined among those whose size and colours fit."""
BINS = 6
LEAST_SHARED = 0.12
"""Overlap of the colour histograms below which a scan is not tried."""


@dataclass(frozen=True)
class Odds:
    """From a fit's measures to the log-odds that the scan is the object: one weight per measure and a constant."""

    constant: float
    gap: float
    missed: float
    through: float
    colour: float

    def of(self, fit: Fit) -> float:
        """Positive if it is more likely than not."""
        return (
            self.constant
            - self.gap * 1e3 * fit.gap
            - self.missed * (1.0 - fit.explained)
            - self.through * fit.through
            - self.colour * 0.1 * fit.colour
        )


ODDS = Odds(constant=13.5, gap=1.85, missed=4.6, through=16.0, colour=2.1)
"""By logistic regression on the right and the wrong fits of fifteen scans in 90 scenes, half of them seen by cameras
that err; a wrong fit weighs three times a right one.
"""


class Gallery:
    """A :class:`~gvla2.perception.labels.Labeller` that knows a folder of scans.

    Raises :class:`ConfigurationError` for a folder without meshes and for duplicate names.
    """

    source = "gallery"

    def __init__(self, folder: str | os.PathLike[str]) -> None:
        self._folder, self._scans = folder, tuple(read_scans(folder))
        self._histograms = [histogram(scan.looks) for scan in self._scans]

    @classmethod
    def of(cls, scans: Sequence[KnownScan]) -> Gallery:
        """A gallery of scans already read."""
        check_names(scans)
        made = cls.__new__(cls)
        made._folder, made._scans = "", tuple(scans)
        made._histograms = [histogram(scan.looks) for scan in scans]
        return made

    def names(self, objects: Sequence[SceneObject], scene: Scene, observation: Observation) -> list[Naming]:
        """One answer per object, in order."""
        views = [view for view in observation.views if view.depth is not None]
        cameras, depths = [view.camera for view in views], []
        for view in views:
            depth = np.asarray(view.depth, dtype=np.float64)
            hidden = ~np.isfinite(depth) | (depth <= 0)
            if view.robot_mask is not None:
                hidden |= view.robot_mask
            depths.append(np.where(hidden, np.nan, depth))
        images = [look_of(view.image) for view in views]
        answers = []
        for obj in objects:
            if len(obj.points) < LEAST:
                answers.append(Naming("", 0.0, why=f"Only {len(obj.points)} points of it are seen."))
                continue
            answers.append(self.name(seen_surface(obj.points, cameras, depths, images, scene.table_height)))
        return answers

    def name(self, seen: Seen) -> Naming:
        """The name of a seen surface."""
        fits = self.fits(seen)
        if not fits:
            return Naming("", 1.0, why="No scan in the gallery has its size and colours.")
        best, odds = fits[0], [ODDS.of(fit) for fit in fits]
        # Against all others and "unknown": a name must be likelier than the rest together.
        rest = np.exp(np.clip(odds[1:], -30.0, 30.0)).sum()
        first = float(np.exp(np.clip(odds[0], -30.0, 30.0)))
        sure = first / (1.0 + first + float(rest))
        nearest = f"Nearest: {best.scan.name}, {1e3 * best.residual:.0f} mm off."
        if sure < 0.5:
            return Naming("", 1.0 / (1.0 + first), why=nearest)
        return Naming(best.scan.name, float(sure), known_shape(best))

    def fits(self, seen: Seen) -> list[Fit]:
        """The candidate scans, each at its best pose, likeliest first."""
        known = np.isfinite(seen.looks).all(axis=1)
        own = histogram(seen.looks[known]) if known.any() else None
        size = diameter(seen.points)
        starts: list[tuple[float, KnownScan, list[FloatArray]]] = []
        for scan, colours in zip(self._scans, self._histograms, strict=True):
            if not 0.6 * scan.diameter - 0.01 < size < 1.05 * scan.diameter + 0.01:
                continue
            if own is not None and np.minimum(own, colours).sum() < LEAST_SHARED:
                continue
            if found := coarse_starts(scan, seen):
                starts.append((found[0][0], scan, [pose for _, pose in found]))
        starts.sort(key=lambda each: each[0])
        best = []
        for _, scan, poses in starts[:REFINED]:
            tried = [judged(scan, seen, refined(scan, seen, pose)) for pose in poses]
            best.append(max(tried, key=ODDS.of))
        return sorted(best, key=ODDS.of, reverse=True)


def known_shape(fit: Fit) -> KnownShape:
    """The scan at its pose, in its file's frame and units."""
    pose = fit.world_from_scan @ rigid(None, -fit.scan.middle)
    return KnownShape(fit.scan.name, fit.scan.path, pose, fit.scan.scale, round(fit.residual, 5))


def histogram(looks: FloatArray) -> FloatArray:
    """Shares of looks (N, 3) in bins of hue and lightness, smoothed over neighbours: light and noise move them."""
    edges = [np.linspace(-75.0, 75.0, BINS + 1), np.linspace(-75.0, 75.0, BINS + 1), np.linspace(0, 50, 4)]
    inside = np.clip(looks, [-74.9, -74.9, 0.1], [74.9, 74.9, 49.9])
    counts = np.histogramdd(inside, edges)[0]
    for axis in range(3):
        padded = np.moveaxis(np.pad(counts, [(1, 1) if a == axis else (0, 0) for a in range(3)]), axis, 0)
        counts = np.moveaxis(padded[1:-1] + 0.5 * (padded[:-2] + padded[2:]), 0, axis)
    return np.asarray(counts.ravel() / max(counts.sum(), 1e-9))
