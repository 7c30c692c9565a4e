"""How wide things are open: inside the walls of hollow ones, and through the middle of flat ones."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from gvla2.geometry.transform import FloatArray, transform_points
from gvla2_plugins.classical.frames import Frame, seen_through
from gvla2_plugins.classical.things import Thing

FLAT = 0.03  # metres: a ring is no higher
NARROWEST = 0.008  # metres: a smaller hole is no hole that is seen
FEWEST = 20  # points that tell where a wall is


def opened(frames: Sequence[Frame], thing: Thing) -> Thing:
    """The thing with its ``opening``, and as a ring where it is flat and one sees the table through it."""
    if thing.hollow:
        return replace(thing, opening=_between_walls(thing))
    if thing.kind == "sphere" or thing.turn is not None or thing.floating:
        return thing
    width = float(min(thing.extents[:2]))
    if thing.extents[2] > min(FLAT, 0.6 * width) or width > 0.2:
        return thing
    hole = _hole(frames, thing)
    return replace(thing, opening=hole, noun="ring") if hole > NARROWEST else thing


def _between_walls(thing: Thing) -> float:
    """The outer width less both walls: the points furthest inside near the top are on the inner wall."""
    local = thing.local(thing.points)
    upper = local[(local[:, 2] > 0.1 * thing.extents[2]) & (local[:, 2] < 0.42 * thing.extents[2])]
    width = float(min(thing.extents[:2]))
    if thing.kind == "cylinder":
        depth = 0.5 * width - np.hypot(upper[:, 0], upper[:, 1])
    else:
        depth = (0.5 * thing.extents[:2] - np.abs(upper[:, :2])).min(axis=1)
    depth = depth[(depth > 0) & (depth < 0.2 * width)]
    wall = float(np.percentile(depth, 90.0)) if len(depth) >= FEWEST else 0.0
    return max(0.0, width - 2.0 * wall)


def _hole(frames: Sequence[Frame], thing: Thing) -> float:
    """Width of the hole in the middle of a flat thing, metres: rays there go on to the table. 0 without one."""
    pose, half_height = thing.pose, 0.5 * thing.extents[2]
    steps = np.linspace(-0.12, 0.12, 3) * min(thing.extents[:2])
    x, y = np.meshgrid(steps, steps)
    middle = np.stack([x.ravel(), y.ravel(), np.full(x.size, half_height)], axis=1)
    if seen_through(frames, transform_points(pose, middle), margin=0.5 * thing.extents[2]).mean() < 0.6:
        return 0.0
    rim: FloatArray = thing.local(thing.points)
    upper = rim[rim[:, 2] > half_height - 0.003]
    if len(upper) < FEWEST:
        return 0.0
    off = np.hypot(upper[:, 0], upper[:, 1]) if thing.kind == "cylinder" else np.abs(upper[:, :2]).max(axis=1)
    return 2.0 * float(np.percentile(off, 2.0))
