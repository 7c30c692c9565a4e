"""Cases: what closes a box, what is set into its side, and what sticks out of it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gvla2.geometry.transform import FloatArray
from gvla2_plugins.classical.clusters import alike
from gvla2_plugins.classical.composites import Draft, boxed
from gvla2_plugins.classical.things import THIN, Thing

VENEER = 0.03  # metres: what is seen of a lid is no higher
BESIDE = 0.025  # metres that a lid may stand over its box
HINGED = 0.05  # metres between a box's edge and the lower edge of its open lid
LARGE = 0.08  # metres: no side of a case is shorter
FLUSH = 0.012  # metres between a panel and the side that it is set into
COVERED = 0.3  # of a side: a panel is no smaller
REACH = 0.08  # metres that something sticks out
BAR = 0.02  # metres: a handle is no thicker
DEEP = 0.8  # of a handle's length: it stands off by less; what reaches out further is stuck in the case


def join_lids(draft: Draft) -> None:
    """What closes a box: a flat top of another colour over its sides, which are one box then, or a plate that leans
    and whose lower edge is along the upper edge of an open one.
    """
    for k in draft.left():
        lid = draft.things[k]
        if draft.now(k) != k or lid.noun or lid.hollow or lid.kind != "box":
            continue
        if lid.turn is not None:
            foot = lid.centre - 0.5 * lid.extents[1] * lid.turn[:, 1]
            boxes = [j for j in draft.left() if j != k and _hinged(draft.things[j], foot)]
            if boxes:
                draft.change(k, replace(lid, noun="lid", part_of=boxes[0], on=boxes[0]))
                draft.change(boxes[0], replace(draft.things[boxes[0]], noun="open box"))
        elif not lid.floating and 0.05 < lid.top < lid.lowest + VENEER and min(lid.extents[:2]) > LARGE:
            _close(draft, k)


def _hinged(box: Thing, foot: FloatArray) -> bool:
    near = abs(foot[2] - box.top) < HINGED and box.covers(foot[None, :2], HINGED)[0]
    return bool(near and box.hollow and box.kind == "box")


def _close(draft: Draft, k: int) -> None:
    """Make what is under the flat thing ``k`` a box, and ``k`` its lid; the lid's outline tells how large it is."""
    top = draft.things[k]
    sides = [
        j
        for j in draft.left()
        if j != k and _side_under(draft.things[j], top) and not alike(draft.looks[j], draft.looks[k])
    ]
    large = [j for j in sides if draft.things[j].extents[2] > 0.6 * top.lowest]
    if not large:
        return
    main = max(large, key=lambda j: len(draft.things[j].members))
    draft.take_in(main, [j for j in sides if j != main])
    body = draft.things[main]
    # Its sides where they were seen, the lid's edge elsewhere.
    half = 0.5 * top.extents
    low, high = np.percentile(top.local(body.points), [1.0, 99.0], axis=0)
    low[:2] = np.where(low < BESIDE - half, low, -half)[:2]
    high[:2] = np.where(high > half - BESIDE, high, half)[:2]
    low[2], high[2] = -top.centre[2], min(high[2], half[2] - THIN)
    body = boxed(body, top, low, high)
    draft.change(main, replace(body, noun="box", on=-1))
    draft.change(k, replace(top.resting_at(body.top), noun="lid", on=main, part_of=main))


def _side_under(side: Thing, top: Thing) -> bool:
    """Whether a piece is under a flat top, and within its outline."""
    if side.turn is not None or side.hollow or side.noun or side.top > top.lowest + 0.01:
        return False
    return bool(top.covers(side.points[:, :2], BESIDE).mean() > 0.9)


def join_fronts(draft: Draft) -> None:
    """A panel of another colour in a side of a large box is its drawer; of what is in the air before that side, a
    bar along it is a handle, and what reaches out further is a brick that sticks in a tower.
    """
    for k in draft.left():
        case = draft.things[k]
        plain = case.kind in ("box", "other") and not case.noun and case.turn is None and not case.hollow
        if draft.now(k) != k or not plain or min(case.extents) < LARGE:
            continue
        for axis, sign in ((0, 1.0), (0, -1.0), (1, 1.0), (1, -1.0)):
            if _join_front(draft, k, axis, sign):
                break


def _join_front(draft: Draft, k: int, axis: int, sign: float) -> bool:
    """Put together what belongs to one side of the case ``k``; whether there was anything."""
    case, others = draft.things[k], [j for j in draft.left() if j != k]
    others = [j for j in others if draft.things[j].turn is None and not draft.things[j].noun]
    panels = [
        j
        for j in others
        if _before(draft.things[j], case, axis, sign, -FLUSH, FLUSH) > 0.8
        and not draft.things[j].hollow
        and not alike(draft.looks[j], draft.looks[k])
    ]
    out = [
        j
        for j in others
        if draft.things[j].floating and _before(draft.things[j], case, axis, sign, -0.005, REACH) > 0.9
    ]
    out = [j for j in out if j not in panels]
    bars = [j for j in out if _is_bar(draft.things[j], case, axis)]
    owner = k
    if panels:
        owner = max(panels, key=lambda j: len(draft.things[j].members))
        whole = _about(draft.things[owner], np.concatenate([draft.things[j].points for j in panels]), case)
        if np.delete(whole.extents, np.argmin(whole.extents)).prod() < COVERED * (
            case.extents[1 - axis] * case.extents[2]
        ):
            owner = k
        else:
            draft.take_in(owner, [j for j in panels if j != owner])
            whole = replace(whole, points=draft.things[owner].points)
            draft.change(owner, replace(whole, noun="drawer", part_of=k, on=-1))
            draft.change(k, replace(case, noun="cabinet"))
    if bars and (owner != k or len(bars) == 1):
        # Scraps of it, in other light, would only blur where it is.
        best = max(bars, key=lambda j: len(draft.things[j].members))
        handle = _about(draft.things[best], draft.things[best].points, case)
        draft.take_in(owner, [j for j in bars if j != best])
        draft.change(best, replace(handle, noun="handle", part_of=owner, on=-1))
        if owner == k:
            draft.change(k, replace(case, noun="drawer cabinet"))
        return True
    if out and not bars and owner == k:
        draft.change(out[0], replace(draft.things[out[0]], noun="brick", on=-1))
        draft.change(k, replace(case, noun="tower"))
        return True
    return owner != k


def _before(piece: Thing, case: Thing, axis: int, sign: float, low: float, high: float) -> float:
    """The share of a piece's points that are before a side of a case, from ``low`` to ``high`` metres off it."""
    local = case.local(piece.points)
    off = sign * local[:, axis] - 0.5 * case.extents[axis]
    within = np.abs(local[:, [1 - axis, 2]]) < 0.5 * case.extents[[1 - axis, 2]] + 0.005
    return float((within.all(axis=1) & (off > low) & (off < high)).mean())


def _is_bar(piece: Thing, case: Thing, axis: int) -> bool:
    """Whether a piece is slim, and longer than it stands off."""
    low, high = np.percentile(case.local(piece.points), [1.0, 99.0], axis=0)
    breadth, off = np.delete(high - low, axis), (high - low)[axis]
    return bool(breadth.min() < BAR and breadth.max() > 2.0 * breadth.min() and off < DEEP * breadth.max())


def _about(thing: Thing, points: FloatArray, case: Thing) -> Thing:
    """The thing as a box in the case's own axes about points (N, 3)."""
    low, high = np.percentile(case.local(points), [0.5, 99.5], axis=0)
    return boxed(thing, case, low, high)
