"""All objects of a scene: clusters to solids, fragments made one, composites taken apart, and what stands on what."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np
from scipy.spatial import cKDTree

from gvla2.geometry.transform import FloatArray
from gvla2.perception.clusters import connected
from gvla2_plugins.classical import ClassicalConfig
from gvla2_plugins.classical.composites import SceneDraft
from gvla2_plugins.classical.levels import leaning_plate, split_by_height
from gvla2_plugins.classical.pixels import IntArray, Pixels, TableFrame, alike, groups, seen_through
from gvla2_plugins.classical.shaping import EDGE, GOOD, opened, shape_object, within_walls
from gvla2_plugins.classical.solids import THIN, SeenObject

FEW, NEAR = 0.02, 0.003  # of another piece's pixels: what has fewer may be its edge; metres from its points
BETWEEN = 0.2  # of the way between them that cameras may seem to look through, where their poses err
IN_HAND = 0.05  # metres from the fingertips to an object that they may hold
TOUCH = 0.008  # metres between an object and what carries it


def assemble(
    frames: Sequence[TableFrame],
    pixels: Pixels,
    labels: IntArray,
    bodies: IntArray,
    config: ClassicalConfig,
    hand: FloatArray,
) -> list[SeenObject]:
    """Solids of the labelled pixels (N,), -1 for none; what carries each is set.

    ``bodies`` (N,) labels those of textured bodies, each one object, and is -1 elsewhere. ``hand`` (3,) is the point
    between the fingertips: what is there may hang in the air.
    """
    gap, min_points = config.gap, config.min_points
    pieces = [members for members in groups(labels, min_points) if _is_raised(pixels, members, config)]
    objects = [shape_object(frames, pixels, members, gap) for members in pieces]
    objects = _join_fragments(frames, pixels, _absorb(pixels, objects), gap, config.fragment_reach)
    parts: list[SeenObject] = []
    for group, obj in enumerate(objects):
        taken = _take_apart(frames, pixels, obj, min_points, gap)
        parts += [replace(opened(frames, p), group=group) for p in taken]
    parts = _absorb(pixels, parts)
    for group, members in enumerate(groups(bodies, min_points), len(objects)):
        whole = opened(frames, shape_object(frames, pixels, members, gap))
        parts.append(replace(whole, group=group, textured=True))
    return rest_on_each_other(parts, hand)


def _is_raised(pixels: Pixels, members: IntArray, config: ClassicalConfig) -> bool:
    """Whether most of a piece is above the table; else it is the table, seen through a hole or beside an edge."""
    return bool(np.median(pixels.points[members, 2]) > 0.25 * config.min_height)


def _absorb(pixels: Pixels, objects: Sequence[SeenObject]) -> list[SeenObject]:
    """The objects without scraps: small pieces that lie on, and look like, a solid that is already found, and edges of
    another, whose pixels have in part the colour of what is behind them.
    """
    kept: list[SeenObject] = []
    for obj in sorted(objects, key=lambda t: -len(t.members)):
        look = np.median(pixels.look[obj.members], axis=0)
        for k, other in enumerate(kept):
            if len(obj.members) > 0.35 * len(other.members):
                continue
            on_it = (np.abs(other.local(obj.points)) < 0.5 * other.extents + TOUCH).all(axis=1)
            own = other.agreement >= GOOD and alike(look, np.median(pixels.look[other.members], axis=0))
            if on_it.mean() > 0.8 and (own or _is_edge(obj, other)):
                members = np.sort(np.concatenate([other.members, obj.members]))
                kept[k] = replace(other, members=members, points=pixels.points[members])
                break
        else:
            kept.append(obj)
    return kept


def _is_edge(obj: SeenObject, other: SeenObject) -> bool:
    """Whether an object is a few pixels that are nowhere far from those of another."""
    few = len(obj.members) < FEW * len(other.members)
    return few and float(np.quantile(cKDTree(other.points).query(obj.points)[0], 0.9)) < NEAR


def _join_fragments(
    frames: Sequence[TableFrame], pixels: Pixels, objects: list[SeenObject], gap: float, reach: float
) -> list[SeenObject]:
    """Pieces of one look that one solid explains, if it is hollow or no camera saw through their gap.

    A cube behind a finger; the halves of a cup whose sides, where they turn away from the cameras, were lost.
    """
    objects = list(objects)
    i = 0
    while i < len(objects):
        for j in range(i + 1, len(objects)):
            a, b = objects[i], objects[j]
            looks = [np.median(pixels.look[t.members], axis=0) for t in (a, b)]
            if not alike(*looks) or np.min(cKDTree(a.points).query(b.points)[0]) > reach:
                continue
            joined = shape_object(frames, pixels, np.sort(np.concatenate([a.members, b.members])), gap)
            one, other = (np.median(t.points, axis=0) for t in (a, b))
            line = one + np.linspace(0.0, 1.0, 16)[:, None] * (other - one)
            if not joined.hollow and seen_through(frames, line, margin=0.015).mean() > BETWEEN:
                continue
            if joined.kind != "other" and joined.agreement >= min(GOOD, a.agreement, b.agreement) - 0.1:
                objects[i] = joined
                del objects[j]
                break
        else:
            i += 1
    return objects


def _take_apart(
    frames: Sequence[TableFrame], pixels: Pixels, obj: SeenObject, min_points: int, gap: float
) -> list[SeenObject]:
    """The parts of an object that one solid does not explain, when the parts' solids explain it better."""
    if obj.hollow or (obj.kind != "other" and obj.agreement >= GOOD):
        return [obj]
    if (plate := leaning_plate(obj)) is not None:
        return [plate]
    cuts = split_by_height(obj.points, max(12, min_points // 2))
    if len(cuts) < 2:
        return [obj]
    parts = _absorb(pixels, [shape_object(frames, pixels, obj.members[cut], gap) for cut in cuts])
    explained = np.average([p.agreement for p in parts], weights=[len(p.members) for p in parts])
    return parts if explained > obj.agreement + 0.05 else [obj]


def rest_on_each_other(objects: Sequence[SeenObject], hand: FloatArray) -> list[SeenObject]:
    """The objects with ``on`` set, and the lower face of what stands on another brought down to that one's top.

    What hangs in the air away from the hand is carried by what is under it, on something too thin to be seen.
    """
    placed = list(objects)
    order = sorted(range(len(placed)), key=lambda k: placed[k].top)
    for k in order:
        obj = placed[k]
        others = [j for j in order if j != k and _over_one_another(placed[j], obj)]
        below = [j for j in others if _carries(placed[j], obj)]
        held = abs(hand[2] - obj.centre[2]) < 0.5 * obj.spans[2] + IN_HAND
        held = held and obj.covers(hand[None, :2], IN_HAND)[0]
        if not below and obj.floating and not held:
            below = [j for j in others if placed[j].top < min(obj.bottom + TOUCH, obj.top - THIN)]
        if below:
            carrier = max(below, key=lambda j: placed[j].top)
            obj = obj if obj.floating else obj.resting_at(placed[carrier].top)
            placed[k] = replace(obj, on=carrier)
    return placed


def _carries(lower: SeenObject, upper: SeenObject) -> bool:
    """Whether nothing of ``upper`` is seen below the top of ``lower``, nor free space between them."""
    gap = upper.floating and upper.bottom > lower.top + TOUCH
    return not gap and lower.top <= min(upper.top - THIN, upper.lowest + TOUCH)


def _over_one_another(lower: SeenObject, upper: SeenObject) -> bool:
    over = lower.covers(upper.centre[None, :2])[0]
    return bool(over or (upper.floating and upper.covers(lower.centre[None, :2])[0]))


BULKY = 0.012  # metres: a thinner piece may be set into the side of another
SHARED = 0.5  # of the smaller solid that is within the other, where both cannot be there
FLUSH = 0.003  # metres: paint stands off by less
ON_IT = 0.9  # share of a piece's points that are on another's solid, where it is paint
SCRAP = 0.01  # of another piece's pixels: fewer that hang in the air are of it
SEAM = 0.003  # metres: a point that is higher than another piece by this is above it
ABOVE = 0.6  # share of a piece's points above another, which is under it then
STEPS = np.linspace(-0.4, 0.4, 5)  # of a solid's extents, where it is looked at


def join_overlapping(
    draft: SceneDraft, frames: Sequence[TableFrame], pixels: Pixels, bodies: IntArray, gap: float
) -> None:
    """Pieces of one body that are in the same space are one object, shaped anew from all its pixels.

    ``bodies`` (N,) labels the pixels' bodies, -1 for none. What is known to be something is left alone, and so is
    what is in something hollow, or stands on the other piece.
    """
    left = [k for k in draft.left() if _is_plain(draft.objects[k])]
    body = [_body_of(bodies, draft.objects[k]) for k in left]
    pairs = []
    for a, b in combinations(range(len(left)), 2):
        one, other = draft.objects[left[a]], draft.objects[left[b]]
        stands = left[a] == draft.carrier(left[b]) or left[b] == draft.carrier(left[a])
        stands = stands or _is_above(one, other) or _is_above(other, one)
        if body[a] == body[b] >= 0 and not stands and any(rule(one, other) for rule in RULES):
            pairs.append((a, b))
    wholes = connected(len(left), np.array(pairs, dtype=np.int64).reshape(-1, 2))
    for whole in np.unique(wholes):
        mine = [left[i] for i in np.nonzero(wholes == whole)[0]]
        if len(mine) < 2:
            continue
        main = max(mine, key=lambda k: len(draft.objects[k].members))
        members = np.sort(np.concatenate([draft.objects[k].members for k in mine]))
        joined = opened(frames, shape_object(frames, pixels, members, gap))
        draft.take_in(main, [k for k in mine if k != main])
        old = draft.objects[main]
        draft.objects[main] = replace(joined, group=old.group, on=old.on, textured=True)


def _is_plain(obj: SeenObject) -> bool:
    return not obj.noun and obj.part_of < 0 and obj.turn is None


def _body_of(bodies: IntArray, obj: SeenObject) -> int:
    """The body that most of an object's pixels belong to, -1 for none."""
    own = bodies[obj.members]
    own = own[own >= 0]
    return int(np.bincount(own).argmax()) if len(own) else -1


def _intersect(one: SeenObject, other: SeenObject) -> bool:
    """Whether most of the smaller of two solids is within the other, and neither is thin or hollow."""
    small, large = _by_size(one, other)
    if min(small.extents) < BULKY or one.hollow or other.hollow:
        return False
    at = small.grid(STEPS, STEPS, STEPS)
    high = np.abs(at[:, 2] - large.centre[2]) < 0.5 * large.extents[2]
    return bool((high & large.covers(at[:, :2])).mean() > SHARED)


def _is_paint(one: SeenObject, other: SeenObject) -> bool:
    """Whether what is seen of one lies on the solid that explains the other; on the walls of a hollow one."""
    return _lies_on(one, other) or _lies_on(other, one)


def _lies_on(piece: SeenObject, other: SeenObject) -> bool:
    if other.agreement < GOOD or len(piece.members) > len(other.members):
        return False
    on_it = (np.abs(other.local(piece.points)) < 0.5 * other.extents + FLUSH).all(axis=1)
    if other.hollow:
        on_it &= ~within_walls(other, piece.points, EDGE)
    return bool(on_it.mean() > ON_IT)


def _is_above(upper: SeenObject, lower: SeenObject) -> bool:
    """Whether one lies on the other, as a lid on a jar, though a few pixels of each are taken to be of the other."""
    up, low = upper.points[:, 2], lower.points[:, 2]
    over = float((up > np.percentile(low, 99.0) + SEAM).mean()) > ABOVE
    bulky = min(*upper.extents, *lower.extents) > BULKY  # a print on a side is not under the top
    return over or bool(bulky and np.percentile(up, 5.0) > np.percentile(low, 90.0))


def _is_scrap(one: SeenObject, other: SeenObject) -> bool:
    """Whether one piece is a few pixels in the air, carried by nothing, beside a large one: a rim, a print, a shade."""
    small, large = sorted((one, other), key=lambda obj: len(obj.members))
    return small.floating and small.on < 0 and len(small.members) < SCRAP * len(large.members)


def _by_size(one: SeenObject, other: SeenObject) -> tuple[SeenObject, SeenObject]:
    small, large = sorted((one, other), key=lambda obj: float(obj.extents.prod()))
    return small, large


RULES = (_intersect, _is_paint, _is_scrap)
