"""From the points of one thing to a solid: which of box, cylinder and sphere explains it, and how well."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from gvla2_plugins.classical.frames import Frame, seen_through
from gvla2_plugins.classical.pixels import IntArray, Pixels
from gvla2_plugins.classical.solids import (
    Distance,
    Fit,
    box_distance,
    cylinder_distance,
    evenly,
    fit_solid,
    narrow_yaw,
    sphere_distance,
    spread_out,
)
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation, binary_erosion

from gvla2.geometry.transform import FloatArray, rigid

Kind = Literal["box", "cylinder", "sphere", "other"]

GOOD = 0.82  # agreement from which one solid explains a thing
MOST_SEEN = 420  # points a fit looks at
MOST_FREE, MOST_RAYS = 150, 40  # free points and outermost rays of one view
BEFORE = 0.006  # metres in front of a measured surface where a ray is certainly free
ALONG = np.linspace(-0.006, 0.010, 9)  # metres about a measured depth, along the ray
THIN = 2e-3
FACE = 0.008  # a seen thing thinner than this, upright, may be one face of something
ROUND = 1.12  # a round solid, which has fewer parameters, is taken up to this factor of a box's cost


@dataclass(frozen=True)
class Thing:
    """One solid on the table, in the table's frame (z = 0 is its top), metres.

    ``members`` (N,) its pixels in the list; ``points`` (N, 3); ``centre``, ``yaw``, ``extents`` its upright box;
    ``agreement`` in [0, 1] how well the solid explains the points; ``hollow``: one sees into it; ``floating``: free
    space was seen under it; ``lowest`` seen point; ``group`` names what it was one piece of before a split by
    height; ``on`` is the index of the thing that carries it, -1 for the table.
    """

    kind: Kind
    members: IntArray = field(repr=False)
    points: FloatArray = field(repr=False)
    centre: FloatArray
    yaw: float
    extents: FloatArray
    agreement: float
    hollow: bool = False
    floating: bool = False
    lowest: float = 0.0
    group: int = -1
    on: int = -1

    @property
    def top(self) -> float:
        """Height of its upper face."""
        return float(self.centre[2] + 0.5 * self.extents[2])

    @property
    def bottom(self) -> float:
        """Height of its lower face."""
        return float(self.centre[2] - 0.5 * self.extents[2])

    @property
    def pose(self) -> FloatArray:
        """(4, 4) table_from_thing."""
        c, s = np.cos(self.yaw), np.sin(self.yaw)
        return rigid([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]], self.centre)

    def resting_at(self, height: float) -> Thing:
        """The same thing with its lower face at ``height``; its top stays."""
        span = max(THIN, self.top - height)
        centre = np.array([*self.centre[:2], self.top - 0.5 * span])
        return replace(self, centre=centre, extents=np.array([*self.extents[:2], span]))

    def covers(self, xy: FloatArray, margin: float = 0.0) -> NDArray[np.bool_]:
        """(N,) bool: points (N, 2) over its footprint, grown by ``margin`` metres."""
        c, s = np.cos(self.yaw), np.sin(self.yaw)
        local = (xy - self.centre[:2]) @ np.array([[c, -s], [s, c]])
        if self.kind in ("cylinder", "sphere"):
            return np.asarray(np.linalg.norm(local, axis=1) <= 0.5 * self.extents[0] + margin)
        return np.asarray((np.abs(local) <= 0.5 * self.extents[:2] + margin).all(axis=1))


def shape_thing(frames: Sequence[Frame], pixels: Pixels, members: IntArray, gap: float) -> Thing:
    """The solid that explains the pixels ``members`` (N,) best, standing on the table unless it is seen to hang."""
    points = pixels.points[members]
    lowest, highest = np.percentile(points[:, 2], [2.0, 98.0])
    floating = _hangs(frames, points, float(lowest), gap)
    bottom = float(lowest) - THIN if floating else 0.0
    highest = max(float(highest), bottom + THIN)
    yaw, middle, lengths = narrow_yaw(evenly(points[:, :2], 500))
    lengths = np.maximum(lengths, THIN)
    margin = 0.012
    low = np.array([*(points[:, :2].min(axis=0) - margin), bottom - (margin if floating else 0.0)])
    high = np.array([*(points[:, :2].max(axis=0) + margin), highest + margin])
    free, rays = silhouette(frames, pixels, members, low, high)
    seen = spread_out(points, MOST_SEEN)

    base, tops = (bottom - 0.01, bottom + 0.006), (highest - 0.012, highest + 0.006)
    sides, everywhere = (0.5 * THIN, 3.0), (-10.0, 10.0)

    def fitted(distance: Distance, start: Sequence[float], ranges: Sequence[tuple[float, float]]) -> Fit:
        hold = () if floating or distance is sphere_distance else (len(start) - 1,)
        limits = ([r[0] for r in ranges], [r[1] for r in ranges])
        return fit_solid(distance, start, seen, free, rays, hold=hold, limits=limits)

    fits: dict[Kind, Fit] = {}
    place = [everywhere] * 2
    fits["box"] = fitted(
        box_distance,
        [*middle, yaw, *lengths, highest, bottom],
        [*place, everywhere, sides, sides, tops, base],
    )
    width, depth, top = fits["box"].parameters[3:6]
    if max(width, depth) < 1.35 * min(width, depth):
        diameter = float(np.mean(lengths))
        fits["cylinder"] = fitted(
            cylinder_distance, [*middle, diameter, highest, bottom], [*place, sides, tops, base]
        )
        if 0.6 < (top - bottom) / diameter < 1.5:
            start = [*middle, highest - 0.5 * diameter, diameter]
            fits["sphere"] = fitted(sphere_distance, start, [*place, everywhere, sides])
    kind: Kind = min(fits, key=lambda name: fits[name].cost * (ROUND if name == "box" else 1.0))
    fit = fits[kind]
    yaw, centre, extents = _upright(kind, fit.parameters)
    if not _sane(centre, extents, low, high):
        kind = "other"
    if kind == "other" or fit.agreement < 0.5 * GOOD:
        kind = "other"
        yaw, middle, lengths = narrow_yaw(points[:, :2], trim=0.5)
        centre = np.array([*middle, 0.5 * (highest + bottom)])
        extents = np.array([*np.maximum(lengths, THIN), max(THIN, highest - bottom)])
    thing = Thing(
        kind, members, points, centre, yaw, extents, fit.agreement, floating=floating, lowest=float(lowest)
    )
    thing = _completed(frames, pixels, thing)
    return replace(thing, hollow=_is_hollow(thing))


def silhouette(
    frames: Sequence[Frame], pixels: Pixels, members: IntArray, low: FloatArray, high: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """What the outline says: points (M, 3) within ``low``, ``high`` (3,) that are free, since rays just beside the
    thing passed them before they hit anything; and points (R, S, 3) along the outermost rays that hit it.
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
        ring = binary_dilation(mask, iterations=2) & ~mask & np.isfinite(depth)
        rays, limit = frame.rays[window][ring], depth[ring] - BEFORE  # (R, 3), (R,)
        length = np.linalg.norm(rays, axis=1)
        steps = (((middle - frame.origin) @ rays.T) / length**2)[:, None]
        steps = steps + np.linspace(-1, 1, 14) * (reach / length)[:, None]
        samples = (frame.origin + rays[:, None] * steps[..., None])[steps < limit[:, None]]
        free.append(evenly(samples[((samples > low) & (samples < high)).all(axis=1)], MOST_FREE))
        edge = mask & ~binary_erosion(mask)
        along = depth[edge][:, None] + ALONG
        rim.append(evenly(frame.origin + frame.rays[window][edge][:, None] * along[..., None], MOST_RAYS))
    return np.concatenate(free), np.concatenate(rim)


def _completed(frames: Sequence[Frame], pixels: Pixels, thing: Thing) -> Thing:
    """A box of which one upright face alone was seen is taken to be as deep as it is wide, where that is not known
    to be free: the hand hides the rest of what it holds.
    """
    narrow = int(np.argmin(thing.extents[:2]))
    wide = float(thing.extents[1 - narrow])
    if (
        thing.kind not in ("box", "other")
        or thing.extents[narrow] > FACE
        or min(wide, thing.extents[2]) < 3 * FACE
    ):
        return thing
    normal = thing.pose[:3, narrow]
    views = np.unique(pixels.view[thing.members])
    away = thing.centre - np.mean([frames[v].origin for v in views], axis=0)
    normal = normal if normal @ away > 0 else -normal
    depths = np.linspace(0.3, 0.9, 4) * wide
    behind = evenly(thing.points, 60)[:, None] + depths[:, None] * normal  # (60, 4, 3)
    if seen_through(frames, behind.reshape(-1, 3)).mean() > 0.1:
        return thing
    extents = thing.extents.copy()
    extents[narrow] = wide
    centre = thing.centre + 0.5 * (wide - thing.extents[narrow]) * normal
    yaw, extents[0], extents[1] = upright_rectangle(thing.yaw, extents[0], extents[1])
    return replace(
        thing, kind="box", centre=centre, extents=extents, yaw=yaw, agreement=0.7 * thing.agreement
    )


def _hangs(frames: Sequence[Frame], points: FloatArray, lowest: float, gap: float) -> bool:
    """Whether cameras looked through the space between the thing and the table."""
    if lowest < gap:
        return False
    xy = evenly(points[:, :2], 60)
    heights = np.linspace(0.25, 0.85, 4) * lowest
    columns = np.concatenate([np.column_stack([xy, np.full(len(xy), z)]) for z in heights])
    return bool(seen_through(frames, columns).mean() > 0.25)


def _upright(kind: Kind, parameters: FloatArray) -> tuple[float, FloatArray, FloatArray]:
    """Yaw, centre (3,) and extents (3,); the long side of a box is its x axis, a square's yaw is within 45 degrees."""
    if kind == "sphere":
        return 0.0, parameters[:3], np.full(3, abs(parameters[3]))
    if kind == "cylinder":
        cx, cy, diameter, top, bottom = parameters
        return (
            0.0,
            np.array([cx, cy, 0.5 * (top + bottom)]),
            np.array([abs(diameter), abs(diameter), top - bottom]),
        )
    cx, cy, yaw, width, depth, top, bottom = parameters
    yaw, width, depth = upright_rectangle(yaw, width, depth)
    return yaw, np.array([cx, cy, 0.5 * (top + bottom)]), np.array([width, depth, top - bottom])


def upright_rectangle(yaw: float, width: float, depth: float) -> tuple[float, float, float]:
    """Yaw, width, depth of the same rectangle named the same way each time."""
    if min(width, depth) > 0.9 * max(width, depth):
        quarter = np.round(yaw / (0.5 * np.pi))
        yaw -= quarter * 0.5 * np.pi
        if int(quarter) % 2:
            width, depth = depth, width
        return float(yaw), float(width), float(depth)
    if depth > width:
        yaw, width, depth = yaw + 0.5 * np.pi, depth, width
    return float((yaw + 0.5 * np.pi) % np.pi - 0.5 * np.pi), float(width), float(depth)


def _sane(centre: FloatArray, extents: FloatArray, low: FloatArray, high: FloatArray) -> bool:
    return bool((extents > 0.5 * THIN).all() and (centre > low - 0.02).all() and (centre < high + 0.02).all())


def _is_hollow(thing: Thing) -> bool:
    """Points well inside the walls and well under a rim: one looks into a cup, a box, a tray."""
    if thing.kind == "sphere" or thing.extents[2] < 0.02:
        return False
    depth = min(0.02, 0.4 * float(thing.extents[2]))
    inner = thing.covers(thing.points[:, :2], margin=-0.2 * float(thing.extents[:2].min()))
    deep = thing.points[:, 2] < thing.top - depth
    rim = thing.points[:, 2] > thing.top - 0.3 * depth
    return bool((inner & deep).mean() > 0.12 and (rim & inner).sum() < 0.25 * rim.sum())
