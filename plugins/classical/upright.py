"""Upright wholes: bottles and jars with what closes them, what stands in a stand, a knife in its block."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gvla2_plugins.classical.clusters import alike
from gvla2_plugins.classical.composites import SceneDraft, boxed
from gvla2_plugins.classical.leaning import lean_of, leant
from gvla2_plugins.classical.things import Thing

AXIS = 0.25  # of a carrier's width: how far off its axis a part of it may be
TALL = 1.15  # a vessel is taller, in its widths
HOVER = 0.05  # metres between a vessel and a head on a neck that is not seen
SLIM = 0.045  # metres: what is no wider can be a stick, a grip, a neck
WITHIN = 0.006  # metres inside a wall where a seen point tells that the thing is hollow
LONG = 1.6  # what is longer, in its breadths, closes nothing round
FAR_SIDE = 0.008  # metres beside a neck where a piece of it may seem to be
SEAM = 0.003  # metres: a gap that is no greater is none


def join_stems(draft: SceneDraft) -> None:
    """Slim round things in line within and above a stand become one; the broader end of it is its handle."""
    for k in draft.left():
        stand = draft.things[k]
        solid = stand.kind in ("box", "cylinder") and stand.turn is None and not stand.floating
        if stand.noun or not solid or stand.on >= 0 or stand.extents[2] < 0.05 or _slim(stand):
            continue
        inner = [j for j in draft.left() if j != k and _goes_into(draft.things[j], stand)]
        over = [j for j in draft.left() if j != k and draft.things[j].on >= 0 and _slim(draft.things[j])]
        stems = [j for j in {*inner, *over} if _in_line(draft.things[j], stand, 0.35)]
        if not inner or not stems:
            continue
        opening = stand.opening or max(0.0, float(min(stand.extents[:2])) - 2 * WITHIN)
        draft.things[k] = replace(stand, hollow=True, noun="stand", opening=opening)
        *below, top = sorted(stems, key=lambda j: draft.things[j].top)
        main = max(inner, key=lambda j: draft.things[j].spans[0])
        handle = bool(below) and _is_end(draft.things[top], draft.things[below[-1]])
        whole = _grown(draft.things[main], [draft.things[j] for j in stems], draft.things[top].top)
        draft.things[main] = replace(whole, noun="umbrella" if handle else "stick", on=k, floating=False)
        draft.take_in(main, [j for j in stems if j != main and not (handle and j == top)])
        if handle:
            draft.things[top] = replace(_as_seen(draft.things[top]), noun="handle", part_of=main)


def join_bottles(draft: SceneDraft) -> None:
    """What narrows upwards on a vessel belongs to it; a flat thing as wide as what it covers is its cap or lid."""
    for k in sorted(draft.left(), key=lambda j: draft.things[j].top):
        vessel = draft.things[k]
        if draft.now(k) != k or vessel.noun or vessel.hollow or not _vessel(vessel):
            continue
        body = _line(draft, k)
        if not body:
            continue
        cover = body.pop() if _covers(draft, body[-1], draft.carrier(body[-1])) else -1
        closed = draft.things[cover]
        if body:
            top = max(draft.things[j].top for j in body)
            top = top if cover < 0 else max(top, _as_seen(closed).bottom)
            head = draft.things[max(body, key=lambda j: draft.things[j].spans[:2].max())]
            # How a round one is turned, its head tells.
            if vessel.kind == "cylinder" and head.kind != "cylinder":
                vessel = replace(vessel, yaw=head.yaw)
            whole = _grown(vessel, [draft.things[j] for j in body], top)
            draft.things[k] = replace(whole, noun="bottle")
            draft.take_in(k, body)
        else:
            wide = closed.spans[0] > 0.75 * vessel.spans[0]
            draft.things[k] = replace(vessel, noun="jar" if wide else "bottle")
        if cover >= 0:
            noun = "lid" if draft.things[k].noun == "jar" else "cap"
            draft.things[cover] = replace(_as_seen(closed), noun=noun, part_of=k)


def name_knives(draft: SceneDraft) -> None:
    """A slim flat grip of another colour that stands on a block which is much higher than it is deep."""
    for k in draft.left():
        block = draft.things[k]
        plain = block.kind == "box" and not block.hollow and not block.noun
        grips = [j for j in draft.left() if draft.carrier(j) == k and _is_grip(draft.things[j])]
        if len(grips) == 1 and plain and block.extents[2] > 1.5 * min(block.extents[:2]):
            axis, grip = lean_of(block), grips[0]
            if not alike(draft.looks[grip], draft.looks[k]):
                draft.things[grip] = replace(leant(draft.things[grip], axis), noun="knife")
                draft.things[k] = replace(leant(block, axis), noun="knife block")


def _as_seen(thing: Thing) -> Thing:
    """A thing that was brought down to what carries it, from its lowest seen point up: its edge hides what is below."""
    return thing.resting_at(thing.lowest) if thing.lowest > thing.bottom + SEAM else thing


def _goes_into(thing: Thing, stand: Thing) -> bool:
    """Whether a slim thing was seen within the walls of the stand, and could not stand there on anything else."""
    if thing.turn is not None or thing.spans[:2].max() > 0.85 * min(stand.extents[:2]):
        return False
    if thing.extents[2] < 2.0 * thing.spans[:2].max() or thing.top < 0.5 * stand.top:
        return False
    local = np.abs(stand.local(thing.points))
    deep = (local[:, :2] < 0.5 * stand.extents[:2] - WITHIN).all(axis=1)
    deep_stand = stand.hollow and stand.extents[2] > min(stand.extents[:2])
    # Over a deep mouth there is nothing to stand on, nor where it ends below the rim.
    return bool(deep.mean() > 0.9 and (deep_stand or thing.top < stand.top - SEAM))


def _grown(thing: Thing, others: list[Thing], top: float) -> Thing:
    """The thing with the upright box about itself and what is seen of others, as high as ``top``."""
    local = thing.local(np.concatenate([other.points for other in others]))
    seen, half = np.percentile(local, [1.0, 99.0], axis=0), 0.5 * thing.extents
    low, high = np.minimum(seen[0], -half), np.maximum(seen[1], half)
    low[2], high[2] = -half[2], top - thing.centre[2]
    return replace(boxed(thing, thing, low, high), kind=thing.kind)


def _slim(thing: Thing) -> bool:
    return thing.turn is None and bool(thing.spans[:2].max() < SLIM)


def _over(draft: SceneDraft, j: int, k: int) -> bool:
    """Whether the thing ``j`` stands, through others or not, on ``k``."""
    for _ in draft.things:
        j = draft.carrier(j) if j >= 0 else j
        if j == k:
            return True
    return False


def _in_line(thing: Thing, other: Thing, share: float) -> bool:
    off = float(np.linalg.norm(thing.centre[:2] - other.centre[:2]))
    return off < share * float(min(other.spans[:2]))


def _is_end(piece: Thing, under: Thing) -> bool:
    """Whether the uppermost piece is one of its own: broader than the one under it, or away from all others."""
    return bool(piece.spans[:2].max() > 1.25 * under.spans[:2].max() or piece.lowest > under.top + 0.01)


def _vessel(thing: Thing) -> bool:
    if thing.kind not in ("box", "cylinder") or thing.turn is not None or thing.floating:
        return False
    tall = thing.extents[2] > max(0.05, TALL * min(thing.extents[:2]))
    return bool(tall and max(thing.extents[:2]) < 0.16)


def _line(draft: SceneDraft, k: int) -> list[int]:
    """What stands in line on a vessel and belongs to it, from the lowest up: pieces cut from it, narrower round ones,
    a head on a neck or over one that is not seen, and a cover.
    """
    vessel, line, under = draft.things[k], [], k
    above = [j for j in draft.left() if j != k and _over(draft, j, k) and not draft.things[j].noun]
    for j in sorted(above, key=lambda j: draft.things[j].top):
        piece = draft.things[j]
        own = piece.group == vessel.group and piece.group >= 0
        width, wide = piece.spans[:2], float(min(vessel.spans[:2]))
        narrow = piece.kind == "cylinder" and width.max() < 0.75 * wide
        foot = _as_seen(piece).bottom - draft.things[under].top
        aloft = (piece.floating or foot > 2 * SEAM) and 0 < foot < HOVER and width.min() < 0.6 * wide
        neck = under != k and draft.things[under].spans[:2].max() < 0.6 * wide
        head = (aloft and vessel.kind == "cylinder") or (neck and width.max() < 1.5 * max(vessel.spans[:2]))
        straight = _in_line(piece, vessel, AXIS)
        straight |= own and bool(vessel.covers(piece.points[:, :2], FAR_SIDE).mean() > 0.8)
        if straight and (own or narrow or head or _covers(draft, j, under)):
            line.append(j)
            under = j
        elif straight:
            break
    return line


def _covers(draft: SceneDraft, j: int, at: int) -> bool:
    """Whether a flat thing of another colour lies on a round thing and is about as wide."""
    if at < 0:
        return False
    piece, under = draft.things[j], draft.things[at]
    long, short = float(max(piece.spans[:2])), float(min(piece.spans[:2]))
    share = long / float(max(under.spans[:2]))
    least = 0.25 if under.extents[2] > 2.0 * max(under.extents[:2]) else 0.7
    flat = _as_seen(piece).extents[2] < 0.6 * long and long < LONG * short
    lies = under.kind == "cylinder" and abs(piece.bottom - under.top) < 0.008
    other = share > 1.05 or not alike(draft.looks[j], draft.looks[at])
    return bool(flat and lies and least < share < 1.8 and other)


def _is_grip(thing: Thing) -> bool:
    return thing.kind == "box" and _slim(thing) and bool(thing.extents[2] > 2.2 * max(thing.extents[:2]))
