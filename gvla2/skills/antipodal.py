"""Antipodal grasps of objects of any shape, from their surface points.

For each approach direction the surface is cut into slabs of a finger's breadth. In a slab, the points that could touch
the fingers form intervals along the closing direction. An interval that is narrow enough, with wide enough gaps on both
sides, can be grasped: a whole body, a rim, a handle, a tool flat on the table. A grasp scores higher the better both
surfaces face the fingers (antipodal: Nguyen 1988) and the closer it is to the object's middle, where the object does
not turn in the hand.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from gvla2.geometry.transform import FloatArray, transform_points
from gvla2.planning.arm import Hand
from gvla2.planning.scene import SceneObject
from gvla2.planning.skill import TABLE_GAP
from gvla2.planning.trajectory import grasp_rotation
from gvla2.skills.parameters import PALM_GAP
from gvla2.skills.proposals import Grasp, horizontal

FEWEST, MOST = 60, 4000
"""The fewest surface points that define a shape, and the most that are used."""

SPACING = 0.005
"""Distance between points sampled on a scan, metres: with a larger one, fingertips would miss edges."""

NEIGHBOURS = 12
"""Points from which a normal is estimated."""

AROUND, AT_EDGE = 0.008, 0.25
"""A point is on the outline, seen from above, if the mean of the points within the first (metres) is farther from it
than the second (a share of the first): 0.42 on a straight edge."""

PLAY, ROOM, BESIDE = 0.003, 0.012, 0.003
"""Metres a side: an open finger's least distance from what it grasps, its distance if there is room, and its least
distance from other parts of the object."""

PAD = 0.018
"""Height of the fingers' pads, metres."""

DEPTHS = (0.012, 0.022, 0.034, 0.045)
"""How far the fingertips reach beyond the surface point nearest to the hand, metres."""

STEP, STEPS = 0.012, 11
"""Distance between slabs, metres, and the largest number of them."""

SHALLOWEST = 0.006
"""Least reach of the fingertips over an object, metres."""

OVER = 0.35
"""How far the hand leans along its closing direction, radians; its palm is broad and meets the table soon."""

WHENCE = {
    "top": "from above",
    "leaning": "from above, leaning",
    "side": "from the side",
    "sloping": "from above, leaning outward",
    "outward": "from above, leaning far outward",
}
FAMILIES = {"top": 0.0, "leaning": 0.08, "side": 0.2}
"""Deduction from the preference for each family of approaches."""

COMMON = 0.008
"""The pads should touch both sides over a common height of this much, metres; otherwise the object tips."""

ASIDE = 0.004
"""Largest distance between the contact and the middle of the pads, metres: a contact at the pads' edges, such as the
corner of a box or the rim of a can too wide for the hand, is squeezed out."""

KEPT = {"top": 8, "leaning": 4, "side": 4}
"""Number of grasps of each family that are passed on."""

NEAR, TURN = 0.010, 0.3
"""Grasps closer than this (metres, radians) to a better one are dropped."""


@dataclass(frozen=True)
class Skin:
    """Points (N, 3) of a surface in the world, metres; ``known`` are their normals (N, 3) if they come from a scan.

    ``foot`` is the height of the object's lower end, metres.
    """

    points: FloatArray
    known: FloatArray | None = None
    foot: float = -np.inf

    @cached_property
    def normals(self) -> FloatArray:
        """(N, 3) unit normals of either sign: the scan's, or estimated from each point's neighbours.

        An object lower than the pads touches them with its edge. Cameras see next to nothing of so low a side, so the
        normals on its outline, seen from above, are used.
        """
        normals = self._around() if self.known is None else self.known.copy()
        outward, top = _seen_from_above(self.points)
        length = np.linalg.norm(outward, axis=1)
        edge = (top - self.foot < PAD) & (length > AT_EDGE * AROUND)
        normals[edge] = np.column_stack([outward[edge] / length[edge, None], np.zeros(edge.sum())])
        return normals

    def _around(self) -> FloatArray:
        _, near = cKDTree(self.points).query(self.points, min(NEIGHBOURS, len(self.points)))
        around = self.points[near] - self.points[near].mean(axis=1, keepdims=True)  # (N, K, 3)
        _, axes = np.linalg.eigh(np.einsum("nki,nkj->nij", around, around))
        return np.asarray(axes[:, :, 0])


def skin_of(obj: SceneObject) -> Skin | None:
    """The object's surface, from its scan if it has one, else from its seen points; None if there are too few."""
    if obj.known is not None:
        whole = _skin_of_scan(obj.known.path, obj.known.scale)
        pose = obj.known.world_from_scan
        normals = whole.normals @ pose[:3, :3].T
        return Skin(transform_points(pose, whole.points), normals, foot=obj.bottom)
    points = obj.points[np.isfinite(obj.points).all(axis=1)]
    if len(points) < FEWEST:
        return None
    if len(points) > MOST:
        points = points[np.random.default_rng(0).choice(len(points), MOST, replace=False)]
    return Skin(points, foot=obj.bottom)


def _seen_from_above(points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """For each point (N, 3): its offset from the mean of its neighbours, (N, 2), and their greatest height, (N,)."""
    spots, count = points[:, :2], len(points)
    pairs = cKDTree(spots).query_pairs(AROUND, output_type="ndarray")
    one, other = np.concatenate([pairs, pairs[:, ::-1], np.arange(count)[:, None].repeat(2, 1)]).T
    middle = np.stack([np.bincount(one, spots[other, k], count) for k in range(2)], axis=1)
    top = np.full(count, -np.inf)
    np.maximum.at(top, one, points[other, 2])
    return spots - middle / np.bincount(one, minlength=count)[:, None], top


@lru_cache(maxsize=64)
def _skin_of_scan(path: str, scale: float) -> Skin:
    """The scan's surface in its own frame, metres."""
    from gvla2.geometry.mesh_files import read_mesh  # few objects have a scan, and importing trimesh is slow

    mesh = read_mesh(path)
    count = int(np.clip(mesh.areas.sum() * scale**2 / SPACING**2, 1500, MOST))
    points, faces = mesh.sample(count, np.random.default_rng(0))
    return Skin(scale * points, mesh.normals[faces])


def antipodal(
    obj: SceneObject, hand: Hand, table: float, outward: FloatArray, facing: float = 0.7
) -> list[Grasp]:
    """The best grasps of an object on a table at height ``table``, metres, best first.

    ``outward`` (3,) points from the arm's foot to the object: the hand leans, and approaches from the side, that way.
    ``facing`` is the least cosine between surface normals and the closing direction.
    """
    skin = skin_of(obj)
    if skin is None:
        return []
    found: list[Grasp] = []
    yaw = float(np.arctan2(obj.world_from_object[1, 0], obj.world_from_object[0, 0]))
    for family, rotation in _ways(outward, yaw):
        found += _by_slabs(skin, family, rotation, hand, table, facing)
    return _apart(sorted(found, key=lambda g: -g.preference))


def held_between(skin: Skin, rotation: FloatArray, centre: FloatArray, opening: float, hand: Hand) -> bool:
    """Whether a hand at this pose, ``opening`` metres wide, has points between its pads and hardly any in the way."""
    local = (skin.points - centre) @ rotation
    slab = np.abs(local[:, 0]) < 0.5 * hand.finger_breadth
    off = np.abs(local[:, 1])
    pad = (local[:, 2] > hand.tip_beyond_tcp - PAD) & (local[:, 2] < hand.tip_beyond_tcp)
    column = slab & (local[:, 2] < hand.tip_beyond_tcp)
    struck = column & (off > 0.5 * opening) & (off < 0.5 * opening + hand.finger_thickness)
    return bool((slab & pad & (off < 0.5 * opening)).any() and struck.sum() <= 0.002 * len(off))


def _ways(outward: FloatArray, yaw: float) -> Iterator[tuple[str, FloatArray]]:
    """Families and rotations (3, 3) of the hand, among them those aligned with the object's own axes at ``yaw``."""
    down = np.array([0.0, 0.0, -1.0])
    for k in range(12):
        yield "top", grasp_rotation(down, horizontal(yaw + np.pi * k / 12))
    away = float(np.arctan2(outward[1], outward[0]))
    for k in range(6):
        closing = horizontal(yaw + np.pi * k / 6)
        beside = np.array([-closing[1], closing[0], 0.0])
        beside = beside if beside @ outward >= 0 else -beside
        yield "leaning", grasp_rotation(np.cos(0.4) * down + np.sin(0.4) * beside, closing)
    for k in range(12):  # leaning along the closing direction, for sloping rims
        over = horizontal(yaw + np.pi * k / 6)
        yield "leaning", grasp_rotation(np.cos(OVER) * down + np.sin(OVER) * over, over)
    for turn in (0.0, 0.5, -0.5, 1.0, -1.0):
        for tilt in (0.9, 1.3):
            ahead = horizontal(away + turn)
            approach = np.cos(tilt) * down + np.sin(tilt) * ahead
            yield "side", grasp_rotation(approach, horizontal(away + turn + 0.5 * np.pi))


def _by_slabs(
    skin: Skin, family: str, rotation: FloatArray, hand: Hand, table: float, least: float
) -> Iterator[Grasp]:
    middle = skin.points.mean(axis=0)
    local = (skin.points - middle) @ rotation
    _, closing, approach = rotation.T
    yaw = np.arctan2(closing[1], closing[0])
    facing = np.abs(skin.normals @ rotation[:, 1])
    low, high = np.quantile(local[:, 0], (0.02, 0.98))
    count = int(np.clip(np.ceil((high - low) / STEP), 1, STEPS))
    first = float(local[:, 2].min())
    for x in np.linspace(low, high, count + 2)[1:-1]:
        aside = np.abs(local[:, 0] - x)
        slab = aside < 0.5 * hand.finger_breadth + 0.002
        if slab.sum() < 6:
            continue
        inside, faced = local[slab], facing[slab]
        nearest = float(np.quantile(inside[:, 2], 0.01))
        under_palm = float(local[aside < 0.5 * hand.palm_depth, 2].min())
        deepest = under_palm + hand.finger_length - PALM_GAP
        for reach in DEPTHS:
            tips = min(nearest + reach, deepest)
            for stretch in _stretches(inside - [x, 0.0, 0.0], faced, tips, hand, least):
                y, width, opening, face, common = stretch
                lowest = _tips_by_table(rotation, middle, x, y, opening, hand, table)
                end = min(tips, lowest)
                if end < nearest + SHALLOWEST or end < tips - 0.02:
                    continue
                at = np.array([x, y, end - hand.tip_beyond_tcp])
                centre = middle + rotation @ at
                aslant = float(np.hypot(x, y)) if family == "top" else float(np.linalg.norm(at[:2]))
                preference = (
                    0.9
                    - 0.2 * width / hand.max_width
                    - 0.4 * (1.0 - face)
                    - 0.3 * (1.0 - min(1.0, common / COMMON))
                    - min(0.4, 2.0 * aslant)
                    - 1.5 * max(0.0, 0.020 - (end - nearest))
                    - FAMILIES[family]
                )
                part = f"{1000 * width:.0f} mm of its surface, {1000 * x:.0f} mm aside, yaw {np.degrees(yaw):.0f}°"
                how, share = f"grasp {WHENCE[family]}, {part}", min(1.0, opening / hand.max_width)
                yield Grasp(how, family, closing, approach, centre, share, preference, end - first, width)
            if tips == deepest:
                break


def _stretches(
    slab: FloatArray, facing: FloatArray, tips: float, hand: Hand, least: float
) -> Iterator[tuple[float, float, float, float, float]]:
    """Middle, width, opening, facing and common height of both sides, for each interval that can be grasped with the
    fingertips at ``tips`` along the approach.

    ``slab`` (N, 3) are points in the hand's frame, the pads' middle at x = 0, and ``facing`` (N,) the cosines between
    their normals and the closing direction.
    """
    across, along, height = slab.T
    taken, at_pads = height < tips, height > tips - PAD
    order = np.flatnonzero(taken)[np.argsort(along[taken])]
    if len(order) < 6:
        return
    values = along[order]
    cuts = np.flatnonzero(np.diff(values) > hand.finger_thickness + 2 * BESIDE)
    starts, stops = np.concatenate([[0], cuts + 1]), np.concatenate([cuts, [len(values) - 1]])
    for k, (start, stop) in enumerate(zip(starts, stops, strict=True)):
        low, high = float(values[start]), float(values[stop])
        width = high - low
        before = low - float(values[stops[k - 1]]) if k else np.inf
        after = float(values[starts[k + 1]]) - high if k + 1 < len(starts) else np.inf
        room = min(before, after) - hand.finger_thickness - BESIDE
        spare = min(ROOM, room, 0.5 * (hand.max_width - width))
        if spare < PLAY or stop - start < 4:
            continue
        members = order[start : stop + 1]
        members = members[at_pads[members]]
        if len(members) < 4:
            continue
        there = along[members]
        # The surfaces on both sides that the fingers will press on.
        edge = 0.004
        left, right = there < there.min() + edge, there > there.max() - edge
        sides = (members[left], members[right])
        face = min(float(facing[side].mean()) for side in sides)
        if face < least:
            continue
        (low_at, high_at), (left_at, right_at) = _shared(height, sides), _shared(across, sides)
        if left_at < ASIDE and right_at > -ASIDE:
            yield 0.5 * (low + high), width, width + 2 * spare, face, max(0.0, high_at - low_at)


def _shared(values: FloatArray, sides: tuple[FloatArray, FloatArray]) -> tuple[float, float]:
    """The interval in which both sides have values, without a tenth at either end of each."""
    one, other = (np.sort(values[side]) for side in sides)  # np.quantile is ten times as slow
    tenths = [(len(ordered) - 1) // 10 for ordered in (one, other)]
    low = max(one[tenths[0]], other[tenths[1]])
    return float(low), float(min(one[-1 - tenths[0]], other[-1 - tenths[1]]))


def _tips_by_table(
    rotation: FloatArray, middle: FloatArray, x: float, y: float, opening: float, hand: Hand, table: float
) -> float:
    """The fingertips' greatest distance from the middle along the approach, with fingers and palm above the table."""
    reach = 0.5 * opening + hand.finger_thickness
    fingers = (0.5 * hand.finger_breadth, reach, 0.0, TABLE_GAP)
    palm = (0.5 * hand.palm_depth, 0.5 * hand.palm_breadth, -hand.finger_length, 2 * TABLE_GAP)
    down = -float(rotation[2, 2])
    if down < 1e-6:
        return np.inf
    limits = []
    for breadth, depth, behind, gap in (fingers, palm):
        lowest = middle[2] + rotation[2, 0] * x + rotation[2, 1] * y
        lowest -= abs(rotation[2, 0]) * breadth + abs(rotation[2, 1]) * depth
        limits.append((lowest - table - gap) / down - behind)
    return float(min(limits))


def _apart(found: list[Grasp]) -> list[Grasp]:
    """The best grasps of each family, without near duplicates."""
    kept: list[Grasp] = []
    for grasp in found:
        if sum(g.family == grasp.family for g in kept) == KEPT[grasp.family]:
            continue
        alike = any(
            grasp.family == other.family
            and np.linalg.norm(grasp.centre - other.centre) < NEAR
            and Rotation.from_matrix(grasp.rotation.T @ other.rotation).magnitude() < TURN
            for other in kept
        )
        if not alike:
            kept.append(grasp)
    return kept
