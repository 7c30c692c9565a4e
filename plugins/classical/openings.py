"""How wide things are open: inside the walls of hollow ones, and through the middle of flat ones."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gvla2.geometry.transform import FloatArray
from gvla2_plugins.classical.frames import Frame, seen_through
from gvla2_plugins.classical.things import Thing

FLAT = 0.03  # metres: a ring is no higher
NARROWEST = 0.008  # metres: a smaller hole is no hole that is seen
THICK, FLOOR = 0.016, 0.02  # metres: no wall and no floor is thicker
STRAY = 0.05  # share of the points that need not be where they should
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
    half, steps = 0.5 * thing.extents[2], np.linspace(-0.12, 0.12, 3)
    if seen_through(frames, thing.grid(steps, steps, np.array([0.5])), margin=half).mean() < 0.6:
        return 0.0
    rim: FloatArray = thing.local(thing.points)
    upper = rim[rim[:, 2] > half - 0.003]
    if len(upper) < FEWEST:
        return 0.0
    off = np.hypot(upper[:, 0], upper[:, 1]) if thing.kind == "cylinder" else np.abs(upper[:, :2]).max(axis=1)
    return 2.0 * float(np.percentile(off, 2.0))


def within_walls(thing: Thing, points: FloatArray, wall: float = THICK) -> NDArray[np.bool_]:
    """(N,) bool: points (N, 3) in the hollow of a thing, away from its walls, ``wall`` metres thick, and its floor."""
    local = thing.local(points)
    high = local[:, 2] > FLOOR - 0.5 * thing.extents[2]
    if thing.kind == "cylinder":
        return np.asarray(high & (np.hypot(local[:, 0], local[:, 1]) < 0.5 * thing.extents[0] - wall))
    return np.asarray(high & (np.abs(local[:, :2]) < 0.5 * thing.extents[:2] - wall).all(axis=1))


def crowded(thing: Thing) -> bool:
    """Whether points of a thing were seen in its middle, where a hollow one has none."""
    local = np.abs(thing.local(thing.points)[:, :2]) / thing.extents[:2]
    high = thing.points[:, 2] > thing.bottom + 0.3 * thing.extents[2]
    return bool((high & (local < 0.25).all(axis=1)).mean() > STRAY)


def on_walls(thing: Thing) -> bool:
    """Whether what is seen of a thing is its walls and its floor."""
    return bool(within_walls(thing, thing.points).mean() < 2 * STRAY)
