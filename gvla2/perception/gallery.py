"""Names and poses from a folder of known objects: size, colours, then registration; "unknown" rather than a guess."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gvla2.geometry.transform import FloatArray, rigid
from gvla2.geometry.views import Observation
from gvla2.perception.fitting import Fit, Seen, coarse_starts, judged, look_of, refined, seen_surface
from gvla2.perception.labels import Naming
from gvla2.perception.scans import KnownScan, check_names, diameter, read_scans
from gvla2.planning.scene import KnownShape, Scene, SceneObject

LEAST = 40
"""Least seen points for a thing to be recognised."""
REFINED = 10
"""Number of scans refined among those whose size and colours fit."""
BINS = 6
LEAST_SHARED = 0.12
"""Overlap of the colour histograms below which a scan is not tried."""


@dataclass(frozen=True)
class Odds:
    """From a fit's measures to the log-odds that the scan is the thing: one weight per measure and a constant."""

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

    def names(self, things: Sequence[SceneObject], scene: Scene, observation: Observation) -> list[Naming]:
        """One answer per thing, in order."""
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
        for thing in things:
            if len(thing.points) < LEAST:
                answers.append(Naming("", 0.0, why=f"Only {len(thing.points)} points of it are seen."))
                continue
            answers.append(self.name(seen_surface(thing.points, cameras, depths, images, scene.table_height)))
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
