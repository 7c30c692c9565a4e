"""Evidence of the views beside the points: where an object ends, free space under and behind it, its opening."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation, binary_erosion, binary_fill_holes

from gvla2.geometry.transform import FloatArray
from gvla2_plugins.classical.pixels import IntArray, Pixels, TableFrame, seen_through
from gvla2_plugins.classical.solids import SeenObject, evenly, upright_rectangle

MOST_FREE, MOST_RAYS = 150, 40  # free points and outermost rays that are kept of one view
BEFORE = 0.006  # metres in front of a measured surface where a ray is certainly free
ALONG = np.linspace(-0.006, 0.010, 9)  # metres about a measured depth, along the ray
WIDEST_HELD = 0.10  # metres: a hand that hides an object holds no wider one
FLAT = 0.03  # metres: a ring is no higher
NARROWEST = 0.008  # metres: a smaller hole is no hole that is seen
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


def completed(frames: Sequence[TableFrame], pixels: Pixels, obj: SeenObject) -> SeenObject:
    """A hanging box that seems shallow is taken to be as deep as it is wide, where that is not known to be free:
    the hand hides the rest of what it holds, often all but one face.
    """
    narrow = int(np.argmin(obj.extents[:2]))
    wide, shallow = float(obj.extents[1 - narrow]), float(obj.extents[narrow])
    boxed = obj.floating and obj.kind in ("box", "other")
    if not boxed or shallow > 0.85 * wide or wide > WIDEST_HELD:
        return obj
    views = np.unique(pixels.view[obj.members])
    cameras = obj.local(np.mean([frames[v].origin for v in views], axis=0))
    away = -1.0 if cameras[narrow] > 0 else 1.0
    shares = [np.linspace(-0.4, 0.4, 5)] * 3
    shares[narrow] = away * (0.5 + np.linspace(0.2, 0.9, 4) * (wide / shallow - 1.0))
    if seen_through(frames, obj.grid(*shares)).mean() > 0.1:
        return obj
    yaw, width, depth = upright_rectangle(obj.yaw, wide, wide)
    extents = np.array([width, depth, obj.extents[2]])
    centre = obj.centre + 0.5 * away * (wide - shallow) * obj.pose[:3, narrow]
    return replace(obj, kind="box", centre=centre, extents=extents, yaw=yaw, guessed=True)


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
    hole = _hole(frames, obj)
    return replace(obj, opening=hole, noun="ring") if hole > NARROWEST else obj


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


def _hole(frames: Sequence[TableFrame], obj: SeenObject) -> float:
    """Width of the hole in the middle of a flat object, metres: rays there go on to the table. 0 without one."""
    half, steps = 0.5 * obj.extents[2], np.linspace(-0.12, 0.12, 3)
    if seen_through(frames, obj.grid(steps, steps, np.array([0.5])), margin=half).mean() < 0.6:
        return 0.0
    rim: FloatArray = obj.local(obj.points)
    upper = rim[rim[:, 2] > half - 0.003]
    if len(upper) < FEWEST:
        return 0.0
    off = np.hypot(upper[:, 0], upper[:, 1]) if obj.kind == "cylinder" else np.abs(upper[:, :2]).max(axis=1)
    return 2.0 * float(np.percentile(off, 2.0))


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
