"""What the views say beside the points: where a thing ends, what is free under, behind and inside it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.ndimage import binary_dilation, binary_erosion, binary_fill_holes

from gvla2.geometry.transform import FloatArray
from gvla2_plugins.classical.frames import Frame, seen_through
from gvla2_plugins.classical.pixels import IntArray, Pixels
from gvla2_plugins.classical.solids import evenly
from gvla2_plugins.classical.things import Thing, upright_rectangle

MOST_FREE, MOST_RAYS = 150, 40  # free points and outermost rays that are kept of one view
BEFORE = 0.006  # metres in front of a measured surface where a ray is certainly free
ALONG = np.linspace(-0.006, 0.010, 9)  # metres about a measured depth, along the ray
WIDEST_HELD = 0.10  # metres: a hand that hides a thing holds no wider one


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
        outer = binary_fill_holes(
            mask
        )  # through an opening one sees the inside, not what is beside the thing
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


def hangs(frames: Sequence[Frame], points: FloatArray, lowest: float, gap: float) -> bool:
    """Whether cameras looked through the space between the thing and the table, near the table.

    Most cameras look down, past the thing's own edges: a few rays through tell more than many that it hides.
    """
    if lowest < gap:
        return False
    xy = evenly(points[:, :2], 60)
    heights = np.linspace(0.2, 0.6, 3) * lowest
    columns = np.concatenate([np.column_stack([xy, np.full(len(xy), z)]) for z in heights])
    return bool(seen_through(frames, columns).mean() > 0.1)


def completed(frames: Sequence[Frame], pixels: Pixels, thing: Thing) -> Thing:
    """A hanging box that seems shallow is taken to be as deep as it is wide, where that is not known to be free:
    the hand hides the rest of what it holds, often all but one face.
    """
    narrow = int(np.argmin(thing.extents[:2]))
    wide, shallow = float(thing.extents[1 - narrow]), float(thing.extents[narrow])
    boxed = thing.floating and thing.kind in ("box", "other")
    if not boxed or shallow > 0.85 * wide or wide > WIDEST_HELD:
        return thing
    views = np.unique(pixels.view[thing.members])
    cameras = thing.local(np.mean([frames[v].origin for v in views], axis=0))
    away = -1.0 if cameras[narrow] > 0 else 1.0
    shares = [np.linspace(-0.4, 0.4, 5)] * 3
    shares[narrow] = away * (0.5 + np.linspace(0.2, 0.9, 4) * (wide / shallow - 1.0))
    if seen_through(frames, thing.grid(*shares)).mean() > 0.1:
        return thing
    yaw, width, depth = upright_rectangle(thing.yaw, wide, wide)
    extents = np.array([width, depth, thing.extents[2]])
    centre = thing.centre + 0.5 * away * (wide - shallow) * thing.pose[:3, narrow]
    return replace(thing, kind="box", centre=centre, extents=extents, yaw=yaw, guessed=True)


def sees_into(frames: Sequence[Frame], thing: Thing, share: float = 0.4) -> bool:
    """Whether cameras look through a ``share`` of the solid's upper half, inside its walls: a cup, a box, a tray."""
    if thing.kind == "sphere" or thing.extents[2] < 0.025 or min(thing.extents[:2]) < 0.04:
        return False
    across = np.linspace(-0.28, 0.28, 5)
    inside = thing.grid(across, across, np.linspace(0.05, 0.3, 3))
    return bool(seen_through(frames, inside).mean() > share)
