"""From the points of one thing to a solid: which of box, cylinder and sphere explains it, and how well."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from gvla2.geometry.transform import FloatArray
from gvla2_plugins.classical.frames import Frame
from gvla2_plugins.classical.openings import crowded, on_walls, within_walls
from gvla2_plugins.classical.outline import completed, hangs, sees_into, silhouette
from gvla2_plugins.classical.pixels import IntArray, Pixels
from gvla2_plugins.classical.solids import (
    Distance,
    Fit,
    box_distance,
    cylinder_distance,
    evenly,
    fit_solid,
    narrow_yaw,
    sphere_distance,
    spread_out,
)
from gvla2_plugins.classical.things import THIN, Kind, Thing, upright_rectangle

GOOD = 0.82  # agreement from which one solid explains a thing
MOST_SEEN = 420  # points a fit looks at
MARGIN = 0.012  # metres about a thing's points where its outline is looked at
ROUND = 1.12  # a round solid, which has fewer parameters, is taken up to this factor of a box's cost
INTRUDED = 0.08  # share of free points within a solid from which it is the wrong solid, not a hollow one
CLEARLY = 0.1  # more of agreement
RIM = 0.006  # metres: a wall is no thinner
HALF, ONE_SIDE = 1.35, 4.5  # length over breadth of what is seen of a round thing from one side
ANYWHERE, LENGTH = (-10.0, 10.0), (0.5 * THIN, 3.0)
DISTANCES: dict[Kind, Distance] = {
    "box": box_distance,
    "cylinder": cylinder_distance,
    "sphere": sphere_distance,
}


@dataclass(frozen=True)
class Evidence:
    """What one thing's fit goes by, in the table's frame: ``seen`` (N, 3), ``free`` (M, 3), ``rays`` (R, S, 3) (see
    :func:`fit_solid`); heights of its ``lowest`` and ``highest`` points and of its ``bottom``, which is the table's
    unless it is ``floating``; the smallest rectangle about it: ``yaw``, ``middle`` (2,), ``lengths`` (2,).
    """

    seen: FloatArray
    free: FloatArray
    rays: FloatArray
    lowest: float
    highest: float
    bottom: float
    floating: bool
    yaw: float
    middle: FloatArray
    lengths: FloatArray

    def fit(self, kind: Kind, start: Sequence[float] | FloatArray, *, filled: bool = False) -> Fit:
        """The solid ``kind`` from the parameters ``start``."""
        top = (self.highest - 0.012, self.highest + 0.006)
        bottom = (self.bottom - 0.01, self.bottom + 0.006)
        ranges = {
            "box": [ANYWHERE, ANYWHERE, ANYWHERE, LENGTH, LENGTH, top, bottom],
            "cylinder": [ANYWHERE, ANYWHERE, LENGTH, top, bottom],
            "sphere": [ANYWHERE, ANYWHERE, ANYWHERE, LENGTH],
        }[kind]
        hold = () if self.floating or kind == "sphere" else (len(ranges) - 1,)
        limits = ([r[0] for r in ranges], [r[1] for r in ranges])
        return fit_solid(
            DISTANCES[kind],
            start,
            self.seen,
            self.free,
            self.rays,
            hold=hold,
            limits=limits,
            filled=filled,
            slack=0.004,
        )


def shape_thing(frames: Sequence[Frame], pixels: Pixels, members: IntArray, gap: float) -> Thing:
    """The solid that explains the pixels ``members`` (N,) best, standing on the table unless it is seen to hang."""
    points = pixels.points[members]
    evidence = _gather(frames, pixels, members, gap)
    fits = _fits(evidence)
    kind = min(fits, key=lambda name: fits[name].cost * (ROUND if name == "box" else 1.0))
    fit = fits[kind]
    yaw, centre, extents = _upright(kind, fit.parameters)
    thing = Thing(
        kind,
        members,
        points,
        centre,
        yaw,
        extents,
        fit.agreement,
        floating=evidence.floating,
        lowest=evidence.lowest,
    )
    if (hollow := _hollow(frames, evidence, thing, kind, fit)) is not None:
        return hollow
    if fit.agreement < 0.5 * GOOD or not _within(evidence, centre, extents):
        thing = _bounding(thing, evidence)
    return completed(frames, pixels, thing)


def _hollow(frames: Sequence[Frame], evidence: Evidence, thing: Thing, kind: Kind, fit: Fit) -> Thing | None:
    """The thing as a hollow one, where one sees into it; None where one does not.

    The inner wall is seen too: only the outline tells where the outer one is. Where a view shows it in pieces, rays
    beside a piece pass through the hollow; they say nothing against the walls.
    """
    if fit.intrusion < INTRUDED and sees_into(frames, thing) and not crowded(thing):
        fit = evidence.fit(kind, fit.parameters, filled=True)
        yaw, centre, extents = _upright(kind, fit.parameters)
        return replace(thing, centre=centre, yaw=yaw, extents=extents, agreement=fit.agreement, hollow=True)
    square = evidence.lengths.max() < 1.25 * evidence.lengths.min()
    about = [*evidence.middle, evidence.yaw, *evidence.lengths, evidence.highest, evidence.bottom]
    starts: list[tuple[Kind, FloatArray]] = [("box", np.asarray(about))]
    if square:
        radial = [*evidence.middle, evidence.lengths.mean(), evidence.highest, evidence.bottom]
        starts.insert(0, ("cylinder", np.asarray(radial)))
    if evidence.floating or (fit.agreement >= GOOD and fit.intrusion < INTRUDED):
        return None
    found: list[Thing] = []
    for shape, start in starts:
        yaw, centre, extents = _upright(shape, start)
        trial = replace(thing, kind=shape, centre=centre, yaw=yaw, extents=extents)
        if not sees_into(frames, trial, share=0.8) or crowded(trial):
            continue
        # Where a rim was lost, rays beside what is left of it pass through the hollow, close to its walls.
        outer = replace(evidence, free=evidence.free[~within_walls(trial, evidence.free, RIM)])
        fit = outer.fit(shape, start, filled=True)
        yaw, centre, extents = _upright(shape, fit.parameters)
        walls = replace(trial, centre=centre, yaw=yaw, extents=extents, agreement=fit.agreement, hollow=True)
        if fit.agreement >= GOOD and on_walls(walls):
            found.append(walls)
    # A wider box explains round walls too: the one that is like the outside must be clearly worse.
    return max(found, key=lambda t: t.agreement + CLEARLY * (t.kind == kind), default=None)


def _gather(frames: Sequence[Frame], pixels: Pixels, members: IntArray, gap: float) -> Evidence:
    points = pixels.points[members]
    lowest, highest = (float(v) for v in np.percentile(points[:, 2], [2.0, 98.0]))
    floating = hangs(frames, points, lowest, gap)
    bottom = lowest - THIN if floating else 0.0
    highest = max(highest, bottom + THIN)
    yaw, middle, lengths = narrow_yaw(evenly(points[:, :2], 500))
    low = np.array([*(points[:, :2].min(axis=0) - MARGIN), bottom - (MARGIN if floating else 0.0)])
    high = np.array([*(points[:, :2].max(axis=0) + MARGIN), highest + MARGIN])
    free, rays = silhouette(frames, pixels, members, low, high)
    seen = spread_out(points, MOST_SEEN)
    lengths = np.maximum(lengths, THIN)
    return Evidence(seen, free, rays, lowest, highest, bottom, floating, yaw, middle, lengths)


def _fits(evidence: Evidence) -> dict[Kind, Fit]:
    """The box, and the round solids where the box is square enough."""
    highest, bottom, middle = evidence.highest, evidence.bottom, evidence.middle
    fits: dict[Kind, Fit] = {
        "box": evidence.fit("box", [*middle, evidence.yaw, *evidence.lengths, highest, bottom])
    }
    width, depth, top = fits["box"].parameters[3:6]
    long, short = float(evidence.lengths.max()), float(evidence.lengths.min())
    if max(width, depth) >= 1.35 * min(width, depth) and HALF < long / short < ONE_SIDE:
        # A round thing that is seen from one side shows a strip as wide as it is.
        fits["cylinder"] = _from_one_side(evidence, long, short)
    elif max(width, depth) < 1.35 * min(width, depth):
        diameter = float(evidence.lengths.mean())
        fits["cylinder"] = evidence.fit("cylinder", [*middle, diameter, highest, bottom])
        if 0.6 < (top - bottom) / diameter < 1.5:
            fits["sphere"] = evidence.fit("sphere", [*middle, highest - 0.5 * diameter, diameter])
    return fits


def _from_one_side(evidence: Evidence, long: float, short: float) -> Fit:
    """The best cylinder that shows no more than one of its sides."""
    along = evidence.yaw + (0.0 if evidence.lengths[0] < evidence.lengths[1] else 0.5 * np.pi)
    behind = 0.5 * (long - short) * np.array([np.cos(along), np.sin(along)])
    starts = [
        [*(evidence.middle + sign * behind), long, evidence.highest, evidence.bottom] for sign in (1.0, -1.0)
    ]
    return min((evidence.fit("cylinder", start) for start in starts), key=lambda fit: fit.cost)


def _within(evidence: Evidence, centre: FloatArray, extents: FloatArray) -> bool:
    """Whether the fit stayed where the points are."""
    reach = 0.5 * evidence.lengths.max() + 0.03
    return bool((extents >= 0.5 * THIN).all() and (np.abs(centre[:2] - evidence.middle) < reach).all())


def _bounding(thing: Thing, evidence: Evidence) -> Thing:
    """The box about the points of something that is no solid we know."""
    yaw, middle, lengths = narrow_yaw(thing.points[:, :2], trim=0.5)
    lengths = np.maximum(lengths, THIN)
    yaw, width, depth = upright_rectangle(yaw, float(lengths[0]), float(lengths[1]))
    low, high = evidence.bottom, evidence.highest
    return replace(
        thing,
        kind="other",
        centre=np.array([*middle, 0.5 * (low + high)]),
        yaw=yaw,
        extents=np.array([width, depth, high - low]),
    )


def _upright(kind: Kind, parameters: FloatArray) -> tuple[float, FloatArray, FloatArray]:
    """Yaw, centre (3,) and extents (3,); the long side of a box is its x axis, a square's yaw is within 45 degrees."""
    if kind == "sphere":
        return 0.0, parameters[:3], np.full(3, abs(parameters[3]))
    if kind == "cylinder":
        cx, cy, diameter, top, bottom = parameters
        return (
            0.0,
            np.array([cx, cy, 0.5 * (top + bottom)]),
            np.array([abs(diameter), abs(diameter), top - bottom]),
        )
    cx, cy, yaw, width, depth, top, bottom = parameters
    yaw, width, depth = upright_rectangle(yaw, width, depth)
    return yaw, np.array([cx, cy, 0.5 * (top + bottom)]), np.array([width, depth, top - bottom])
