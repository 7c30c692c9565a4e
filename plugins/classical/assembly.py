"""All things of a scene: clusters to solids, fragments made one, composites taken apart, and what stands on what."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np
from scipy.spatial import cKDTree

from gvla2.geometry.transform import FloatArray
from gvla2_plugins.classical.composites import SceneDraft
from gvla2_plugins.classical.levels import leaning_plate, split_by_height, split_by_top
from gvla2_plugins.classical.outline import opened
from gvla2_plugins.classical.pixels import IntArray, Pixels, TableFrame, seen_through
from gvla2_plugins.classical.segmentation import alike, components, groups
from gvla2_plugins.classical.shaping import GOOD, shape_thing
from gvla2_plugins.classical.solids import THIN, Thing

FRAGMENT_REACH = 0.05  # metres between two fragments of one thing
BETWEEN = 0.2  # of the way between them that cameras may seem to look through, where their poses err
IN_HAND = 0.05  # metres from the fingertips to what they may hold
TOUCH = 0.008  # metres between a thing and what carries it


def assemble(
    frames: Sequence[TableFrame],
    pixels: Pixels,
    labels: IntArray,
    bodies: IntArray,
    min_points: int,
    gap: float,
    hand: FloatArray,
) -> list[Thing]:
    """Solids of the labelled pixels (N,), -1 for none; what carries each is set.

    ``bodies`` (N,) labels those of textured bodies, each one thing, and is -1 elsewhere. ``hand`` (3,) is the point
    between the fingertips: what is there may hang in the air.
    """
    things = [shape_thing(frames, pixels, members, gap) for members in groups(labels, min_points)]
    things = _join_fragments(frames, pixels, _absorb(pixels, things), gap)
    parts: list[Thing] = []
    for group, thing in enumerate(things):
        taken = _take_apart(frames, pixels, thing, min_points, gap)
        parts += [replace(opened(frames, p), group=group) for p in taken]
    parts = _absorb(pixels, parts)
    for group, members in enumerate(groups(bodies, min_points), len(things)):
        whole = opened(frames, shape_thing(frames, pixels, members, gap))
        parts.append(replace(whole, group=group, textured=True))
    return rest_on_each_other(parts, hand)


def _absorb(pixels: Pixels, things: Sequence[Thing]) -> list[Thing]:
    """The things without scraps: small pieces that lie on, and look like, a solid that is already found."""
    kept: list[Thing] = []
    for thing in sorted(things, key=lambda t: -len(t.members)):
        look = np.median(pixels.look[thing.members], axis=0)
        for k, other in enumerate(kept):
            if len(thing.members) > 0.35 * len(other.members) or other.agreement < GOOD:
                continue
            on_it = (np.abs(other.local(thing.points)) < 0.5 * other.extents + TOUCH).all(axis=1)
            if on_it.mean() > 0.8 and alike(look, np.median(pixels.look[other.members], axis=0)):
                members = np.sort(np.concatenate([other.members, thing.members]))
                kept[k] = replace(other, members=members, points=pixels.points[members])
                break
        else:
            kept.append(thing)
    return kept


def _join_fragments(
    frames: Sequence[TableFrame], pixels: Pixels, things: list[Thing], gap: float
) -> list[Thing]:
    """Pieces of one look that one solid explains, if it is hollow or no camera saw through their gap.

    A cube behind a finger; the halves of a cup whose sides, where they turn away from the cameras, were lost.
    """
    things = list(things)
    i = 0
    while i < len(things):
        for j in range(i + 1, len(things)):
            a, b = things[i], things[j]
            looks = [np.median(pixels.look[t.members], axis=0) for t in (a, b)]
            if not alike(*looks) or np.min(cKDTree(a.points).query(b.points)[0]) > FRAGMENT_REACH:
                continue
            joined = shape_thing(frames, pixels, np.sort(np.concatenate([a.members, b.members])), gap)
            one, other = (np.median(t.points, axis=0) for t in (a, b))
            line = one + np.linspace(0.0, 1.0, 16)[:, None] * (other - one)
            if not joined.hollow and seen_through(frames, line, margin=0.015).mean() > BETWEEN:
                continue
            if joined.kind != "other" and joined.agreement >= min(GOOD, a.agreement, b.agreement) - 0.1:
                things[i] = joined
                del things[j]
                break
        else:
            i += 1
    return things


def _take_apart(
    frames: Sequence[TableFrame], pixels: Pixels, thing: Thing, min_points: int, gap: float
) -> list[Thing]:
    """The parts of a thing that one solid does not explain, when the parts' solids explain it better."""
    if thing.hollow or (thing.kind != "other" and thing.agreement >= GOOD):
        return [thing]
    if (plate := leaning_plate(thing)) is not None:
        return [plate]
    least = max(12, min_points // 2)
    for split, fits in ((split_by_top, _side_by_side), (split_by_height, lambda _: True)):
        cuts = split(thing.points, least)
        if len(cuts) < 2:
            continue
        parts = _absorb(pixels, [shape_thing(frames, pixels, thing.members[cut], gap) for cut in cuts])
        weight = np.array([len(p.members) for p in parts], dtype=np.float64)
        better = float(weight @ [p.agreement for p in parts]) / weight.sum()
        if better > thing.agreement + 0.05 and fits(parts):
            return parts
    return [thing]


def _side_by_side(parts: Sequence[Thing]) -> bool:
    """Whether each part is a solid of its own and none is over another: a post stands on its foot, not beside it."""
    explained = all(p.kind != "other" and p.agreement >= GOOD and not p.floating for p in parts)
    over = any(p.covers(q.centre[None, :2])[0] for p in parts for q in parts if p is not q)
    return explained and not over


def rest_on_each_other(things: Sequence[Thing], hand: FloatArray) -> list[Thing]:
    """The things with ``on`` set, and the lower face of what stands on another brought down to that one's top.

    What hangs in the air away from the hand is carried by what is under it, on something too thin to be seen.
    """
    placed = list(things)
    order = sorted(range(len(placed)), key=lambda k: placed[k].top)
    for k in order:
        thing = placed[k]
        others = [j for j in order if j != k and _over_one_another(placed[j], thing)]
        below = [j for j in others if _carries(placed[j], thing)]
        held = abs(hand[2] - thing.centre[2]) < 0.5 * thing.spans[2] + IN_HAND
        held = held and thing.covers(hand[None, :2], IN_HAND)[0]
        if not below and thing.floating and not held:
            below = [j for j in others if placed[j].top < min(thing.bottom + TOUCH, thing.top - THIN)]
        if below:
            carrier = max(below, key=lambda j: placed[j].top)
            thing = thing if thing.floating else thing.resting_at(placed[carrier].top)
            placed[k] = replace(thing, on=carrier)
    return placed


def _carries(lower: Thing, upper: Thing) -> bool:
    """Whether nothing of ``upper`` is seen below the top of ``lower``, nor free space between them."""
    gap = upper.floating and upper.bottom > lower.top + TOUCH
    return not gap and lower.top <= min(upper.top - THIN, upper.lowest + TOUCH)


def _over_one_another(lower: Thing, upper: Thing) -> bool:
    over = lower.covers(upper.centre[None, :2])[0]
    return bool(over or (upper.floating and upper.covers(lower.centre[None, :2])[0]))


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
