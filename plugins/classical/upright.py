"""Upright wholes: bottles and jars with what closes them, what stands in a stand, a knife in its block."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gvla2_plugins.classical.clusters import alike
from gvla2_plugins.classical.composites import Draft, grown
from gvla2_plugins.classical.leaning import lean_of, leant
from gvla2_plugins.classical.things import Thing

AXIS = 0.25  # of a carrier's width: how far off its axis a part of it may be
TALL = 1.15  # a vessel is taller, in its widths
HOVER = 0.05  # metres between a vessel and a head on a neck that is not seen
SLIM = 0.045  # metres: what is no wider can be a stick, a grip, a neck
WITHIN = 0.006  # metres inside a wall where a seen point tells that the thing is hollow
FEWEST = 10
LONG = 1.6  # what is longer, in its breadths, closes nothing round
SEAM = 0.003  # metres: a gap that is no greater is none
FAR_SIDE = 0.008  # metres beside a neck where a piece of it may seem to be


def join_stems(draft: Draft) -> None:
    """Slim round things in line within and above a stand become one; the broader end of it is its handle."""
    for k in draft.left():
        stand = draft.things[k]
        if stand.noun or not _could_hold(stand):
            continue
        inner = [j for j in draft.left() if j != k and _goes_into(draft.things[j], stand)]
        above = [
            j
            for j in draft.left()
            if j != k and j not in inner and _slim(draft.things[j]) and _over(draft, j, {k, *inner})
        ]
        stems = [j for j in (*inner, *above) if _coaxial(draft.things[j], stand, 0.35)]
        if not inner or not stems:
            continue
        draft.change(k, replace(stand, hollow=True, noun="stand", opening=stand.opening or _inside(stand)))
        order = sorted(stems, key=lambda j: draft.things[j].top)
        main = max(inner, key=lambda j: draft.things[j].spans[0])
        top, below = order[-1], order[:-1]
        handle = len(order) > 1 and _wider(draft, top, below)
        whole = draft.things[main]
        reach = float(draft.things[top].top)
        points = np.concatenate([draft.things[j].points for j in order])
        whole = grown(whole, points, min(whole.bottom, 0.01), reach)
        draft.change(main, replace(whole, noun="umbrella" if handle else "stick", on=k, floating=False))
        draft.take_in(main, [j for j in order if j != main and not (handle and j == top)])
        if handle:
            draft.change(top, replace(_as_seen(draft.things[top]), noun="handle", part_of=main))


def join_bottles(draft: Draft) -> None:
    """What narrows upwards on a vessel belongs to it; a flat thing as wide as what it covers is its cap or lid."""
    for k in sorted(draft.left(), key=lambda j: draft.things[j].top):
        vessel = draft.things[k]
        if draft.now(k) != k or vessel.noun or vessel.hollow or not _vessel(vessel):
            continue
        chain = _chain(draft, k)
        if not chain:
            continue
        cover = chain[-1] if _closes(draft, chain, k) else -1
        body = [j for j in chain if j != cover]
        if cover >= 0:
            draft.change(cover, _as_seen(draft.things[cover]))
        if not body and cover >= 0:
            wide = draft.things[cover].spans[0] > 0.75 * vessel.spans[0]
            if vessel.kind == "cylinder" and wide:
                draft.change(k, replace(vessel, noun="jar"))
                draft.change(cover, replace(draft.things[cover], noun="lid", part_of=k))
            elif vessel.kind == "cylinder":
                draft.change(k, replace(vessel, noun="bottle"))
                draft.change(cover, replace(draft.things[cover], noun="cap", part_of=k))
            continue
        if body:
            top = max(draft.things[j].top for j in body)
            points = np.concatenate([draft.things[j].points for j in body])
            turned = draft.things[max(body, key=lambda j: draft.things[j].spans[:2].max())]
            top = top if cover < 0 else max(top, draft.things[cover].bottom)
            whole = grown(replace(vessel, yaw=_yaw(vessel, turned)), points, vessel.bottom, top)
            draft.change(k, replace(whole, noun="bottle"))
            draft.take_in(k, body)
        if cover >= 0:
            draft.change(cover, replace(draft.things[cover], noun="cap", part_of=k))


def name_knives(draft: Draft) -> None:
    """A slim flat grip of another colour that stands on a block which is much higher than it is deep."""
    for k in draft.left():
        block = draft.things[k]
        grips = [j for j in draft.on_top(k) if _grip(draft.things[j])]
        if block.noun or block.kind != "box" or block.hollow or len(grips) != 1:
            continue
        (grip,) = grips
        if block.extents[2] < 1.5 * min(block.extents[:2]) or alike(draft.looks[grip], draft.looks[k]):
            continue
        axis = lean_of(block)
        draft.change(grip, replace(leant(draft.things[grip], axis), noun="knife"))
        draft.change(k, replace(leant(block, axis), noun="knife block"))


def _could_hold(thing: Thing) -> bool:
    solid = thing.kind in ("box", "cylinder") and thing.turn is None and not thing.floating
    return solid and thing.on < 0 and thing.extents[2] > 0.05 and min(thing.extents[:2]) > SLIM


def _as_seen(thing: Thing) -> Thing:
    """A thing that was brought down to what carries it, from its lowest seen point up: its edge hides what is below."""
    return thing.resting_at(thing.lowest) if thing.lowest > thing.bottom + SEAM else thing


def _inside(stand: Thing) -> float:
    return float(max(0.0, min(stand.extents[:2]) - 2 * WITHIN))


def _goes_into(thing: Thing, stand: Thing) -> bool:
    """Whether points of the thing were seen inside the walls of the stand, below its top, and most of it is slim."""
    if thing.turn is not None or thing.spans[:2].max() > 0.85 * min(stand.extents[:2]):
        return False
    if thing.extents[2] < 2.0 * thing.spans[:2].max() or thing.top < 0.5 * stand.top:
        return False
    local = np.abs(stand.local(thing.points))
    deep = (local[:, :2] < 0.5 * stand.extents[:2] - WITHIN).all(axis=1)
    if stand.hollow and stand.extents[2] > min(stand.extents[:2]) and deep.mean() > 0.9:
        return True  # over the mouth of something deep there is nothing to stand on
    if thing.top < stand.top - SEAM and deep.mean() > 0.9:
        return True  # nor is there where it ends below the rim
    deep &= thing.points[:, 2] < stand.top - WITHIN
    return bool(deep.sum() >= FEWEST and deep.mean() > 0.3)


def _slim(thing: Thing) -> bool:
    return thing.turn is None and bool(thing.spans[:2].max() < SLIM)


def _over(draft: Draft, j: int, below: set[int]) -> bool:
    """Whether a thing stands, through others or not, on one of ``below``."""
    for _ in draft.things:
        j = draft.carrier(j)
        if j in below:
            return True
        if j < 0:
            return False
    return False


def _coaxial(thing: Thing, other: Thing, share: float) -> bool:
    off = float(np.linalg.norm(thing.centre[:2] - other.centre[:2]))
    return off < share * float(min(other.spans[:2]))


def _wider(draft: Draft, top: int, below: list[int]) -> bool:
    """Whether the uppermost piece is a piece of its own: broader than the one under it, or away from all others."""
    piece = draft.things[top]
    lower = [j for j in below if draft.things[j].lowest < piece.bottom]  # others are beside it
    under = draft.things[max(lower or below, key=lambda j: draft.things[j].top)]
    return bool(piece.spans[:2].max() > 1.25 * under.spans[:2].max() or piece.lowest > under.top + 0.01)


def _vessel(thing: Thing) -> bool:
    if thing.kind not in ("box", "cylinder") or thing.turn is not None or thing.floating:
        return False
    return bool(
        thing.extents[2] > TALL * min(thing.extents[:2])
        and thing.extents[2] > 0.05
        and max(thing.extents[:2]) < 0.16
    )


def _chain(draft: Draft, k: int) -> list[int]:
    """What stands in line on a vessel, each piece alone on the one before, none as broad as the vessel but a lid.

    Pieces cut from the vessel side by side, as a neck that is seen from two sides, count as one.
    """
    chain: list[int] = []
    at, carriers, vessel = k, [k], draft.things[k]
    while True:
        above = [
            j
            for c in carriers
            for j in draft.on_top(c)
            if j not in chain and j not in carriers and not draft.things[j].noun
        ]
        cut = [j for j in above if len(above) > 1 and _is_cut(draft.things[j], vessel, draft.things[at])]
        rest = [j for j in above if j not in cut]
        if cut and len(rest) < 2:
            chain = [*cut, *chain] if rest else [*chain, *cut]
            at = at if rest else max(cut, key=lambda j: len(draft.things[j].members))
            carriers = [*carriers, *cut] if rest else cut
        if not rest and cut:
            continue
        if len(rest) != 1:
            return chain
        piece = draft.things[rest[0]]
        if not _coaxial(piece, vessel, AXIS) or not _belongs(draft, rest[0], at, vessel):
            return chain
        chain.append(rest[0])
        at, carriers = rest[0], [rest[0]]


def _is_cut(piece: Thing, vessel: Thing, under: Thing) -> bool:
    """Whether a piece was one with the vessel before a split by height, and is over what it stands on."""
    own = piece.group == vessel.group and piece.group >= 0
    return own and bool(under.covers(piece.points[:, :2], FAR_SIDE).mean() > 0.8)


def _belongs(draft: Draft, j: int, at: int, vessel: Thing) -> bool:
    """Whether a piece is of the vessel: cut from it, narrower and round, a head above a hidden neck, or a cover."""
    piece, under = draft.things[j], draft.things[at]
    narrow = piece.spans[:2].max() < 0.75 * min(vessel.spans[:2])
    if piece.group == vessel.group and piece.group >= 0:
        return True
    if _covers(draft, j, at):
        return True
    foot = _as_seen(piece).bottom
    aloft = (piece.floating or foot > under.top + 2 * SEAM) and under.top < foot < under.top + HOVER
    if aloft and vessel.kind == "cylinder" and piece.spans[:2].min() < 0.6 * vessel.spans[0]:
        return True
    on_neck = under is not vessel and under.spans[:2].max() < 0.6 * min(vessel.spans[:2])
    if on_neck or _narrows(under):
        return bool(piece.spans[:2].max() < 1.5 * max(vessel.spans[:2]))  # a head on a neck
    return bool(piece.kind == "cylinder" and narrow)


def _narrows(vessel: Thing) -> bool:
    """Whether a round thing is much slimmer at its top: a neck was not told from it."""
    if vessel.kind != "cylinder":
        return False
    local = vessel.local(vessel.points)
    upper = local[local[:, 2] > 0.42 * vessel.extents[2], :2]
    if len(upper) < FEWEST:
        return False
    return float(np.percentile(np.linalg.norm(upper, axis=1), 90.0)) < 0.3 * vessel.extents[0]


def _closes(draft: Draft, chain: list[int], k: int) -> bool:
    """Whether the last of a chain covers what carries it."""
    carrier = draft.carrier(chain[-1])
    return carrier in (k, *chain) and _covers(draft, chain[-1], carrier)


def _covers(draft: Draft, j: int, at: int) -> bool:
    """Whether a flat thing of another colour lies on a round thing and is about as wide."""
    piece, under = draft.things[j], draft.things[at]
    flat = _as_seen(piece).extents[2] < 0.6 * max(piece.extents[:2])
    flat &= bool(max(piece.spans[:2]) < LONG * min(piece.spans[:2]))
    share = float(max(piece.spans[:2]) / max(under.spans[:2]))
    standing = abs(piece.bottom - under.top) < 0.008
    return bool(
        flat
        and standing
        and (0.25 if under.extents[2] > 2.0 * max(under.extents[:2]) else 0.7) < share < 1.8
        and under.kind == "cylinder"
        and (share > 1.05 or not alike(draft.looks[j], draft.looks[at]))
    )


def _yaw(vessel: Thing, head: Thing) -> float:
    """How a vessel is turned: a round one like what stands on it and is not round."""
    return head.yaw if vessel.kind == "cylinder" and head.kind != "cylinder" else vessel.yaw


def _grip(thing: Thing) -> bool:
    slim = float(max(thing.extents[:2]))
    return thing.turn is None and bool(
        thing.kind == "box" and slim < SLIM and thing.extents[2] > 2.2 * slim and not thing.noun
    )
