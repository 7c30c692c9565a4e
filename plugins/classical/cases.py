"""Cases: what closes a box, what is set into its side, and what sticks out of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from gvla2.geometry.transform import FloatArray
from gvla2_plugins.classical.clusters import alike
from gvla2_plugins.classical.composites import SceneDraft, boxed
from gvla2_plugins.classical.things import THIN, Thing

VENEER = 0.03  # metres: what is seen of a lid is no higher
BESIDE = 0.025  # metres that a lid may stand over its box
HINGED = 0.05  # metres between a box's edge and the lower edge of its open lid
LARGE = 0.08  # metres: no side of a case is shorter
FLUSH = 0.012  # metres between a panel and the side that it is set into
COVERED = 0.3  # of a side: a panel is no smaller
REACH = 0.08  # metres that something sticks out
BAR = 0.02  # metres: a handle is no thicker
DEEP = 0.67  # of a handle's length: it stands off by less; what reaches out further is stuck in the case


def join_lids(draft: SceneDraft) -> None:
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
                draft.things[k] = replace(lid, noun="lid", part_of=boxes[0], on=boxes[0])
                draft.things[boxes[0]] = replace(draft.things[boxes[0]], noun="open box")
        elif not lid.floating and 0.05 < lid.top < lid.lowest + VENEER and min(lid.extents[:2]) > LARGE:
            _close(draft, k)


def _hinged(box: Thing, foot: FloatArray) -> bool:
    near = abs(foot[2] - box.top) < HINGED and box.covers(foot[None, :2], HINGED)[0]
    return bool(near and box.hollow and box.kind == "box")


def _close(draft: SceneDraft, k: int) -> None:
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
    draft.things[main] = replace(body, noun="box", on=-1)
    draft.things[k] = replace(top.resting_at(body.top), noun="lid", on=main, part_of=main)


def _side_under(side: Thing, top: Thing) -> bool:
    """Whether a piece is under a flat top, and within its outline."""
    if side.turn is not None or side.hollow or side.noun or side.top > top.lowest + 0.01:
        return False
    return bool(top.covers(side.points[:, :2], BESIDE).mean() > 0.9)


def join_fronts(draft: SceneDraft) -> None:
    """A panel of another colour in a side of a large box is its drawer; of what is in the air before a side, a bar
    along it is a handle, and what reaches out further is a brick that sticks in a tower.
    """
    for k in draft.left():
        case = draft.things[k]
        plain = case.kind in ("box", "other") and not case.noun and case.turn is None and not case.hollow
        if draft.now(k) != k or not plain or min(case.extents) < LARGE:
            continue
        pieces = {j: _before(draft.things[j], case) for j in draft.left() if j != k}
        for side in {piece.side: None for piece in pieces.values() if piece is not None}:
            here = {j: piece for j, piece in pieces.items() if piece is not None and piece.side == side}
            if _join_front(draft, k, here):
                break


@dataclass(frozen=True)
class _Piece:
    """A piece before a side of a case: from ``near`` to ``far`` metres off it, its two ``breadths`` along it."""

    side: tuple[int, int]
    near: float
    far: float
    breadths: FloatArray

    @property
    def slim(self) -> bool:
        """Whether it is a bar along the side: longer than it stands off."""
        thick, long = sorted(self.breadths.tolist())
        return bool(thick < BAR and long > 2.0 * thick and self.far - self.near < DEEP * long)


def _before(piece: Thing, case: Thing) -> _Piece | None:
    """Where a piece is that is before one side of a case, and within its outline; None for others."""
    if piece.turn is not None or piece.noun:
        return None
    low, high = np.percentile(case.local(piece.points), [4.0, 96.0], axis=0)
    half = 0.5 * case.extents
    gaps = np.stack([low - half, -half - high])[:, :2]
    end, axis = (int(i) for i in np.unravel_index(np.argmax(gaps), gaps.shape))
    others = np.delete(np.maximum(high, -low) - half, axis)
    near = float(gaps[end, axis])
    if others.max() > 0.005 or near < -FLUSH:
        return None
    return _Piece((end, axis), near, near + float((high - low)[axis]), np.delete(high - low, axis))


def _join_front(draft: SceneDraft, k: int, pieces: dict[int, _Piece]) -> bool:
    """Put together what is before one side of the case ``k``; whether there was anything."""
    case, owner = draft.things[k], k
    sizes = {j: len(draft.things[j].members) for j in pieces}
    flush = [j for j, piece in pieces.items() if piece.far < FLUSH and not draft.things[j].hollow]
    flush = [j for j in flush if not alike(draft.looks[j], draft.looks[k])]
    out = [j for j, p in pieces.items() if draft.things[j].floating and p.near > -0.005 and p.far < REACH]
    bars = [j for j in out if j not in flush and pieces[j].slim]
    if flush and _covered(case, [draft.things[j] for j in flush], pieces[flush[0]].side[1]) > COVERED:
        owner = max(flush, key=sizes.__getitem__)
        draft.take_in(owner, [j for j in flush if j != owner])
        draft.things[owner] = replace(_about(draft.things[owner], case), noun="drawer", part_of=k, on=-1)
        draft.things[k] = replace(case, noun="cabinet")
    if bars and (owner != k or len(bars) == 1):
        # Scraps of it, in other light, would only blur where it is.
        best = max(bars, key=sizes.__getitem__)
        draft.take_in(owner, [j for j in bars if j != best])
        draft.things[best] = replace(_about(draft.things[best], case), noun="handle", part_of=owner, on=-1)
        if owner == k:
            draft.things[k] = replace(case, noun="drawer cabinet")
    elif out and not bars and owner == k:
        draft.things[out[0]] = replace(draft.things[out[0]], noun="brick", on=-1)
        draft.things[k] = replace(case, noun="tower")
    return bool(draft.things[k].noun)


def _covered(case: Thing, panels: Sequence[Thing], axis: int) -> float:
    """The share of a side of the case, across its ``axis``, that panels span."""
    local = case.local(np.concatenate([panel.points for panel in panels]))
    spans = np.ptp(np.percentile(local, [1.0, 99.0], axis=0), axis=0) / case.extents
    return float(np.delete(spans, axis).prod())


def _about(thing: Thing, case: Thing) -> Thing:
    """The thing as a box in the case's own axes about its points."""
    return boxed(thing, case, *np.percentile(case.local(thing.points), [0.5, 99.5], axis=0))
