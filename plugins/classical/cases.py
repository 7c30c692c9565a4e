"""Cases: boxes with lids, cabinets with drawers and their handles, towers that something sticks out of."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gvla2.geometry.transform import FloatArray
from gvla2_plugins.classical.clusters import alike
from gvla2_plugins.classical.composites import Draft
from gvla2_plugins.classical.things import THIN, Thing, upright_rectangle

VENEER = 0.03  # metres: what is seen of a lid is no higher
PANEL = 0.012  # metres: a side of a case that is seen alone looks no thicker
BESIDE = 0.025  # metres that a lid may stand over its box
FLUSH = 0.012  # metres between a drawer's front and the side of its cabinet
REACH = 0.08  # metres that a handle stands off
COVERED = 0.3  # of a side of a cabinet: a drawer's front is no smaller
DEEP = 0.8  # of a handle's length: it stands off by less
BAR = 0.02  # metres: a handle is no thicker, and twice as long
HINGED = 0.05  # metres between a box's edge and the lower edge of its open lid


def join_boxes(draft: Draft) -> None:
    """Sides under a flat top of another colour are a box that the top closes: its lid."""
    for k in draft.left():
        top = draft.things[k]
        if draft.now(k) != k or not _could_be_lid(top):
            continue
        sides = [
            j
            for j in draft.left()
            if j != k and _side_under(draft.things[j], top) and not alike(draft.looks[j], draft.looks[k])
        ]
        large = [j for j in sides if draft.things[j].extents[2] > 0.6 * top.lowest]
        if not large:
            continue
        main = max(large, key=lambda j: len(draft.things[j].members))
        points = np.concatenate([draft.things[j].points for j in sides])
        body = _body_under(draft.things[main], top, points)
        draft.take_in(main, [j for j in sides if j != main])
        draft.change(main, replace(body, points=draft.things[main].points))
        lid = top.resting_at(min(body.top, top.top - THIN))
        draft.change(k, replace(lid, noun="lid", on=main, part_of=main))


def name_open_lids(draft: Draft) -> None:
    """A leaning plate whose lower edge is along the upper edge of an open box is that box's lid."""
    for k in draft.left():
        plate = draft.things[k]
        if plate.turn is None or plate.noun:
            continue
        level, rising = plate.turn[:, 0], plate.turn[:, 1]
        foot = plate.centre - 0.5 * plate.extents[1] * rising
        for j in draft.left():
            box = draft.things[j]
            if j == k or not box.hollow or box.kind != "box" or abs(foot[2] - box.top) > HINGED:
                continue
            local = box.local(foot[None])[0]
            along = np.abs(box.pose[:3, :2].T @ level)
            side = int(np.argmax(along))
            off = abs(abs(local[1 - side]) - 0.5 * box.extents[1 - side])
            length = float(plate.extents[0] / box.extents[side])
            if along[side] > 0.95 and off < HINGED and abs(local[side]) < 0.05 and 0.7 < length < 1.3:
                draft.change(k, replace(plate, noun="lid", part_of=j, on=j))
                draft.change(j, replace(box, noun="open box"))
                break


def join_drawers(draft: Draft) -> None:
    """A panel of another colour flush with a side of a large box is its drawer; what stands off it is a handle."""
    for k in draft.left():
        case = draft.things[k]
        if draft.now(k) != k or case.kind != "box" or case.noun or case.turn is not None or case.hollow:
            continue
        if min(case.extents) < 0.08:
            continue
        for axis, sign in ((0, 1.0), (0, -1.0), (1, 1.0), (1, -1.0)):
            panels = [
                j
                for j in draft.left()
                if j != k
                and not alike(draft.looks[j], draft.looks[k])
                and _panel_on(draft.things[j], case, axis, sign)
            ]
            seen = [draft.things[j].points for j in panels]
            large = panels if seen and _covered(np.concatenate(seen), case, axis) > COVERED else []
            handles = [
                j
                for j in draft.left()
                if j not in (k, *panels) and _stands_off(draft.things[j], case, axis, sign)
            ]
            if not large and not handles:
                continue
            owner = k
            if large:
                owner = max(large, key=lambda j: len(draft.things[j].members))
                draft.take_in(owner, [j for j in panels if j != owner])
                front = _front(draft.things[owner], case, axis, sign)
                draft.change(owner, replace(front, noun="drawer", part_of=k, on=-1))
                draft.change(k, replace(case, noun="cabinet"))
            elif len(handles) > 1:
                continue
            if handles:
                # Scraps of it, in other light, would only blur where it is.
                best = max(handles, key=lambda j: len(draft.things[j].members))
                draft.take_in(owner, [j for j in handles if j != best])
                draft.change(
                    best, replace(_bar(draft.things[best], case), noun="handle", part_of=owner, on=-1)
                )
                if owner == k:
                    draft.change(k, replace(case, noun="drawer cabinet"))
            break


def name_towers(draft: Draft) -> None:
    """A block from whose side another sticks out in the air is a tower of blocks."""
    for k in draft.left():
        tower = draft.things[k]
        if tower.noun or tower.hollow or tower.kind not in ("box", "other") or min(tower.extents) < 0.08:
            continue
        for j in draft.left():
            brick = draft.things[j]
            if j == k or brick.noun or brick.turn is not None or not brick.floating or brick.top > tower.top:
                continue
            local = np.abs(tower.local(brick.centre[None])[0])
            gap = local[:2] - 0.5 * tower.extents[:2] - 0.5 * float(min(brick.extents[:2]))
            if gap.max() < 0.02 and gap.max() > -0.5 * min(brick.extents[:2]) and gap.min() < -0.02:
                draft.change(k, replace(tower, noun="tower"))
                draft.change(j, replace(brick, noun="brick", on=-1))
                break


def _could_be_lid(top: Thing) -> bool:
    flat = top.turn is None and not top.noun and not top.hollow and top.kind == "box" and not top.floating
    return bool(flat and top.top > 0.05 and top.top - top.lowest < VENEER and min(top.extents[:2]) > 0.08)


def _side_under(side: Thing, top: Thing) -> bool:
    """Whether a piece is under a flat top, and within its outline."""
    if side.turn is not None or side.hollow or side.noun or side.top > top.lowest + 0.01:
        return False
    return bool(top.covers(side.points[:, :2], BESIDE).mean() > 0.9)


def _body_under(main: Thing, top: Thing, points: FloatArray) -> Thing:
    """The box under a lid: its sides where they were seen, the lid's edge elsewhere."""
    local = top.local(points)[:, :2]
    half = 0.5 * top.extents[:2]
    edges = np.array([[-half[0], half[0]], [-half[1], half[1]]])
    for axis in (0, 1):
        for end, sign in enumerate((-1.0, 1.0)):
            near = local[sign * local[:, axis] > half[axis] - BESIDE - PANEL]
            spread = np.ptp(near[:, 1 - axis]) if len(near) > 30 else 0.0
            if spread > 0.3 * top.extents[1 - axis]:
                edges[axis, end] = sign * float(np.percentile(sign * near[:, axis], 85.0))
    lengths, shift = edges[:, 1] - edges[:, 0], edges.mean(axis=1)
    c, s = np.cos(top.yaw), np.sin(top.yaw)
    middle = top.centre[:2] + np.array([[c, -s], [s, c]]) @ shift
    yaw, width, depth = upright_rectangle(top.yaw, float(lengths[0]), float(lengths[1]))
    height = max(THIN, min(float(np.percentile(points[:, 2], 99.5)), top.top - THIN))
    centre = np.array([*middle, 0.5 * height])
    extents = np.array([width, depth, height])
    return replace(main, kind="box", centre=centre, yaw=yaw, extents=extents, noun="box", on=-1)


def _panel_on(panel: Thing, case: Thing, axis: int, sign: float) -> bool:
    """Whether a thin upright piece lies in a side of a box."""
    if panel.turn is not None or panel.hollow or panel.noun:
        return False
    local = case.local(panel.points)
    off = sign * local[:, axis] - 0.5 * case.extents[axis]
    other = np.abs(local[:, 1 - axis]) < 0.5 * case.extents[1 - axis] + 0.01
    height = np.abs(local[:, 2]) < 0.5 * case.extents[2] + 0.005
    return bool(((np.abs(off) < FLUSH) & other & height).mean() > 0.8)


def _covered(points: FloatArray, case: Thing, axis: int) -> float:
    """The share of a side of the box that points (N, 3) span."""
    local = case.local(points)
    low, high = np.percentile(local[:, [1 - axis, 2]], [1.0, 99.0], axis=0)
    return float((high - low).prod() / (case.extents[1 - axis] * case.extents[2]))


def _stands_off(piece: Thing, case: Thing, axis: int, sign: float) -> bool:
    """Whether a small piece is in the air before a side of a box."""
    if not piece.floating or piece.turn is not None or piece.noun:
        return False
    local = case.local(piece.points)
    low, high = np.percentile(local[:, [1 - axis, 2]], [1.0, 99.0], axis=0)
    breadth = high - low
    if breadth.min() > BAR or breadth.max() < 2.0 * breadth.min():
        return False
    off = sign * local[:, axis] - 0.5 * case.extents[axis]
    if np.ptp(np.percentile(off, [1.0, 99.0])) > DEEP * breadth.max():
        return False  # what reaches out as far as it is long is stuck in the box
    within = (np.abs(local[:, [1 - axis, 2]]) < 0.5 * case.extents[[1 - axis, 2]]).all(axis=1)
    return bool((within & (off > -0.005) & (off < REACH)).mean() > 0.9)


def _front(panel: Thing, case: Thing, axis: int, sign: float) -> Thing:
    """The panel as a thin box in the case's own axes, where its points are."""
    local = case.local(panel.points)
    low, high = np.percentile(local, [1.0, 99.0], axis=0)
    face = float(np.median(sign * local[:, axis]))
    low[axis], high[axis] = sorted((sign * face, sign * (face - PANEL)))
    return _box_along(panel, case, low, high)


def _bar(handle: Thing, case: Thing) -> Thing:
    """The handle as a box in the case's own axes, about its points."""
    low, high = np.percentile(case.local(handle.points), [0.5, 99.5], axis=0)
    return _box_along(handle, case, low, high)


def _box_along(thing: Thing, case: Thing, low: FloatArray, high: FloatArray) -> Thing:
    pose = case.pose
    centre = pose[:3, :3] @ (0.5 * (low + high)) + pose[:3, 3]
    lengths = np.maximum(high - low, THIN)
    yaw, width, depth = upright_rectangle(case.yaw, float(lengths[0]), float(lengths[1]))
    extents = np.array([width, depth, lengths[2]])
    return replace(thing, kind="box", centre=centre, yaw=yaw, extents=extents)
