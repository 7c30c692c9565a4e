"""Objects of several solids: a bottle with its neck, a box with its lid, a drawer with its handle."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from gvla2.geometry.transform import FloatArray
from gvla2_plugins.classical.levels import lean_of, leant
from gvla2_plugins.classical.pixels import Pixels, alike
from gvla2_plugins.classical.solids import THIN, SeenObject, upright_rectangle


class SceneDraft:
    """The objects of a scene while they are put together; an object that was taken into another is gone."""

    def __init__(self, pixels: Pixels, objects: Sequence[SeenObject]) -> None:
        self.objects = list(objects)
        self.looks = [np.median(pixels.look[t.members], axis=0) for t in objects]
        self._into = list(range(len(objects)))

    def left(self) -> list[int]:
        """Indices of the objects that are still there and painted plainly."""
        return [k for k, into in enumerate(self._into) if into == k and not self.objects[k].textured]

    def now(self, k: int) -> int:
        """The object that this one was taken into: itself while it is there."""
        while k >= 0 and self._into[k] != k:
            k = self._into[k]
        return k

    def carrier(self, k: int) -> int:
        """The object that carries this one now, -1 for the table."""
        return self.now(self.objects[k].on)

    def take_in(self, k: int, others: Sequence[int]) -> None:
        """Make other objects part of an object's points; its own pixels still determine its colour."""
        for j in others:
            self._into[j] = k
        points = np.concatenate([self.objects[k].points, *(self.objects[j].points for j in others)])
        self.objects[k] = replace(self.objects[k], points=points)

    def finished(self) -> list[SeenObject]:
        """The objects that are left, with indices among themselves."""
        left = [k for k, into in enumerate(self._into) if into == k]
        place = {k: i for i, k in enumerate(left)} | {-1: -1}
        done = []
        for k in left:
            obj = self.objects[k]
            on, part_of = place[self.now(obj.on)], place[self.now(obj.part_of)]
            done.append(replace(obj, on=-1 if on == place[k] else on, part_of=part_of))
        return done


def put_together(
    pixels: Pixels, objects: Sequence[SeenObject], rules: Sequence[Callable[[SceneDraft], None]]
) -> list[SeenObject]:
    """The objects after all rules, in their order; each sees what those before it made."""
    draft = SceneDraft(pixels, objects)
    for rule in rules:
        rule(draft)
    return draft.finished()


def boxed(obj: SeenObject, host: SeenObject, low: FloatArray, high: FloatArray) -> SeenObject:
    """The object as an upright box from ``low`` to ``high`` (3,), metres from another's centre along its axes."""
    centre = host.pose[:3, :3] @ (0.5 * (low + high)) + host.centre
    lengths = np.maximum(high - low, THIN)
    yaw, width, depth = upright_rectangle(host.yaw, float(lengths[0]), float(lengths[1]))
    return replace(obj, kind="box", centre=centre, yaw=yaw, extents=np.array([width, depth, lengths[2]]))


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
        lid = draft.objects[k]
        if draft.now(k) != k or lid.noun or lid.hollow or lid.kind != "box":
            continue
        if lid.turn is not None:
            foot = lid.centre - 0.5 * lid.extents[1] * lid.turn[:, 1]
            boxes = [j for j in draft.left() if j != k and _hinged(draft.objects[j], foot)]
            if boxes:
                draft.objects[k] = replace(lid, noun="lid", part_of=boxes[0], on=boxes[0])
                draft.objects[boxes[0]] = replace(draft.objects[boxes[0]], noun="open box")
        elif not lid.floating and 0.05 < lid.top < lid.lowest + VENEER and min(lid.extents[:2]) > LARGE:
            _close(draft, k)


def _hinged(box: SeenObject, foot: FloatArray) -> bool:
    near = abs(foot[2] - box.top) < HINGED and box.covers(foot[None, :2], HINGED)[0]
    return bool(near and box.hollow and box.kind == "box")


def _close(draft: SceneDraft, k: int) -> None:
    """Make what is under the flat object ``k`` a box, and ``k`` its lid; the lid's outline gives its size."""
    top = draft.objects[k]
    sides = [
        j
        for j in draft.left()
        if j != k and _side_under(draft.objects[j], top) and not alike(draft.looks[j], draft.looks[k])
    ]
    large = [j for j in sides if draft.objects[j].extents[2] > 0.6 * top.lowest]
    if not large:
        return
    main = max(large, key=lambda j: len(draft.objects[j].members))
    draft.take_in(main, [j for j in sides if j != main])
    body = draft.objects[main]
    # Its sides where they were seen, the lid's edge elsewhere.
    half = 0.5 * top.extents
    low, high = np.percentile(top.local(body.points), [1.0, 99.0], axis=0)
    low[:2] = np.where(low < BESIDE - half, low, -half)[:2]
    high[:2] = np.where(high > half - BESIDE, high, half)[:2]
    low[2], high[2] = -top.centre[2], min(high[2], half[2] - THIN)
    body = boxed(body, top, low, high)
    draft.objects[main] = replace(body, noun="box", on=-1)
    draft.objects[k] = replace(top.resting_at(body.top), noun="lid", on=main, part_of=main)


def _side_under(side: SeenObject, top: SeenObject) -> bool:
    """Whether a piece is under a flat top, and within its outline."""
    if side.turn is not None or side.hollow or side.noun or side.top > top.lowest + 0.01:
        return False
    return bool(top.covers(side.points[:, :2], BESIDE).mean() > 0.9)


def join_fronts(draft: SceneDraft) -> None:
    """A panel of another colour in a side of a large box is its drawer; of what is in the air before a side, a bar
    along it is a handle, and what reaches out further is a brick that sticks in a tower.
    """
    for k in draft.left():
        case = draft.objects[k]
        plain = case.kind in ("box", "other") and not case.noun and case.turn is None and not case.hollow
        if draft.now(k) != k or not plain or min(case.extents) < LARGE:
            continue
        pieces = {j: _before(draft.objects[j], case) for j in draft.left() if j != k}
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


OUTLINE = 0.005  # metres that a piece may stick out of the outline of what it is before


def _before(piece: SeenObject, case: SeenObject, outline: float = OUTLINE) -> _Piece | None:
    """Where a piece is that is before one side of a case, and within its ``outline``, metres; None for others."""
    if piece.turn is not None or piece.noun:
        return None
    low, high = np.percentile(case.local(piece.points), [4.0, 96.0], axis=0)
    half = 0.5 * case.extents
    gaps = np.stack([low - half, -half - high])[:, :2]
    end, axis = (int(i) for i in np.unravel_index(np.argmax(gaps), gaps.shape))
    others = np.delete(np.maximum(high, -low) - half, axis)
    near = float(gaps[end, axis])
    if others.max() > outline or near < -max(FLUSH, outline):
        return None
    return _Piece((end, axis), near, near + float((high - low)[axis]), np.delete(high - low, axis))


def _join_front(draft: SceneDraft, k: int, pieces: dict[int, _Piece]) -> bool:
    """Put together what is before one side of the case ``k``; whether there was anything."""
    case, owner = draft.objects[k], k
    sizes = {j: len(draft.objects[j].members) for j in pieces}
    flush = [j for j, piece in pieces.items() if piece.far < FLUSH and not draft.objects[j].hollow]
    flush = [j for j in flush if not alike(draft.looks[j], draft.looks[k])]
    out = [j for j, p in pieces.items() if draft.objects[j].floating and p.near > -0.005 and p.far < REACH]
    bars = [j for j in out if j not in flush and pieces[j].slim]
    if flush and _covered(case, [draft.objects[j] for j in flush], pieces[flush[0]].side[1]) > COVERED:
        owner = max(flush, key=sizes.__getitem__)
        draft.take_in(owner, [j for j in flush if j != owner])
        draft.objects[owner] = replace(_about(draft.objects[owner], case), noun="drawer", part_of=k, on=-1)
        draft.objects[k] = replace(case, noun="cabinet")
    if bars and (owner != k or len(bars) == 1):
        # Scraps of it, in other light, would only blur where it is.
        best = max(bars, key=sizes.__getitem__)
        draft.take_in(owner, [j for j in bars if j != best])
        draft.objects[best] = replace(_about(draft.objects[best], case), noun="handle", part_of=owner, on=-1)
        if owner == k:
            draft.objects[k] = replace(case, noun="drawer cabinet")
    elif out and not bars and owner == k:
        draft.objects[out[0]] = replace(draft.objects[out[0]], noun="brick", on=-1)
        draft.objects[k] = replace(case, noun="tower")
    return bool(draft.objects[k].noun)


def _covered(case: SeenObject, panels: Sequence[SeenObject], axis: int) -> float:
    """The share of a side of the case, across its ``axis``, that panels span."""
    local = case.local(np.concatenate([panel.points for panel in panels]))
    spans = np.ptp(np.percentile(local, [1.0, 99.0], axis=0), axis=0) / case.extents
    return float(np.delete(spans, axis).prod())


def _about(obj: SeenObject, case: SeenObject) -> SeenObject:
    """The object as a box in the case's own axes about its points."""
    return boxed(obj, case, *np.percentile(case.local(obj.points), [0.5, 99.5], axis=0))


PANEL = 0.15  # metres: no side of a door is shorter
FIXED, STANDS_OFF = 0.08, (0.02, 0.15)  # metres between a door and what is seen of its handle, at either end
HIDDEN = 0.03  # metres of a door's edge that its frame may hide, and by which its thickness is uncertain


def join_doors(draft: SceneDraft) -> None:
    """A thin upright panel before which something smaller stands off, within its outline, is a door with its handle."""
    found = list[SeenObject]()
    for k in sorted(draft.left(), key=lambda j: -len(draft.objects[j].members)):
        panel = draft.objects[k]
        upright = (
            panel.kind in ("box", "other") and not panel.noun and panel.turn is None and not panel.hollow
        )
        if draft.now(k) != k or not upright or min(panel.extents[::2]) < PANEL or panel.extents[1] > LARGE:
            continue
        if any(door.covers(panel.centre[None, :2], LARGE)[0] for door in found):
            continue  # its frame
        near, far = STANDS_OFF
        pieces = {j: _before(draft.objects[j], panel, HIDDEN) for j in draft.left() if j != k}
        bars = {
            j: piece
            for j, piece in pieces.items()
            if piece is not None
            and piece.side[1] == 1
            and draft.objects[j].floating
            and near < piece.far < far
            and piece.breadths.max() < 0.5 * panel.extents[0]
        }
        fixed = [j for j, piece in bars.items() if piece.near < FIXED]
        if not fixed:
            continue
        best = max(fixed, key=lambda j: len(draft.objects[j].members))
        bar = replace(_about(draft.objects[best], panel), noun="handle", part_of=k, on=-1)
        draft.objects[best], draft.objects[k] = bar, replace(panel, noun="door")
        scraps = [j for j, piece in bars.items() if j != best and piece.side == bars[best].side]
        draft.take_in(best, [j for j in scraps if _is_around(bar, draft.objects[j])])
        found.append(panel)


def _is_around(bar: SeenObject, piece: SeenObject) -> bool:
    """Whether most of a piece is in or beside the box of a bar."""
    near = np.abs(bar.local(piece.points)) < 0.5 * bar.extents + BESIDE
    return bool(near.all(axis=1).mean() > 0.8)


AXIS = 0.25  # of a carrier's width: how far off its axis a part of it may be
TALL = 1.15  # a vessel is taller, in its widths
HOVER = 0.05  # metres between a vessel and a head on a neck that is not seen
SLIM = 0.045  # metres: what is no wider can be a stick, a grip, a neck
WITHIN = 0.006  # metres inside a wall where a seen point shows that the object is hollow
LONG = 1.6  # what is longer, in its breadths, closes nothing round
SEAM = 0.003  # metres: a gap that is no greater is none


def join_stems(draft: SceneDraft) -> None:
    """Slim round objects in line within and above a stand become one; the broader end of it is its handle."""
    for k in draft.left():
        stand = draft.objects[k]
        solid = stand.kind in ("box", "cylinder") and stand.turn is None and not stand.floating
        if stand.noun or not solid or stand.on >= 0 or stand.extents[2] < 0.05 or _slim(stand):
            continue
        inner = [j for j in draft.left() if j != k and _goes_into(draft.objects[j], stand)]
        over = [j for j in draft.left() if j != k and draft.objects[j].on >= 0 and _slim(draft.objects[j])]
        stems = [j for j in {*inner, *over} if _in_line(draft.objects[j], stand, 0.35)]
        if not inner or not stems:
            continue
        opening = stand.opening or max(0.0, float(min(stand.extents[:2])) - 2 * WITHIN)
        draft.objects[k] = replace(stand, hollow=True, noun="stand", opening=opening)
        *below, top = sorted(stems, key=lambda j: draft.objects[j].top)
        main = max(inner, key=lambda j: draft.objects[j].spans[0])
        handle = bool(below) and _is_end(draft.objects[top], draft.objects[below[-1]])
        whole = _grown(draft.objects[main], [draft.objects[j] for j in stems], draft.objects[top].top)
        draft.objects[main] = replace(whole, noun="umbrella" if handle else "stick", on=k, floating=False)
        draft.take_in(main, [j for j in stems if j != main and not (handle and j == top)])
        if handle:
            draft.objects[top] = replace(_as_seen(draft.objects[top]), noun="handle", part_of=main)


def join_bottles(draft: SceneDraft) -> None:
    """What narrows upwards on a vessel belongs to it; a flat object as wide as what it covers is its cap or lid."""
    for k in sorted(draft.left(), key=lambda j: draft.objects[j].top):
        vessel = draft.objects[k]
        if draft.now(k) != k or vessel.noun or vessel.hollow or not _vessel(vessel):
            continue
        body = _line(draft, k)
        if not body:
            continue
        cover = body.pop() if _covers(draft, body[-1], draft.carrier(body[-1])) else -1
        closed = draft.objects[cover]
        if body:
            top = max(draft.objects[j].top for j in body)
            top = top if cover < 0 else max(top, _as_seen(closed).bottom)
            head = draft.objects[max(body, key=lambda j: draft.objects[j].spans[:2].max())]
            # A round one has the yaw of its head.
            if vessel.kind == "cylinder" and head.kind != "cylinder":
                vessel = replace(vessel, yaw=head.yaw)
            whole = _grown(vessel, [draft.objects[j] for j in body], top)
            draft.objects[k] = replace(whole, noun="bottle")
            draft.take_in(k, body)
        else:
            wide = closed.spans[0] > 0.75 * vessel.spans[0]
            # The cover's edge hides what is between them: nothing is.
            whole = _grown(vessel, [vessel], max(vessel.top, _as_seen(closed).bottom))
            draft.objects[k] = replace(whole, noun="jar" if wide else "bottle")
        if cover >= 0:
            noun = "lid" if draft.objects[k].noun == "jar" else "cap"
            draft.objects[cover] = replace(_as_seen(closed), noun=noun, part_of=k)


def name_knives(draft: SceneDraft) -> None:
    """A slim flat grip of another colour that stands on a block which is much higher than it is deep."""
    for k in draft.left():
        block = draft.objects[k]
        plain = block.kind == "box" and not block.hollow and not block.noun
        grips = [j for j in draft.left() if draft.carrier(j) == k and _is_grip(draft.objects[j])]
        if len(grips) == 1 and plain and block.extents[2] > 1.5 * min(block.extents[:2]):
            axis, grip = lean_of(block), grips[0]
            if not alike(draft.looks[grip], draft.looks[k]):
                draft.objects[grip] = replace(leant(draft.objects[grip], axis), noun="knife")
                draft.objects[k] = replace(leant(block, axis), noun="knife block")


def _as_seen(obj: SeenObject) -> SeenObject:
    """An object that was brought down to its carrier, from its lowest seen point up: its edge hides what is below."""
    return obj.resting_at(obj.lowest) if obj.lowest > obj.bottom + SEAM else obj


def _goes_into(obj: SeenObject, stand: SeenObject) -> bool:
    """Whether a slim object was seen within the walls of the stand, and could not stand there on anything else."""
    if obj.turn is not None or obj.spans[:2].max() > 0.85 * min(stand.extents[:2]):
        return False
    if obj.extents[2] < 2.0 * obj.spans[:2].max() or obj.top < 0.5 * stand.top:
        return False
    local = np.abs(stand.local(obj.points))
    deep = (local[:, :2] < 0.5 * stand.extents[:2] - WITHIN).all(axis=1)
    deep_stand = stand.hollow and stand.extents[2] > min(stand.extents[:2])
    # Over a deep mouth there is nothing to stand on, nor where it ends below the rim.
    return bool(deep.mean() > 0.9 and (deep_stand or obj.top < stand.top - SEAM))


def _grown(obj: SeenObject, others: list[SeenObject], top: float) -> SeenObject:
    """The object with the upright box about itself and what is seen of others, as high as ``top``."""
    local = obj.local(np.concatenate([other.points for other in others]))
    seen, half = np.percentile(local, [1.0, 99.0], axis=0), 0.5 * obj.extents
    low, high = np.minimum(seen[0], -half), np.maximum(seen[1], half)
    low[2], high[2] = -half[2], top - obj.centre[2]
    return replace(boxed(obj, obj, low, high), kind=obj.kind)


def _slim(obj: SeenObject) -> bool:
    return obj.turn is None and bool(obj.spans[:2].max() < SLIM)


def _over(draft: SceneDraft, j: int, k: int) -> bool:
    """Whether the object ``j`` stands, through others or not, on ``k``."""
    for _ in draft.objects:
        j = draft.carrier(j) if j >= 0 else j
        if j == k:
            return True
    return False


def _in_line(obj: SeenObject, other: SeenObject, share: float) -> bool:
    off = float(np.linalg.norm(obj.centre[:2] - other.centre[:2]))
    return off < share * float(min(other.spans[:2]))


def _is_end(piece: SeenObject, under: SeenObject) -> bool:
    """Whether the uppermost piece is one of its own: broader than the one under it, or away from all others."""
    return bool(piece.spans[:2].max() > 1.25 * under.spans[:2].max() or piece.lowest > under.top + 0.01)


def _vessel(obj: SeenObject) -> bool:
    if obj.kind not in ("box", "cylinder") or obj.turn is not None or obj.floating:
        return False
    tall = obj.extents[2] > max(0.05, TALL * min(obj.extents[:2]))
    return bool(tall and max(obj.extents[:2]) < 0.16)


def _line(draft: SceneDraft, k: int) -> list[int]:
    """What stands in line on a vessel and belongs to it, from the lowest up: pieces cut from it, narrower round ones,
    a head on a neck or over one that is not seen, and a cover.
    """
    vessel, line, under = draft.objects[k], [], k
    above = [j for j in draft.left() if j != k and _over(draft, j, k) and not draft.objects[j].noun]
    for j in sorted(above, key=lambda j: draft.objects[j].top):
        piece = draft.objects[j]
        own = piece.group == vessel.group and piece.group >= 0
        width, wide = piece.spans[:2], float(min(vessel.spans[:2]))
        narrow = piece.kind == "cylinder" and width.max() < 0.75 * wide
        foot = _as_seen(piece).bottom - draft.objects[under].top
        aloft = (piece.floating or foot > 2 * SEAM) and 0 < foot < HOVER and width.min() < 0.6 * wide
        neck = under != k and draft.objects[under].spans[:2].max() < 0.6 * wide
        head = (aloft and vessel.kind == "cylinder") or (neck and width.max() < 1.5 * max(vessel.spans[:2]))
        straight = _in_line(piece, vessel, AXIS)
        if straight and (own or narrow or head or _covers(draft, j, under)):
            line.append(j)
            under = j
        elif straight:
            break
    return line


def _covers(draft: SceneDraft, j: int, at: int) -> bool:
    """Whether a flat object of another colour lies on a round object and is about as wide."""
    if at < 0:
        return False
    piece, under = draft.objects[j], draft.objects[at]
    long, short = float(max(piece.spans[:2])), float(min(piece.spans[:2]))
    share = long / float(max(under.spans[:2]))
    least = 0.25 if under.extents[2] > 2.0 * max(under.extents[:2]) else 0.7
    flat = _as_seen(piece).extents[2] < 0.6 * long and long < LONG * short
    lies = under.kind == "cylinder" and abs(piece.bottom - under.top) < 0.008
    other = share > 1.05 or not alike(draft.looks[j], draft.looks[at])
    return bool(flat and lies and least < share < 1.8 and other)


def _is_grip(obj: SeenObject) -> bool:
    return obj.kind == "box" and _slim(obj) and bool(obj.extents[2] > 2.2 * max(obj.extents[:2]))
