"""From the points of one object to a solid: which of box, cylinder and sphere explains it, and how well."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from gvla2.geometry.transform import FloatArray
from gvla2_plugins.classical.footprints import flat_object
from gvla2_plugins.classical.outline import (
    completed,
    crowded,
    hangs,
    on_walls,
    sees_into,
    silhouette,
    within_walls,
)
from gvla2_plugins.classical.pixels import IntArray, Pixels, TableFrame
from gvla2_plugins.classical.solids import (
    THIN,
    Distance,
    Kind,
    SeenObject,
    SolidFit,
    box_distance,
    cylinder_distance,
    evenly,
    fit_solid,
    narrow_yaw,
    solid,
    sphere_distance,
    spread_out,
)

GOOD = 0.82  # agreement from which one solid explains an object
MOST_SEEN = 420  # points a fit looks at
MARGIN = 0.012  # metres about an object's points where its outline is looked at
ROUND = 1.12  # a round solid, which has fewer parameters, is taken up to this factor of a box's cost
INTRUDED = 0.08  # share of free points within a solid from which it is the wrong solid, not a hollow one
CLEARLY = 0.1  # more of agreement
RIM = 0.006  # metres: a wall is no thinner
SQUARE = 1.35  # length over breadth of what may be round
UPRIGHT = 0.5  # of the length of what is seen: an object that is lower shows its top, and so its outline
SHEET = 0.008  # metres: what is no higher is fitted by its outline
ANYWHERE, LENGTH = (-10.0, 10.0), (0.5 * THIN, 3.0)
DISTANCES: dict[Kind, Distance] = {
    "box": box_distance,
    "cylinder": cylinder_distance,
    "sphere": sphere_distance,
}


@dataclass(frozen=True)
class FitEvidence:
    """The evidence for one object's fit, in the table's frame.

    ``seen`` (N, 3), ``free`` (M, 3), ``rays`` (R, S, 3) as in :func:`fit_solid`; heights of its ``lowest`` and
    ``highest`` points and of its ``bottom``, which is the table's unless it is ``floating``; the smallest rectangle
    about it: ``yaw``, ``middle`` (2,), ``lengths`` (2,).
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

    def start(self, kind: Kind) -> FloatArray:
        """Parameters of the solid that fills the rectangle."""
        heights, width = (self.highest, self.bottom), float(self.lengths.mean())
        if kind == "sphere":
            return np.array([*self.middle, self.highest - 0.5 * width, width])
        if kind == "cylinder":
            return np.array([*self.middle, width, *heights])
        return np.array([*self.middle, self.yaw, *self.lengths, *heights])

    def fit(self, kind: Kind, start: FloatArray | None = None, *, filled: bool = False) -> SolidFit:
        """The solid ``kind``, from the parameters ``start`` if they are given."""
        start = self.start(kind) if start is None else start
        top = (self.highest - 0.012, self.highest + 0.006)
        bottom = (self.bottom - 0.01, self.bottom + 0.006)
        ranges = {
            "box": [ANYWHERE, ANYWHERE, ANYWHERE, LENGTH, LENGTH, top, bottom],
            "cylinder": [ANYWHERE, ANYWHERE, LENGTH, top, bottom],
            "sphere": [ANYWHERE, ANYWHERE, ANYWHERE, LENGTH],
        }[kind]
        hold = () if self.floating or kind == "sphere" else (-1,)
        low, high = zip(*ranges, strict=True)
        evidence = self.seen, self.free, self.rays
        return fit_solid(
            DISTANCES[kind], start, *evidence, hold=hold, limits=(low, high), filled=filled, slack=0.004
        )


def shape_object(frames: Sequence[TableFrame], pixels: Pixels, members: IntArray, gap: float) -> SeenObject:
    """The solid that explains the pixels ``members`` (N,) best, standing on the table unless it is seen to hang."""
    evidence = _gather(frames, pixels, members, gap)
    fits = _fits(evidence)
    top = float(fits["box"].parameters[5])
    if not evidence.floating and top < SHEET:
        # Free points beside it do not show the outline of one so flat: the table does.
        flat = flat_object(frames, pixels, members, [at < 0 for at in pixels.maps], max(top, THIN))
        return replace(flat, lowest=evidence.lowest)
    kind = min(fits, key=lambda name: fits[name].cost * (ROUND if name == "box" else 1.0))
    fit = fits[kind]
    obj = solid(kind, pixels, members, fit.parameters, fit.agreement)
    obj = replace(obj, floating=evidence.floating, lowest=evidence.lowest)
    if (hollow := _hollow(frames, evidence, obj, fit)) is not None:
        return hollow
    if fit.agreement < 0.5 * GOOD or not _within(evidence, obj):
        # No solid that we know: the box about its points.
        yaw, middle, lengths = narrow_yaw(obj.points[:, :2], trim=0.5)
        lengths = np.maximum(lengths, THIN)
        obj = obj.posed("other", [*middle, yaw, *lengths, evidence.highest, evidence.bottom])
    return completed(frames, pixels, obj)


def _hollow(
    frames: Sequence[TableFrame], evidence: FitEvidence, obj: SeenObject, fit: SolidFit
) -> SeenObject | None:
    """The object as a hollow one, where one sees into it; None where one does not.

    The inner wall is seen too: only the outline shows where the outer one is. Where a view shows it in pieces, rays
    beside a piece pass through the hollow; they say nothing against the walls.
    """
    if fit.intrusion < INTRUDED and sees_into(frames, obj) and not crowded(obj):
        fit = evidence.fit(obj.kind, fit.parameters, filled=True)
        return replace(obj.posed(obj.kind, fit.parameters), agreement=fit.agreement, hollow=True)
    if evidence.floating or (fit.agreement >= GOOD and fit.intrusion < INTRUDED):
        return None
    square = evidence.lengths.max() < 1.25 * evidence.lengths.min()
    kinds: list[Kind] = ["cylinder", "box"] if square else ["box"]
    found: list[SeenObject] = []
    for kind in kinds:
        trial = obj.posed(kind, evidence.start(kind))
        if not sees_into(frames, trial, share=0.8) or crowded(trial):
            continue
        # Where a rim was lost, rays beside what is left of it pass through the hollow, close to its walls.
        outer = replace(evidence, free=evidence.free[~within_walls(trial, evidence.free, RIM)])
        fit = outer.fit(kind, filled=True)
        walls = replace(trial.posed(kind, fit.parameters), agreement=fit.agreement, hollow=True)
        if fit.agreement >= GOOD and on_walls(walls):
            found.append(walls)
    # A wider box explains round walls too: the one that is like the outside must be clearly worse.
    return max(found, key=lambda t: t.agreement + CLEARLY * (t.kind == obj.kind), default=None)


def _gather(frames: Sequence[TableFrame], pixels: Pixels, members: IntArray, gap: float) -> FitEvidence:
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
    return FitEvidence(seen, free, rays, lowest, highest, bottom, floating, yaw, middle, lengths)


def _fits(evidence: FitEvidence) -> dict[Kind, SolidFit]:
    """The box, and the round solids where the box is square enough."""
    fits: dict[Kind, SolidFit] = {"box": evidence.fit("box")}
    width, depth, top, bottom = fits["box"].parameters[3:]
    short, long = sorted(evidence.lengths.tolist())
    if max(width, depth) < SQUARE * min(width, depth):
        fits["cylinder"] = evidence.fit("cylinder")
        if 0.6 < 2.0 * (top - bottom) / (long + short) < 1.5:
            fits["sphere"] = evidence.fit("sphere")
    elif long > SQUARE * short and top - bottom > UPRIGHT * long:
        # A round object that is seen from one side shows a strip as wide as it is; a low one shows its top.
        along = evidence.yaw + (0.0 if evidence.lengths[0] < evidence.lengths[1] else 0.5 * np.pi)
        behind = 0.5 * (long - short) * np.array([np.cos(along), np.sin(along)])
        circle = [long, evidence.highest, evidence.bottom]
        ends = [np.append(evidence.middle + sign * behind, circle) for sign in (1.0, -1.0)]
        fits["cylinder"] = min((evidence.fit("cylinder", end) for end in ends), key=lambda fit: fit.cost)
    return fits


def _within(evidence: FitEvidence, obj: SeenObject) -> bool:
    """Whether the fit stayed where the points are."""
    reach = 0.5 * evidence.lengths.max() + 0.03
    near = np.abs(obj.centre[:2] - evidence.middle) < reach
    return bool((obj.extents >= 0.5 * THIN).all() and near.all())
