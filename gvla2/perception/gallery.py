"""Names of known objects: scans laid onto the seen surface of an object in every way that they can lie.

Coarse rejection by size and colours, then a few hundred starts a scan, the best refined by iterated closest points, and
all cameras judge the result.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import correlate1d
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from gvla2.geometry.camera import Camera
from gvla2.geometry.transform import FloatArray, invert_rigid, rigid, transform_points
from gvla2.geometry.views import Observation, View
from gvla2.perception.labels import SURE_ENOUGH, Naming
from gvla2.perception.nearest import NearestPoints, closest_points
from gvla2.perception.objects import object_of, opening_of
from gvla2.perception.scans import TRUNCATED, KnownScan, check_names, corners_of, diameter, read_scans
from gvla2.planning.colours import appearance
from gvla2.planning.scene import KnownShape, Scene, SceneObject

LEAST = 40
"""Least seen points for an object to be recognised."""
LEAST_SHARED = 0.12
"""Overlap of the colour histograms below which a scan is not tried."""
TALLER = 0.02
"""Metres by which a resting pose may differ in height from the seen surface."""
TURNS = Rotation.from_rotvec(np.outer(np.arange(20) * (2 * np.pi / 20), [0.0, 0.0, 1.0])).as_matrix()
"""(20, 3, 3) turns about the vertical that are tried for each resting pose."""
COARSE, BACK, FINE = 60, 60, 200
"""Seen points, points of the scan's upper side, and seen points again: of a coarse start and of the refinement."""
CHECKED = 40
"""Starts of a scan that are checked in reverse."""
POSES = 4
"""Starts of a scan that are refined."""
REFINED, THOROUGH = 6, 2
"""Number of scans whose best start is refined; and of the likeliest of these, whose other starts are refined too."""
AS_WELL = 0.002
"""A turned scan fits as well if the seen points are, on average, hardly farther from it, metres."""
ROUNDS = 14
"""Iterations of closest points."""
NEAR = 0.008
"""Metres between the placed scan and the measured depth within which a pixel shows the scan."""
GAP = 0.012
"""Metres that the scan's surface lies before the measured depth when the camera looked through it."""
BINS = 6


@dataclass(frozen=True)
class SeenPoints:
    """An object's seen surface: ``points`` (N, 3) world, metres; the cameras with what each measured.

    ``looks`` (N, 3) of the points, NaN where no camera shows one, see :func:`~gvla2.planning.colours.appearance`;
    ``depths`` (H, W) metres, NaN where nothing is known, and ``images`` (H, W, 3) looks, one a camera; ``table`` is the
    table's height.
    """

    points: FloatArray
    looks: FloatArray
    nearest: NearestPoints
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
    pictures.
    """

    scan: KnownScan
    world_from_scan: FloatArray
    gap: float
    residual: float
    explained: float
    through: float
    colour: float


@dataclass(frozen=True)
class Recognised:
    """A whole object that a scan explains."""

    object: SceneObject
    fit: Fit

    def explains(self, points: FloatArray) -> NDArray[np.bool_]:
        """(N,) which of the world points (N, 3) lie on the placed scan."""
        local = transform_points(invert_rigid(self.fit.world_from_scan), points)
        return self.fit.scan.nearest.query(local)[0] < NEAR


def coarse_starts(scan: KnownScan, seen: SeenPoints) -> tuple[float, list[FloatArray]] | None:
    """The best poses (4, 4) of a scan on the table and the best one's mean distance, metres.

    None if no resting pose has the seen height.
    """
    top = float(np.percentile(seen.points[:, 2], 99.0)) - seen.table
    heights = np.ptp(scan.corners @ scan.rests[:, 2].T, axis=0)
    rests = scan.rests[np.abs(heights - top) <= TALLER]
    if not len(rests):
        return None
    turns = (TURNS @ rests[:, None]).reshape(-1, 3, 3)  # (P, 3, 3)
    lain = turns @ scan.corners.T  # (P, 3, H)
    low, high = lain.min(axis=2), lain.max(axis=2)
    # The scan's own outline is laid where the seen outline is.
    middle = 0.5 * (seen.points[:, :2].min(axis=0) + seen.points[:, :2].max(axis=0))
    shifts = np.column_stack([middle - 0.5 * (low + high)[:, :2], seen.table - low[:, 2]])
    spread = seen.points[:: max(1, len(seen.points) // COARSE)]
    forth = _truncated(scan.nearest, (spread - shifts[:, None]) @ turns).mean(axis=1)
    # The best ones are checked in reverse: does the scan's upper side lie where something is seen?
    checked = np.argsort(forth, kind="stable")[:CHECKED]
    some = slice(None, None, max(1, len(scan.points) // (2 * BACK)))
    placed = scan.points[some] @ turns[checked].transpose(0, 2, 1) + shifts[checked, None]
    upper = turns[checked, 2] @ scan.normals[some].T > 0.2
    back = (_truncated(seen.nearest, placed) * upper).sum(axis=1) / np.maximum(upper.sum(axis=1), 1)
    gaps = forth[checked] + np.where(upper.any(axis=1), back, TRUNCATED)
    best = np.argsort(gaps, kind="stable")[:POSES]
    return float(gaps[best[0]]), [rigid(turns[i], shifts[i]) for i in checked[best]]


def _truncated(nearest: NearestPoints, points: FloatArray) -> FloatArray:
    """Distances of points (..., 3) from the nearest, at most :data:`TRUNCATED` metres."""
    return np.minimum(nearest.query(points)[0], TRUNCATED)


def refined(scan: KnownScan, seen: SeenPoints, pose: FloatArray) -> FloatArray:
    """The pose (4, 4) after iterated closest points, point to plane, the farthest fifth of the pairs left out."""
    points = seen.points[:: max(1, len(seen.points) // FINE)]
    scan_from_world = invert_rigid(pose)
    nearest = scan.nearest
    closest_points(
        transform_points(scan_from_world, points), scan.points, scan.normals, nearest.table, nearest.low,
        nearest.cell, ROUNDS, scan_from_world,
    )  # fmt: skip
    return invert_rigid(scan_from_world)


def judged(scan: KnownScan, seen: SeenPoints, pose: FloatArray) -> Fit:
    """How well a placed scan explains what all cameras measured."""
    points = seen.points[:: max(1, len(seen.points) // 700)]
    local = transform_points(invert_rigid(pose), points)
    gaps, nearest = scan.nearest.query(local)
    # Samples lie some millimetres apart: the distance to the plane at the nearest is that to the surface.
    flat = np.abs(np.einsum("ij,ij->i", local - scan.points[nearest], scan.normals[nearest]))
    off = np.where(gaps < 0.01, np.maximum(flat, gaps - 0.004), gaps)
    shown, through, differences = 0, 0, []
    placed, turned = transform_points(pose, scan.points[::2]), scan.normals[::2] @ pose[:3, :3].T
    looks = scan.looks[::2]
    for camera, depths, image in zip(seen.cameras, seen.depths, seen.images, strict=True):
        towards = camera.position - placed
        facing = np.einsum("ij,ij->i", turned, towards) > 0.25 * np.linalg.norm(towards, axis=1)
        uv, z = camera.project(placed[facing])
        inside = camera.inside(uv)
        columns, rows = np.floor(uv[inside]).astype(int).T
        before = depths[rows, columns] - z[inside]  # NaN compares false: unknown says nothing
        here = np.abs(before) < NEAR
        shown += int(here.sum())
        through += int((before > GAP).sum())
        if here.sum() >= 5:
            difference = image[rows[here], columns[here]] - looks[facing][inside][here]
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
    return max(found, key=ODDS.of)


Sights = tuple[list[Camera], list[FloatArray], list[FloatArray]]
"""The cameras with depth, what each measured (H, W), NaN where the robot is, and its looks (H, W, 3)."""


def sights_of(views: Iterable[View]) -> Sights:
    """The cameras, depths and looks of some views."""
    cameras, depths, images = [], [], []
    for view in views:
        if view.depth is None:
            continue
        depth = np.asarray(view.depth, dtype=np.float64)
        hidden = ~np.isfinite(depth) | (depth <= 0)
        if view.robot_mask is not None:
            hidden |= view.robot_mask
        cameras.append(view.camera)
        depths.append(np.where(hidden, np.nan, depth))
        images.append(appearance(view.image / 255.0))
    return cameras, depths, images


def seen_surface(
    points: FloatArray, cameras: Sequence[Camera], depths: Sequence[FloatArray], images: Sequence[FloatArray],
    table: float,
) -> SeenPoints:  # fmt: skip
    """The seen surface of one object; ``images`` (H, W, 3) are looks already. Looks of points come from the views."""
    points = without_strays(points)
    looks = np.full(points.shape, np.nan)
    for camera, depth, image in zip(cameras, depths, images, strict=True):
        uv, z = camera.project(points)
        index = np.flatnonzero(camera.inside(uv))
        columns, rows = np.floor(uv[index]).astype(int).T
        own = np.abs(depth[rows, columns] - z[index]) < NEAR
        looks[index[own]] = image[rows[own], columns[own]]
    return SeenPoints(
        points, looks, NearestPoints(points, TRUNCATED), tuple(cameras), tuple(depths), tuple(images), table
    )


def without_strays(points: FloatArray, reach: float = 0.007, least: int = 4) -> FloatArray:
    """The points (N, 3) that have ``least`` others within ``reach`` metres: flying pixels hang alone in the air."""
    if len(points) <= least:
        return points
    gaps = np.asarray(cKDTree(points).query(points, k=least + 1, distance_upper_bound=reach)[0])
    kept = np.isfinite(gaps[:, -1])
    return points[kept] if kept.sum() > 0.5 * len(points) else points


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
    """A :class:`~gvla2.perception.labels.Labeller` that knows scans; :class:`ConfigurationError` for equal names."""

    source = "gallery"

    def __init__(self, scans: Sequence[KnownScan]) -> None:
        check_names(scans)
        self._scans = tuple(scans)
        self._histograms = [histogram(scan.looks) for scan in scans]

    @classmethod
    def read(cls, folder: str | os.PathLike[str]) -> Gallery:
        """The scans in a folder; raises :class:`ConfigurationError` for one without meshes."""
        return cls(read_scans(folder))

    def names(self, objects: Sequence[SceneObject], scene: Scene, observation: Observation) -> list[Naming]:
        """One answer per object, in order."""
        sights, answers = sights_of(observation.views), []
        for obj in objects:
            if len(obj.points) < LEAST:
                answers.append(Naming("", 0.0, why=f"Only {len(obj.points)} points of it are seen."))
                continue
            answers.append(self.name(seen_surface(obj.points, *sights, scene.table_height)))
        return answers

    def recognise(
        self, points: FloatArray, rgb: FloatArray, sights: Sights, table: float
    ) -> Recognised | None:
        """The known object whose surface points (N, 3), world metres, with colours (N, 3) are; None if unsure.

        The object is as large as its scan, unseen sides included.
        """
        if len(points) < LEAST:
            return None
        fits = self.fits(seen_surface(points, *sights, table))
        naming = self._named(fits)
        if not naming.label or naming.sureness < SURE_ENOUGH:
            return None
        fit = fits[0]
        whole = transform_points(fit.world_from_scan, fit.scan.points)
        obj = object_of(whole, rgb, table, 1.0)
        obj = replace(
            obj, label=naming.label, named_by=self.source, sureness=round(naming.sureness, 3), known=naming.known,
            points=points, opening=opening_of(whole),
        )  # fmt: skip
        return Recognised(obj, fit)

    def name(self, seen: SeenPoints) -> Naming:
        """The name of a seen surface: a scan that is likelier than all others and "unknown" together."""
        return self._named(self.fits(seen))

    def _named(self, fits: Sequence[Fit]) -> Naming:
        if not fits:
            return Naming("", 1.0, why="No scan in the gallery has its size and colours.")
        best = fits[0]
        first, *rest = np.exp(np.clip([ODDS.of(fit) for fit in fits], -30.0, 30.0)).tolist()
        sure = first / (1.0 + first + sum(rest))
        if sure < 0.5:
            why = f"Nearest: {best.scan.name}, {1e3 * best.residual:.0f} mm off."
            return Naming("", 1.0 / (1.0 + first), why=why)
        return Naming(best.scan.name, float(sure), known_shape(best))

    def fits(self, seen: SeenPoints) -> list[Fit]:
        """The candidate scans, each at its best pose, likeliest first."""
        known = np.isfinite(seen.looks).all(axis=1)
        own = histogram(seen.looks[known]) if known.any() else None
        size = diameter(corners_of(seen.points))
        starts: list[tuple[float, KnownScan, list[FloatArray]]] = []
        for scan, colours in zip(self._scans, self._histograms, strict=True):
            if not 0.6 * scan.diameter - 0.01 < size < 1.05 * scan.diameter + 0.01:
                continue
            if own is not None and np.minimum(own, colours).sum() < LEAST_SHARED:
                continue
            if found := coarse_starts(scan, seen):
                starts.append((found[0], scan, found[1]))
        starts = sorted(starts, key=lambda each: each[0])[:REFINED]

        def best(scan: KnownScan, poses: list[FloatArray]) -> Fit:
            return max((judged(scan, seen, refined(scan, seen, pose)) for pose in poses), key=ODDS.of)

        fits = [(best(scan, poses[:1]), poses[1:]) for _, scan, poses in starts]
        fits.sort(key=lambda each: ODDS.of(each[0]), reverse=True)
        likeliest = [
            turned(fit if not more else max(fit, best(fit.scan, more), key=ODDS.of), seen)
            for fit, more in fits[:THOROUGH]
        ]
        return sorted([*likeliest, *(fit for fit, _ in fits[THOROUGH:])], key=ODDS.of, reverse=True)


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
        counts = correlate1d(counts, [0.5, 1.0, 0.5], axis, mode="constant")
    return np.asarray(counts.ravel() / max(counts.sum(), 1e-9))
