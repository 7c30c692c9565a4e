"""Names of known objects: scans laid onto the seen surface of an object in every way that they can lie.

Coarse rejection by size and colours, then a few hundred starts a scan, the best refined by iterated closest points, and
all cameras judge the result.
"""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from gvla2.errors import ConfigurationError
from gvla2.geometry.compiled import run_together
from gvla2.geometry.transform import FloatArray, invert_rigid, rigid, transform_points
from gvla2.geometry.views import Observation
from gvla2.perception.articulated import with_parts
from gvla2.perception.fitting import (
    NEAR,
    TALLER,
    Fit,
    SeenPoints,
    Sights,
    coarse_starts,
    histogram,
    judged,
    levelled,
    refined,
    seen_surface,
    sights_of,
    turned,
)
from gvla2.perception.fixtures import find_large, moving_parts, seen_grid
from gvla2.perception.labels import SURE_ENOUGH, Naming
from gvla2.perception.objects import object_of, opening_of
from gvla2.perception.scans import KnownScan, corners_of, diameter, read_scans
from gvla2.planning.colours import appearance
from gvla2.planning.scene import KnownShape, Scene, SceneObject

LEAST = 40
"""Minimum number of seen points for an object to be recognised."""
THIN = 0.004
"""Height above the table, metres, below which a body is paint or an edge of the table to every camera."""
LEAST_SHARED = 0.12
"""Overlap of the colour histograms below which a scan is not tried."""
REFINED, THOROUGH = 6, 4
"""Number of scans whose best start is refined; and of the likeliest of these, whose other starts are refined too."""
LARGE = 0.25
"""A known object longer than this, metres, is also searched for where only a part of it is seen."""
AROUND = 0.014
"""Metres around such an object within which seen points are of it: its samples lie farther apart."""
FLOATS = 0.015
"""A body whose lowest seen points are this high above the table, metres, stands on something."""
LARGER, WITH_OTHERS = 1.05, 1.4
"""How much longer than a scan a body may be that is that object, and one that may have remainders of others in it."""
PLAIN = 6.0
"""Log-odds from which an object is plainly one that stands on the table: others may lean on a neighbour."""
LAYER = 0.015
"""Steps of height in which what stands on something else is looked for, metres."""
RARE, LEAST_THERE = 0.001, 0.5
"""Share of a scene's points from which it has a colour, and how much of such a scan must be of colours that it has."""
UPRIGHT, TIPPED = np.array([0.0, 0.0, 1.0]), 1.2
"""A scan's own vertical, and the lean from it, radians, up to which what is open at the top should stand upright,
even if it would rest on its side as well."""
MORE = 4.0
"""Log-odds for each e-fold more of the seen surface that one explains."""
LEAST_SHOWN, MOSTLY = 250, 0.7
"""Minimum number of seen points on such an object, and the share of them that must lie on no other."""


@dataclass(frozen=True)
class Recognised:
    """A whole object that a scan explains, and its parts that move; ``stacked``: it stands on something else."""

    object: SceneObject
    fit: Fit
    parts: tuple[SceneObject, ...] = ()
    stacked: bool = False

    def explains(self, points: FloatArray) -> NDArray[np.bool_]:
        """(N,) which of the world points (N, 3) lie on the placed scan."""
        return on_scan(self.fit, points)


def on_scan(fit: Fit, points: FloatArray, reach: float = 0.0) -> NDArray[np.bool_]:
    """(N,) which of the world points (N, 3) lie on a placed scan, or within ``reach`` metres of it."""
    reach = reach or (AROUND if fit.scan.diameter > LARGE else NEAR)
    return fit.scan.nearest.query(transform_points(invert_rigid(fit.world_from_scan), points))[0] < reach


class Gallery:
    """A :class:`~gvla2.perception.labels.Labeller` that knows scans; :class:`ConfigurationError` for equal names."""

    source = "gallery"

    def __init__(self, scans: Sequence[KnownScan]) -> None:
        names = Counter(scan.name for scan in scans)
        if twice := [name for name, count in names.items() if count > 1]:
            raise ConfigurationError(f"Two scans of the gallery are called '{twice[0]}'. Rename one.")
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
            answers.append(self.name(seen_surface(obj.points, sights, scene.table_height)))
        return answers

    def recognise(
        self, points: FloatArray, rgb: FloatArray, sights: Sights, table: float
    ) -> Recognised | None:
        """The known object whose surface points (N, 3), world metres, with colours (N, 3) are; None if unsure.

        The object is as large as its scan, unseen sides included.
        """
        if len(points) < LEAST or np.percentile(points[:, 2], 98.0) < table + THIN:
            return None
        seen = seen_surface(points, sights, table)
        floats = float(np.percentile(points[:, 2], 2.0)) > table + FLOATS
        fits = self.fits([seen])
        naming = self._named(fits)
        unsure, stacked = not naming.label or naming.sureness < SURE_ENOUGH, False
        if floats or unsure or fits[0].odds < PLAIN:
            others = self.fits(_slabs(seen, sights), 0.5 * LAYER)
            if unsure or (others and likelihood(others[0]) > likelihood(fits[0])):
                stacked, fits, naming = True, others, self._named(others)
        if not naming.label or naming.sureness < SURE_ENOUGH:
            return None
        return replace(self._recognised(fits[0], naming, points, rgb, table), stacked=stacked)

    def _recognised(
        self, fit: Fit, naming: Naming, points: FloatArray, rgb: FloatArray, table: float
    ) -> Recognised:
        """The object of a fit, whose seen points (N, 3) have colours (N, 3)."""
        whole = transform_points(fit.world_from_scan, fit.scan.points)
        still = fit.scan.owners < 0
        foot = max(table, float(whole[:, 2].min()))  # on the table, or on something else
        obj = object_of(whole[still] if fit.scan.links else whole, rgb, foot, 1.0)
        obj = replace(
            obj, label=naming.label, named_by=self.source, sureness=round(naming.sureness, 3), known=naming.known,
            points=points, opening=0.0 if fit.scan.links else opening_of(whole),
        )  # fmt: skip
        if not fit.scan.links:
            return Recognised(obj, fit)
        parts = moving_parts(fit.scan, fit.world_from_scan)
        obj, *moving = with_parts(replace(obj, known=None), whole[still], parts)
        return Recognised(obj, fit, tuple(moving))

    def fixtures(self, points: FloatArray, rgb: FloatArray, sights: Sights, table: float) -> list[Recognised]:
        """Large known objects of which points (N, 3), world metres, with colours (N, 3) may show only a part.

        Each stands upright on the table, wherever its surface fits what is seen; see :func:`find_large`.
        """
        found: list[Recognised] = []
        there = histogram(appearance(rgb[:: max(1, len(rgb) // 5000)])) > RARE
        large = [
            scan
            for scan, colours in zip(self._scans, self._histograms, strict=True)
            if (scan.links or scan.diameter > LARGE) and colours[there].sum() > LEAST_THERE
        ]
        grid = seen_grid(points, sights, table) if large else None
        if grid is None:
            return found
        places = run_together([partial(find_large, scan, grid, sights, table) for scan in large])
        fits = [fit for fit in places if fit is not None]
        free = np.ones(len(points), dtype=bool)
        for fit in sorted(fits, key=likelihood, reverse=True):
            odds = fit.odds
            own = on_scan(fit, points)
            if odds <= 0.0 or own.sum() < LEAST_SHOWN or (own & free).sum() < MOSTLY * own.sum():
                continue
            naming = Naming(fit.scan.name, float(1.0 / (1.0 + np.exp(-odds))), known_shape(fit))
            found.append(self._recognised(fit, naming, points[own], rgb[own], table))
            free &= ~own
        return found

    def name(self, seen: SeenPoints) -> Naming:
        """The name of a seen surface: a scan that is likelier than all others and "unknown" together."""
        return self._named(self.fits([seen]))

    def _named(self, fits: Sequence[Fit]) -> Naming:
        if not fits:
            return Naming("", 1.0, why="No scan in the gallery has its size and colours.")
        best = fits[0]
        first, *rest = np.exp(np.clip([fit.odds for fit in fits], -30.0, 30.0)).tolist()
        sure = first / (1.0 + first + sum(rest))
        if sure < 0.5:
            why = f"Nearest: {best.scan.name}, {1e3 * best.residual:.0f} mm off."
            return Naming("", 1.0 / (1.0 + first), why=why)
        return Naming(best.scan.name, float(sure), known_shape(best))

    def fits(self, looks: Sequence[SeenPoints], taller: float = TALLER) -> list[Fit]:
        """The scans whose height differs by at most ``taller`` metres, each at its best pose, likeliest first.

        Several ``looks`` are parts of one body, among which each scan is laid onto that which it fits best.
        """
        larger = LARGER if len(looks) == 1 else WITH_OTHERS
        starts = [one for seen in looks for one in self._starts(seen, taller, larger)]
        starts.sort(key=lambda each: each[0])

        def best(scan: KnownScan, seen: SeenPoints, poses: list[FloatArray]) -> Fit:
            return max((judged(scan, seen, refined(scan, seen, pose)) for pose in poses), key=likelihood)

        few = REFINED if len(looks) == 1 else 2 * REFINED
        fits = [(best(scan, seen, poses[:1]), seen, poses[1:]) for _, scan, seen, poses in starts[:few]]
        fits.sort(key=lambda each: likelihood(each[0]), reverse=True)
        found: dict[str, Fit] = {}
        for number, (fit, seen, more) in enumerate(fits):
            if fit.scan.name in found:
                continue
            if number < THOROUGH:
                fit = turned(fit if not more else max(fit, best(fit.scan, seen, more), key=likelihood), seen)
                fit = levelled(fit, seen)
            found[fit.scan.name] = fit
        return sorted(found.values(), key=likelihood, reverse=True)

    def _starts(
        self, seen: SeenPoints, taller: float, larger: float
    ) -> list[tuple[float, KnownScan, SeenPoints, list[FloatArray]]]:
        """Each scan of about the seen size and colours with its best starts, and how far the best of them is off."""
        known = np.isfinite(seen.looks).all(axis=1)
        own = histogram(seen.looks[known]) if known.any() else None
        size = diameter(corners_of(seen.points))
        starts = []
        for scan, colours in zip(self._scans, self._histograms, strict=True):
            if scan.links:  # they are found as a whole, with their parts: see `fixtures`
                continue
            if not 0.6 * scan.diameter - 0.01 < size < larger * scan.diameter + 0.01:
                continue
            if own is not None and np.minimum(own, colours).sum() < LEAST_SHARED:
                continue
            if found := coarse_starts(scan, seen, taller):
                starts.append((found[0], scan, seen, found[1]))
        return starts


def _slabs(seen: SeenPoints, sights: Sights) -> list[SeenPoints]:
    """What is uppermost of a body, down to different depths: something stands on something else there."""
    low, top = (float(v) for v in np.percentile(seen.points[:, 2], [2.0, 99.0]))
    least, most = LAYER, top - seen.table - 0.5 * LAYER
    if low > seen.table + FLOATS:  # its foot is seen, or hidden not far below
        least, most = 0.5 * (top - low), min(most, 1.5 * (top - low) + LAYER)
    found = []
    for height in np.arange(least, most, LAYER):
        slab = seen.points[seen.points[:, 2] > top - height]
        if len(slab) >= LEAST:
            found.append(seen_surface(slab, sights, top - height))
    return found


def likelihood(fit: Fit) -> float:
    """Log-odds of a fit among others that may have been laid onto more or fewer of the same points."""
    return fit.odds + MORE * float(np.log(max(fit.support, 1.0)))


def known_shape(fit: Fit) -> KnownShape:
    """The scan at its pose, in its file's frame and units."""
    pose = fit.world_from_scan @ rigid(None, -fit.scan.middle)
    ups = fit.scan.rests[:, 2]
    vessel = opening_of(fit.scan.points) > 0.0 and pose[2, 2] > np.cos(TIPPED)
    up = UPRIGHT if vessel else ups[int(np.argmax(ups @ pose[2, :3]))]
    return KnownShape(fit.scan.name, fit.scan.path, pose, fit.scan.scale, round(fit.residual, 5), up)
