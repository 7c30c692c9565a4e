"""Prior guidance: an object's points follow an outside depth estimate as far as the views bear it out.

Three rounds of: which points does each camera see, how far along the camera's rays is the prior's surface, one
damped mean correction a point over the views, smoothed over its neighbours so that hidden points follow. The result is
kept only when the input masks speak no worse of it than of the points that came in.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from gvla2.errors import GeometryError
from gvla2.geometry.gaussians import Gaussians
from gvla2.geometry.transform import FloatArray
from gvla2.geometry.views import Views
from gvla2.reconstruction.contracts import GeometryEstimate, StageReport
from gvla2.reconstruction.displacement import Displacement, Neighbourhood
from gvla2.reconstruction.gate import accept
from gvla2.reconstruction.misfit import deep_changes, rim_share
from gvla2.reconstruction.prior_agreement import CrossCheck
from gvla2.reconstruction.prior_depth import PriorDepth, UnusablePriorError, calibrate_prior
from gvla2.reconstruction.pull import Pull
from gvla2.reconstruction.settle import settle
from gvla2.reconstruction.support import as_points

STAGE = "prior"
_LEAST_POINTS = 16
_AGREEMENT = 0.013
"""Two views' surfaces agree to half at this share of the size."""
_ENOUGH = 60_000
_STILL = 1e-4
"""A prior that moves no point by more than this share of the size has nothing to correct."""


@dataclass(frozen=True)
class GuidanceOptions:
    """How points follow a prior; lengths are shares of the object's diameter.

    ``rounds`` of correction; ``cauchy``: the residual at which a view's say is halved, so that the nearest of the
    surfaces that the views ask for wins; ``behind``: points farther behind the prior's surface than this belong to
    another surface and stay; ``tolerance`` of the z-buffer; ``step``: longest correction a round; ``edge``: a jump in
    depth that counts as an edge; ``damping``: total weight at which a point is as sure as it can be;
    ``smoothing``: weight of the neighbours' mean; ``passes``: rings of neighbours that a correction travels.
    ``straggling``: points that far in empty space after the rounds are settled one by one.
    ``most_conflict``: largest share of the prior's pixels that its own other views may contradict; ``most_misfit``:
    largest share of the masks' area that the move may bare or leave, deeper than a pixel and a half.
    """

    rounds: int = 3
    cauchy: float = 0.025
    behind: float = 0.13
    tolerance: float = 0.013
    step: float = 0.2
    edge: float = 0.025
    damping: float = 0.3
    smoothing: float = 0.5
    passes: int = 4
    straggling: float = 0.006
    most_conflict: float = 0.35
    most_misfit: float = 0.015


@dataclass(frozen=True)
class Guided:
    """Points (N, 3) after guidance, metres, and what was done.

    ``displacement`` is the smooth field that takes any other points of the same object, a mesh's vertices for
    example, the same way; zero when the prior was not used. The guided points themselves end elsewhere where the
    field is torn, between a near and a far surface: there each was settled on one of the two, which would pull a
    mesh's faces apart. ``start`` (N, 3) is where they came from.
    """

    points: FloatArray
    report: StageReport
    displacement: Displacement = field(repr=False)
    start: FloatArray = field(repr=False)

    def move(self, others: ArrayLike) -> FloatArray:
        """Other points (M, 3) of the object, moved along; the guided points' old places give their new ones."""
        array = as_points(others)
        if np.array_equal(array, self.start):
            return self.points.copy()
        return self.displacement.move(array)


def guide(
    points: Gaussians | ArrayLike,
    views: Views,
    estimate: GeometryEstimate | None,
    options: GuidanceOptions | None = None,
) -> Guided:
    """Bring an object's points (N, 3) or Gaussians to the surface that a prior sees, where the masks agree.

    ``views`` are the calibrated views that the estimate was made for, with masks. Never worse by the masks: the
    report's status is ``applied``; ``rejected`` when the gate undid it; ``fallback`` with a typed reason (``wrong_size:
    ...``) when the estimate cannot be used; ``skipped`` when there is none or it changes nothing. Raises
    :class:`GeometryError` for points of a wrong shape or not finite and for views without masks.
    """
    began = time.perf_counter()
    options = options or GuidanceOptions()
    start = as_points(points.centres if isinstance(points, Gaussians) else points)
    if not np.isfinite(start).all():
        raise GeometryError(
            f"{int((~np.isfinite(start).all(axis=1)).sum())} of {len(start)} points are not finite."
        )

    def kept(status: str, reason: str, **measures: dict[str, float]) -> Guided:
        report = StageReport(STAGE, status, reason, seconds=time.perf_counter() - began, **measures)  # type: ignore[arg-type]
        return Guided(start, report, Displacement(start, np.zeros_like(start)), start)

    if estimate is None:
        return kept("skipped", "There is no geometry prior.")
    if len(start) < _LEAST_POINTS:
        return kept("fallback", f"too_few_points: {len(start)} points are no surface to guide.")
    size = object_size(start)
    if not size > 0:
        return kept("fallback", "no_extent: all points lie in one place.")
    neighbours = Neighbourhood(start)
    try:
        prior = calibrate_prior(
            estimate, views, start, size=size, spacing=neighbours.spacing, edge=options.edge
        )
        prior, conflict = _cross_checked(prior, views, size, options)
    except UnusablePriorError as error:
        return kept("fallback", str(error))
    followed = _follow(start, views, prior, size, neighbours, options)
    moved = settle(followed, start, views, prior.solid, options.straggling * size)
    way = np.linalg.norm(moved - start, axis=1)
    if way.max() < _STILL * size:
        return kept("skipped", "The prior agrees with the object as it is.")
    gate = accept(start, moved, views, iou_tolerance=rim_share(views))
    thin = slice(None, None, max(1, len(start) // _ENOUGH))  # outlines of more points are much the same
    lost, gained = deep_changes(start[thin], moved[thin], views)
    before = {**gate.before, "mean_move": 0.0}
    after = {
        **gate.after,
        "mean_move": float(way.mean()),
        "lost": lost,
        "gained": gained,
        "prior_conflict": conflict,
    }
    if not gate.accepted:
        return kept("rejected", gate.reason, before=before, after=after)
    if lost + gained > options.most_misfit:
        reason = (
            f"The moved points bare {lost:.1%} of the masks and leave them by {gained:.1%} of their area, "
            f"more than {options.most_misfit:.1%} together."
        )
        return kept("rejected", reason, before=before, after=after)
    reason = "; ".join((f"Depth on {prior.coverage:.0%} of the masks", *prior.notes, gate.reason))
    report = StageReport(STAGE, "applied", reason, before, after, time.perf_counter() - began)
    return Guided(moved, report, Displacement(start, followed - start), start)


def object_size(points: FloatArray) -> float:
    """Twice the distance from the points' mean within which 99 of 100 of them lie, metres; turns change nothing."""
    off = points - points.mean(axis=0)
    return 2.0 * float(np.sqrt(np.quantile(np.einsum("nd,nd->n", off, off), 0.99)))


def _cross_checked(
    prior: PriorDepth, views: Views, size: float, options: GuidanceOptions
) -> tuple[PriorDepth, float]:
    """The prior in the scale in which its views agree best, and the share of conflicts that is left."""
    if len(views) < 2:
        return prior, 0.0
    check = CrossCheck(prior, views, _AGREEMENT * size)
    scale = check.best_scale()
    found = check.at(scale)
    if scale != 1.0:
        prior = prior.scaled(scale, f"depth x {scale:.4f}, the scale in which its views agree")
    if found.conflict_ratio > options.most_conflict:
        raise UnusablePriorError(
            "inconsistent",
            f"{found.conflict_ratio:.0%} of what the prior says of one view is contradicted by its other views "
            f"or by their masks, at most {options.most_conflict:.0%} are tolerated.",
        )
    return prior, found.conflict_ratio


def _follow(
    start: FloatArray,
    views: Views,
    prior: PriorDepth,
    size: float,
    neighbours: Neighbourhood,
    options: GuidanceOptions,
) -> FloatArray:
    """The rounds of correction: points (N, 3)."""
    puller = Pull(
        views,
        prior,
        cauchy=options.cauchy * size,
        behind=options.behind * size,
        tolerance=options.tolerance * size,
        spacing=neighbours.spacing,
    )
    points = start
    for _ in range(options.rounds):
        correction, weight = puller.of(points)
        sure = np.minimum(weight / options.damping, 1.0)
        around, around_sure = neighbours.spread(correction, sure, options.passes)
        heard = options.smoothing * np.minimum(around_sure, 1.0)
        pushed = sure[:, None] * correction + heard[:, None] * around
        pushed /= (sure + options.smoothing)[:, None]
        length = np.sqrt(np.einsum("nd,nd->n", pushed, pushed))
        pushed *= np.minimum(1.0, options.step * size / np.maximum(length, 1e-12))[:, None]
        points = points + pushed
    return points
