"""From the points of one object to a solid: which of box, cylinder and sphere explains it, and how well.

Beside its points the views show where an object ends, free space under and behind it, and its opening.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation, binary_erosion, binary_fill_holes, label

from gvla2.geometry.transform import FloatArray
from gvla2_plugins.classical.footprints import flat_object
from gvla2_plugins.classical.pixels import IntArray, Pixels, TableFrame, seen_through
from gvla2_plugins.classical.solids import (
    THIN,
    Distance,
    Kind,
    SeenObject,
    SolidFit,
    box_distance,
    cylinder_distance,
    evenly,
    fit_solid,
    narrow_yaw,
    solid,
    sphere_distance,
    spread_out,
    upright_rectangle,
)

MOST_FREE, MOST_RAYS = 150, 40  # free points and outermost rays that are kept of one view
BEFORE = 0.006  # metres in front of a measured surface where a ray is certainly free
ALONG = np.linspace(-0.006, 0.010, 9)  # metres about a measured depth, along the ray
FLAT = 0.03  # metres: a ring is no higher
NARROWEST = 0.008  # metres: a smaller hole is no hole that is seen
HOLE_CELL, PADDING = 0.003, 2  # metres: side of the cells in which a hole is looked for; cells around it
ROUND_HOLE = 0.87  # of the rectangle about it: a hole that fills less is round
THICK, FLOOR = 0.016, 0.02  # metres: no wall and no floor is thicker
STRAY = 0.05  # share of the points that need not be where they should
FEWEST = 20  # points that determine where a wall is


def silhouette(
    frames: Sequence[TableFrame], pixels: Pixels, members: IntArray, low: FloatArray, high: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Evidence of the outline: points (M, 3) within ``low``, ``high`` (3,) that are free, since rays just beside the
    object passed them before they hit anything; and points (R, S, 3) along the outermost rays that hit it.
    """
    free, rim = [np.zeros((0, 3))], [np.zeros((0, len(ALONG), 3))]
    reach = 0.5 * float(np.linalg.norm(high - low)) + 0.01
    middle = 0.5 * (low + high)
    for number, frame in enumerate(frames):
        mine = members[pixels.view[members] == number]
        if len(mine) == 0:
            continue
        rows, columns = pixels.row[mine], pixels.column[mine]
        r0, c0 = max(0, rows.min() - 3), max(0, columns.min() - 3)
        window = (slice(r0, rows.max() + 4), slice(c0, columns.max() + 4))
        depth = frame.depth[window]
        mask = np.zeros(depth.shape, dtype=bool)
        mask[rows - r0, columns - c0] = True
        # Through an opening one sees the inside, not what is beside the object.
        outer = binary_fill_holes(mask)
        ring = binary_dilation(outer, iterations=2) & ~outer & np.isfinite(depth)
        rays, limit = frame.rays[window][ring], depth[ring] - BEFORE  # (R, 3), (R,)
        length = np.linalg.norm(rays, axis=1)
        steps = (((middle - frame.origin) @ rays.T) / length**2)[:, None]
        steps = steps + np.linspace(-1, 1, 14) * (reach / length)[:, None]
        samples = (frame.origin + rays[:, None] * steps[..., None])[steps < limit[:, None]]
        free.append(evenly(samples[((samples > low) & (samples < high)).all(axis=1)], MOST_FREE))
        edge = mask & ~binary_erosion(outer)
        along = depth[edge][:, None] + ALONG
        rim.append(evenly(frame.origin + frame.rays[window][edge][:, None] * along[..., None], MOST_RAYS))
    return np.concatenate(free), np.concatenate(rim)


def hangs(frames: Sequence[TableFrame], points: FloatArray, lowest: float, gap: float) -> bool:
    """Whether cameras looked through the space between the object and the table, near the table.

    Most cameras look down, past the object's own edges: a few rays through count more than many that it hides.
    """
    if lowest < gap:
        return False
    xy = evenly(points[:, :2], 60)
    heights = np.linspace(0.2, 0.6, 3) * lowest
    columns = np.concatenate([np.column_stack([xy, np.full(len(xy), z)]) for z in heights])
    return bool(seen_through(frames, columns).mean() > 0.1)


def sees_into(frames: Sequence[TableFrame], obj: SeenObject, share: float = 0.4) -> bool:
    """Whether cameras look through a ``share`` of the solid's upper half, inside its walls: a cup, a box, a tray."""
    if obj.kind == "sphere" or obj.extents[2] < 0.025 or min(obj.extents[:2]) < 0.04:
        return False
    across = np.linspace(-0.28, 0.28, 5)
    inside = obj.grid(across, across, np.linspace(0.05, 0.3, 3))
    return bool(seen_through(frames, inside).mean() > share)


def opened(frames: Sequence[TableFrame], obj: SeenObject) -> SeenObject:
    """The object with its ``opening``, and as a ring where it is flat and one sees the table through it."""
    if obj.hollow:
        return replace(obj, opening=_between_walls(obj))
    if obj.kind == "sphere" or obj.turn is not None or obj.floating:
        return obj
    width = float(min(obj.extents[:2]))
    if obj.extents[2] > min(FLAT, 0.6 * width) or width > 0.2:
        return obj
    ring = _ring(frames, obj)
    return obj if ring is None else ring


def _between_walls(obj: SeenObject) -> float:
    """The outer width less both walls: the points furthest inside near the top are on the inner wall."""
    local = obj.local(obj.points)
    upper = local[(local[:, 2] > 0.1 * obj.extents[2]) & (local[:, 2] < 0.42 * obj.extents[2])]
    width = float(min(obj.extents[:2]))
    if obj.kind == "cylinder":
        depth = 0.5 * width - np.hypot(upper[:, 0], upper[:, 1])
    else:
        depth = (0.5 * obj.extents[:2] - np.abs(upper[:, :2])).min(axis=1)
    depth = depth[(depth > 0) & (depth < 0.2 * width)]
    wall = float(np.percentile(depth, 90.0)) if len(depth) >= FEWEST else 0.0
    return max(0.0, width - 2.0 * wall)


def _ring(frames: Sequence[TableFrame], obj: SeenObject) -> SeenObject | None:
    """A flat object with the largest hole in it that rays pass through, as a ring about that hole; None without one.

    Its box has the hole's middle, also where a handle stands out on one side of it, and the turn of the hole's sides.
    """
    spots = _cells(obj)
    rim = obj.local(obj.points)
    rim = rim[rim[:, 2] > 0.5 * obj.extents[2] - 0.003, :2]
    if len(rim) < FEWEST:
        return None
    cells = np.floor((rim + 0.5 * obj.extents[:2]) / HOLE_CELL).astype(int) + PADDING
    seen = np.zeros(spots.shape[:2], dtype=bool)
    seen[tuple(np.clip(cells, 0, np.array(seen.shape) - 1).T)] = True
    seen = binary_dilation(seen)
    holes, count = label(binary_fill_holes(seen) & ~seen)
    if not count:
        return None
    largest = spots[holes == 1 + int(np.argmax(np.bincount(holes.ravel())[1:]))]  # (N, 2)
    local = np.column_stack([largest, np.full(len(largest), 0.5 * obj.extents[2])])
    at = obj.centre + local @ obj.pose[:3, :3].T
    yaw, middle, sides = narrow_yaw(at[:, :2], trim=0.0)
    if seen_through(frames, at, margin=0.5 * obj.extents[2]).mean() < 0.6:
        return None
    off = obj.points[:, :2] - middle
    away = np.linalg.norm(off, axis=1)
    square = len(largest) * HOLE_CELL**2 > ROUND_HOLE * float((sides + HOLE_CELL).prod())
    if not square:  # turned as what stands out
        along = off[away >= np.quantile(away, 0.98)].mean(axis=0)
        yaw = float(np.arctan2(along[1], along[0]))
    c, s = np.cos(yaw), np.sin(yaw)
    inner = np.abs(off @ np.array([[c, -s], [s, c]]))
    hole = 2.0 * float(np.percentile(inner.max(axis=1) if square else away, 2.0))
    if hole < NARROWEST:
        return None
    yaw, width, depth = upright_rectangle(yaw, *(2.0 * np.percentile(inner, 99.5, axis=0)))
    centre, extents = np.array([*middle, obj.centre[2]]), np.array([width, depth, obj.extents[2]])
    return replace(obj, centre=centre, yaw=yaw, extents=extents, opening=hole, noun="ring")


def _cells(obj: SeenObject) -> FloatArray:
    """(R, C, 2) middles of the cells of a grid over an object's footprint, in its own frame."""
    counts = np.ceil(obj.extents[:2] / HOLE_CELL).astype(int) + 2 * PADDING
    rows, columns = (HOLE_CELL * (np.arange(n) + 0.5 - PADDING) for n in counts)
    return np.stack(np.meshgrid(rows, columns, indexing="ij"), axis=-1) - 0.5 * obj.extents[:2]


def within_walls(obj: SeenObject, points: FloatArray, wall: float = THICK) -> NDArray[np.bool_]:
    """(N,) bool: points (N, 3) in an object's hollow, away from its walls, ``wall`` metres thick, and its floor."""
    local = obj.local(points)
    high = local[:, 2] > FLOOR - 0.5 * obj.extents[2]
    if obj.kind == "cylinder":
        return np.asarray(high & (np.hypot(local[:, 0], local[:, 1]) < 0.5 * obj.extents[0] - wall))
    return np.asarray(high & (np.abs(local[:, :2]) < 0.5 * obj.extents[:2] - wall).all(axis=1))


def crowded(obj: SeenObject) -> bool:
    """Whether points of an object were seen in its middle, where a hollow one has none."""
    local = np.abs(obj.local(obj.points)[:, :2]) / obj.extents[:2]
    high = obj.points[:, 2] > obj.bottom + 0.3 * obj.extents[2]
    return bool((high & (local < 0.25).all(axis=1)).mean() > STRAY)


def on_walls(obj: SeenObject) -> bool:
    """Whether what is seen of an object is its walls and its floor."""
    return bool(within_walls(obj, obj.points).mean() < 2 * STRAY)


GOOD = 0.82  # agreement from which one solid explains an object
MOST_SEEN = 420  # points a fit looks at
MARGIN = 0.012  # metres about an object's points where its outline is looked at
ROUND = 1.12  # a round solid, which has fewer parameters, is taken up to this factor of a box's cost
INTRUDED = 0.08  # share of free points within a solid from which it is the wrong solid, not a hollow one
CLEARLY = 0.1  # more of agreement
RIM = 0.006  # metres: a wall is no thinner
SQUARE = 1.35  # length over breadth of what may be round
UPRIGHT = 0.5  # of the length of what is seen: an object that is lower shows its top, and so its outline
SHEET = 0.008  # metres: what is no higher is fitted by its outline
WIDE, EDGE = 0.1, 0.025  # metres: least width of what is taken for walls, and how thick these are at most
RIM_BINS, RIM_SEEN = 20, 0.7  # intervals of a side, and the share of them in which its upper edge is seen
SEEN_PAST = 0.5  # share of the inside that cameras look through
ANYWHERE, LENGTH = (-10.0, 10.0), (0.5 * THIN, 3.0)
DISTANCES: dict[Kind, Distance] = {
    "box": box_distance,
    "cylinder": cylinder_distance,
    "sphere": sphere_distance,
}


@dataclass(frozen=True)
class FitEvidence:
    """The evidence for one object's fit, in the table's frame.

    ``seen`` (N, 3), ``free`` (M, 3), ``rays`` (R, S, 3) as in :func:`fit_solid`; heights of its ``lowest`` and
    ``highest`` points and of its ``bottom``, which is the table's unless it is ``floating``; the smallest rectangle
    about it: ``yaw``, ``middle`` (2,), ``lengths`` (2,).
    """

    seen: FloatArray
    free: FloatArray
    rays: FloatArray
    lowest: float
    highest: float
    bottom: float
    floating: bool
    yaw: float
    middle: FloatArray
    lengths: FloatArray

    def start(self, kind: Kind) -> FloatArray:
        """Parameters of the solid that fills the rectangle."""
        heights, width = (self.highest, self.bottom), float(self.lengths.mean())
        if kind == "sphere":
            return np.array([*self.middle, self.highest - 0.5 * width, width])
        if kind == "cylinder":
            return np.array([*self.middle, width, *heights])
        return np.array([*self.middle, self.yaw, *self.lengths, *heights])

    def fit(self, kind: Kind, start: FloatArray | None = None, *, filled: bool = False) -> SolidFit:
        """The solid ``kind``, from the parameters ``start`` if they are given."""
        start = self.start(kind) if start is None else start
        top = (self.highest - 0.012, self.highest + 0.006)
        bottom = (self.bottom - 0.01, self.bottom + 0.006)
        ranges = {
            "box": [ANYWHERE, ANYWHERE, ANYWHERE, LENGTH, LENGTH, top, bottom],
            "cylinder": [ANYWHERE, ANYWHERE, LENGTH, top, bottom],
            "sphere": [ANYWHERE, ANYWHERE, ANYWHERE, LENGTH],
        }[kind]
        hold = () if self.floating or kind == "sphere" else (-1,)
        low, high = zip(*ranges, strict=True)
        evidence = self.seen, self.free, self.rays
        return fit_solid(
            DISTANCES[kind], start, *evidence, hold=hold, limits=(low, high), filled=filled, slack=0.004
        )


def shape_object(frames: Sequence[TableFrame], pixels: Pixels, members: IntArray, gap: float) -> SeenObject:
    """The solid that explains the pixels ``members`` (N,) best, standing on the table unless it is seen to hang."""
    evidence = _gather(frames, pixels, members, gap)
    fits = _fits(evidence)
    top = float(fits["box"].parameters[5])
    if not evidence.floating and top < SHEET:
        # Free points beside it do not show the outline of one so flat: the table does.
        flat = flat_object(frames, pixels, members, [at < 0 for at in pixels.maps], max(top, THIN))
        return replace(flat, lowest=evidence.lowest)
    kind = min(fits, key=lambda name: fits[name].cost * (ROUND if name == "box" else 1.0))
    fit = fits[kind]
    obj = solid(kind, pixels, members, fit.parameters, fit.agreement)
    obj = replace(obj, floating=evidence.floating, lowest=evidence.lowest)
    if (hollow := _hollow(frames, evidence, obj, fit)) is not None:
        return hollow
    if fit.agreement >= GOOD and _within(evidence, obj):
        return obj
    # Four walls about something else; or no solid that we know, and the box about its points.
    yaw, middle, lengths = narrow_yaw(obj.points[:, :2], trim=0.5)
    lengths = np.maximum(lengths, THIN)
    other = obj.posed("other", [*middle, yaw, *lengths, evidence.highest, evidence.bottom])
    walled = other if evidence.floating else _walled(frames, other)
    bad = fit.agreement < 0.5 * GOOD or not _within(evidence, obj)
    return walled if bad or walled.hollow else obj


def _walled(frames: Sequence[TableFrame], obj: SeenObject) -> SeenObject:
    """The object as a hollow box, if its edge is a rim all around and one sees past most of its inside: a bin, also one
    with compartments, or with contents that rise above it.
    """
    local = obj.local(obj.points)
    short = float(min(obj.extents[:2]))
    near = np.abs(local[:, :2]) > 0.5 * obj.extents[:2] - EDGE  # (N, 2) at a side of each pair
    if short < WIDE or not near.any():
        return obj
    rim = float(np.percentile(local[near.any(axis=1), 2], 95.0))
    high, shares = local[:, 2] > rim - EDGE, []
    for axis, sign in ((0, 1), (0, -1), (1, 1), (1, -1)):
        side = high & near[:, axis] & (sign * local[:, axis] > 0)
        length = obj.extents[1 - axis]
        bins = np.floor((local[side, 1 - axis] / length + 0.5) * RIM_BINS).astype(int)
        shares.append(len(np.unique(np.clip(bins, 0, RIM_BINS - 1))) / RIM_BINS)
    top = obj.centre[2] + rim
    height = max(THIN, top - obj.bottom)
    walled = replace(
        obj,
        kind="box",
        hollow=True,
        centre=np.array([*obj.centre[:2], top - 0.5 * height]),
        extents=np.array([*obj.extents[:2], height]),
        agreement=1.0 - float(within_walls(obj, obj.points, EDGE).mean()),
    )
    across = np.linspace(-0.42, 0.42, 14)
    inside = walled.grid(across, across, np.array([0.0, 0.25]))
    open_ = height < short and seen_through(frames, inside).mean() > SEEN_PAST
    return walled if open_ and min(shares) > RIM_SEEN else obj


def _hollow(
    frames: Sequence[TableFrame], evidence: FitEvidence, obj: SeenObject, fit: SolidFit
) -> SeenObject | None:
    """The object as a hollow one, where one sees into it; None where one does not.

    The inner wall is seen too: only the outline shows where the outer one is. Where a view shows it in pieces, rays
    beside a piece pass through the hollow; they say nothing against the walls.
    """
    if fit.intrusion < INTRUDED and sees_into(frames, obj) and not crowded(obj):
        fit = evidence.fit(obj.kind, fit.parameters, filled=True)
        return replace(obj.posed(obj.kind, fit.parameters), agreement=fit.agreement, hollow=True)
    if evidence.floating or (fit.agreement >= GOOD and fit.intrusion < INTRUDED):
        return None
    square = evidence.lengths.max() < 1.25 * evidence.lengths.min()
    kinds: list[Kind] = ["cylinder", "box"] if square else ["box"]
    found: list[SeenObject] = []
    for kind in kinds:
        trial = obj.posed(kind, evidence.start(kind))
        if not sees_into(frames, trial, share=0.8) or crowded(trial):
            continue
        # Where a rim was lost, rays beside what is left of it pass through the hollow, close to its walls.
        outer = replace(evidence, free=evidence.free[~within_walls(trial, evidence.free, RIM)])
        fit = outer.fit(kind, filled=True)
        walls = replace(trial.posed(kind, fit.parameters), agreement=fit.agreement, hollow=True)
        if fit.agreement >= GOOD and on_walls(walls):
            found.append(walls)
    # A wider box explains round walls too: the one that is like the outside must be clearly worse.
    return max(found, key=lambda t: t.agreement + CLEARLY * (t.kind == obj.kind), default=None)


def _gather(frames: Sequence[TableFrame], pixels: Pixels, members: IntArray, gap: float) -> FitEvidence:
    points = pixels.points[members]
    lowest, highest = (float(v) for v in np.percentile(points[:, 2], [2.0, 98.0]))
    floating = hangs(frames, points, lowest, gap)
    bottom = lowest - THIN if floating else 0.0
    highest = max(highest, bottom + THIN)
    yaw, middle, lengths = narrow_yaw(evenly(points[:, :2], 500))
    low = np.array([*(points[:, :2].min(axis=0) - MARGIN), bottom - (MARGIN if floating else 0.0)])
    high = np.array([*(points[:, :2].max(axis=0) + MARGIN), highest + MARGIN])
    free, rays = silhouette(frames, pixels, members, low, high)
    seen = spread_out(points, MOST_SEEN)
    lengths = np.maximum(lengths, THIN)
    return FitEvidence(seen, free, rays, lowest, highest, bottom, floating, yaw, middle, lengths)


def _fits(evidence: FitEvidence) -> dict[Kind, SolidFit]:
    """The box, and the round solids where the box is square enough."""
    fits: dict[Kind, SolidFit] = {"box": evidence.fit("box")}
    width, depth, top, bottom = fits["box"].parameters[3:]
    short, long = sorted(evidence.lengths.tolist())
    if max(width, depth) < SQUARE * min(width, depth):
        fits["cylinder"] = evidence.fit("cylinder")
        if 0.6 < 2.0 * (top - bottom) / (long + short) < 1.5:
            fits["sphere"] = evidence.fit("sphere")
    elif long > SQUARE * short and top - bottom > UPRIGHT * long:
        # A round object that is seen from one side shows a strip as wide as it is; a low one shows its top.
        along = evidence.yaw + (0.0 if evidence.lengths[0] < evidence.lengths[1] else 0.5 * np.pi)
        behind = 0.5 * (long - short) * np.array([np.cos(along), np.sin(along)])
        circle = [long, evidence.highest, evidence.bottom]
        ends = [np.append(evidence.middle + sign * behind, circle) for sign in (1.0, -1.0)]
        fits["cylinder"] = min((evidence.fit("cylinder", end) for end in ends), key=lambda fit: fit.cost)
    return fits


def _within(evidence: FitEvidence, obj: SeenObject) -> bool:
    """Whether the fit stayed where the points are."""
    reach = 0.5 * evidence.lengths.max() + 0.03
    near = np.abs(obj.centre[:2] - evidence.middle) < reach
    return bool((obj.extents >= 0.5 * THIN).all() and near.all())
