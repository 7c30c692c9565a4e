"""Solids in the same space: paint of several colours on one thing."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np

from gvla2_plugins.classical.clusters import components
from gvla2_plugins.classical.composites import SceneDraft
from gvla2_plugins.classical.frames import IntArray, TableFrame
from gvla2_plugins.classical.outline import opened
from gvla2_plugins.classical.pixels import Pixels
from gvla2_plugins.classical.shaping import GOOD, shape_thing
from gvla2_plugins.classical.things import Thing

BULKY = 0.012  # metres: a thinner piece may be set into the side of another
SHARED = 0.5  # of the smaller solid that is within the other, where both cannot be there
FLUSH = 0.003  # metres: paint stands off by less
ON_IT = 0.9  # share of a piece's points that are on another's solid, where it is paint
SCRAP = 0.01  # of another piece's pixels: fewer that hang in the air are of it
SEAM = 0.003  # metres: a point that is so much higher than another piece is above it
ABOVE = 0.6  # share of a piece's points above another, which is under it then
STEPS = np.linspace(-0.4, 0.4, 5)  # of a solid's extents, where it is looked at


def join_overlapping(
    draft: SceneDraft, frames: Sequence[TableFrame], pixels: Pixels, bodies: IntArray, gap: float
) -> None:
    """Pieces of one body that are in the same space are one thing, shaped anew from all its pixels.

    ``bodies`` (N,) labels the pixels' bodies, -1 for none. What is known to be something is left alone, and so is
    what is in something hollow, or stands on the other piece.
    """
    left = [k for k in draft.left() if _is_plain(draft.things[k])]
    body = [_body_of(bodies, draft.things[k]) for k in left]
    pairs = []
    for a, b in combinations(range(len(left)), 2):
        one, other = draft.things[left[a]], draft.things[left[b]]
        stands = left[a] == draft.carrier(left[b]) or left[b] == draft.carrier(left[a])
        stands = stands or _is_above(one, other) or _is_above(other, one)
        if body[a] == body[b] >= 0 and not stands and any(rule(one, other) for rule in RULES):
            pairs.append((a, b))
    wholes = components(len(left), np.array(pairs, dtype=np.int64).reshape(-1, 2))
    for whole in np.unique(wholes):
        mine = [left[i] for i in np.nonzero(wholes == whole)[0]]
        if len(mine) < 2:
            continue
        main = max(mine, key=lambda k: len(draft.things[k].members))
        members = np.sort(np.concatenate([draft.things[k].members for k in mine]))
        joined = opened(frames, shape_thing(frames, pixels, members, gap))
        draft.take_in(main, [k for k in mine if k != main])
        old = draft.things[main]
        draft.things[main] = replace(joined, group=old.group, on=old.on, textured=True)


def _is_plain(thing: Thing) -> bool:
    return not thing.noun and thing.part_of < 0 and thing.turn is None


def _body_of(bodies: IntArray, thing: Thing) -> int:
    """The body that most of a thing's pixels belong to, -1 for none."""
    own = bodies[thing.members]
    own = own[own >= 0]
    return int(np.bincount(own).argmax()) if len(own) else -1


def _intersect(one: Thing, other: Thing) -> bool:
    """Whether most of the smaller of two solids is within the other, and neither is thin or hollow."""
    small, large = _by_size(one, other)
    if min(small.extents) < BULKY or one.hollow or other.hollow:
        return False
    at = small.grid(STEPS, STEPS, STEPS)
    high = np.abs(at[:, 2] - large.centre[2]) < 0.5 * large.extents[2]
    return bool((high & large.covers(at[:, :2])).mean() > SHARED)


def _is_paint(one: Thing, other: Thing) -> bool:
    """Whether what is seen of the smaller lies on the solid that explains the other."""
    small, large = _by_size(one, other)
    if large.hollow or large.agreement < GOOD:
        return False
    on_it = (np.abs(large.local(small.points)) < 0.5 * large.extents + FLUSH).all(axis=1)
    return bool(on_it.mean() > ON_IT)


def _is_above(upper: Thing, lower: Thing) -> bool:
    """Whether one lies on the other, as a lid on a jar, though a few pixels of each are taken to be of the other."""
    up, low = upper.points[:, 2], lower.points[:, 2]
    over = float((up > np.percentile(low, 99.0) + SEAM).mean()) > ABOVE
    bulky = min(*upper.extents, *lower.extents) > BULKY  # a print on a side is not under the top
    return over or bool(bulky and np.percentile(up, 5.0) > np.percentile(low, 90.0))


def _is_scrap(one: Thing, other: Thing) -> bool:
    """Whether one piece is a few pixels in the air, carried by nothing, beside a large one: a rim, a print, a shade."""
    small, large = sorted((one, other), key=lambda thing: len(thing.members))
    return small.floating and small.on < 0 and len(small.members) < SCRAP * len(large.members)


def _by_size(one: Thing, other: Thing) -> tuple[Thing, Thing]:
    small, large = sorted((one, other), key=lambda thing: float(thing.extents.prod()))
    return small, large


RULES = (_intersect, _is_paint, _is_scrap)
