"""The seen points of an object as an object of the scene: an upright box around them, a coarse shape, a colour word."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from gvla2.geometry.transform import FloatArray, rigid
from gvla2.planning.colours import appearance, nearest_colours
from gvla2.planning.scene import Box, SceneObject, Shape

MOST_POINTS = 4000
RESTS = 0.02
"""An object seen at most this high above the table, metres, stands on it: its foot is hidden or too near the table."""
ONE_HUE = 18.0
"""Largest look difference of points of one hue: print on an object is not its colour."""
CUBE = 1.2
"""Largest ratio of the longest to the shortest side of a cube."""
DEEP = 0.3
"""An object is hollow when nothing of its middle reaches within this share of its height of its top."""
SURE = 12.0
"""Margin by which the second nearest colour word must be further away to be ruled out."""


def object_of(
    points: FloatArray, rgb: FloatArray, table_height: float, confidence: float, id_: str = "object"
) -> SceneObject:
    """One object from its seen points (N, 3), metres, and their colours (N, 3) in [0, 1]; N is at least 3."""
    yaw, low, high = footprint(points[:, :2])
    # Single flying pixels must not make an object higher.
    bottom, top = np.percentile(points[:, 2], [1.0, 99.5])
    bottom = table_height if bottom < table_height + RESTS else float(bottom)
    top = max(float(top), bottom + 1e-3)
    c, s = np.cos(yaw), np.sin(yaw)
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    middle = turn[:2, :2] @ (0.5 * (low + high))
    extents = np.array([*np.maximum(high - low, 1e-3), top - bottom])
    shape = coarse_shape(points, extents, middle)
    own = true_colour(rgb)
    colour, sure = colour_word(own)
    alike = float(extents.max()) < CUBE * float(extents.min())
    noun = "cube" if shape == "box" and alike else {"other": "object"}.get(shape, shape)
    seen = points if len(points) <= MOST_POINTS else points[:: -(-len(points) // MOST_POINTS)]
    pose = rigid(turn, [*middle, 0.5 * (bottom + top)])
    score = round(float(np.clip(confidence * (0.5 + 0.5 * sure), 0.05, 1.0)), 3)
    return SceneObject(id_, f"{colour} {noun}", shape, colour, pose, extents, seen, own, confidence=score)


def opening_of(points: FloatArray) -> float:
    """The narrowest inner width at the top of a hollow object from points (N, 3) of its whole surface, metres.

    0 for one that is closed: something of its middle lies near its top.
    """
    low, high = points.min(axis=0), points.max(axis=0)
    height, half = high[2] - low[2], 0.5 * float(min((high - low)[:2]))
    away = np.linalg.norm(points[:, :2] - 0.5 * (low + high)[:2], axis=1)
    inner = points[away < 0.4 * half, 2]
    rim = away[points[:, 2] > high[2] - 0.15 * height]
    if not len(inner) or not len(rim) or inner.max() > high[2] - DEEP * height:
        return 0.0
    return 2 * float(np.percentile(rim, 2.0))


def footprint(xy: FloatArray) -> tuple[float, FloatArray, FloatArray]:
    """The smallest rectangle about points (N, 2): its turn in radians and its corners (2,) in the turned frame."""
    try:
        hull = xy[ConvexHull(xy).vertices]
    except (QhullError, ValueError):
        hull = xy  # in a line, or too few
    edges = np.roll(hull, -1, axis=0) - hull
    angles = np.unique(np.round(np.arctan2(edges[:, 1], edges[:, 0]) % (np.pi / 2), 4))
    c, s = np.cos(angles), np.sin(angles)
    along, across = hull @ np.stack([c, s]), hull @ np.stack([-s, c])
    spans = np.ptp(along, axis=0) * np.ptp(across, axis=0)
    best = int(np.argmin(spans))
    a, b = along[:, best], across[:, best]
    return float(angles[best]), np.array([a.min(), b.min()]), np.array([a.max(), b.max()])


def coarse_shape(points: FloatArray, extents: FloatArray, middle: FloatArray) -> Shape:
    """The shape from the box's sides and the footprint's outline."""
    width, length = sorted(extents[:2])
    height = extents[2]
    gaps = np.linalg.norm(points[:, :2] - middle, axis=1)
    # A circle's outline stands within half a side everywhere, a square's corners reach 1.41 of it.
    round_ = length < 1.15 * width and float(np.percentile(gaps, 99.5)) < 1.12 * 0.5 * length
    if max(length, height) > 4.0 * sorted([width, length, height])[1]:
        return "bar"
    if round_ and 0.8 * length < height < 1.2 * length:
        level = points[:, 2] > points[:, 2].max() - 0.15 * height
        return "sphere" if np.percentile(gaps[level], 95) < 0.42 * length else "cylinder"
    if round_:
        return "cylinder" if height >= 0.6 * length else "disc"
    if height < 0.025 and height < 0.3 * width:
        return "plate"
    return "box"


def true_colour(rgb: FloatArray) -> FloatArray:
    """(3,) of the hue that most points (N, 3) have, the brightest: light falls off with slope, it never brightens."""
    hues = appearance(rgb)[:, :2]
    common = np.linalg.norm(hues - np.median(hues, axis=0), axis=1) < ONE_HUE
    own = rgb[common] if common.sum() >= 10 else rgb
    brightness = own.sum(axis=1)
    return np.asarray(np.median(own[brightness >= np.percentile(brightness, 85.0)], axis=0))


def colour_word(rgb: FloatArray) -> tuple[str, float]:
    """The nearest colour word to (3,) in [0, 1], and how sure it is, in [0, 1], from the lead over the second."""
    (word, first), (_, second) = nearest_colours(rgb, 2)
    return word, float(np.clip((second - first) / SURE, 0.0, 1.0))


def numbered(objects: Sequence[SceneObject]) -> tuple[SceneObject, ...]:
    """The objects with ids o1, o2, ... by x, then y, to the millimetre, in whatever order they were found."""
    ids = new_ids(objects)
    ordered = enumerate(_ordered(objects), 1)
    return tuple(replace(o, id=f"o{k}", parent=ids.get(o.parent, "")) for k, o in ordered)


def new_ids(objects: Sequence[SceneObject]) -> dict[str, str]:
    """The ids that :func:`numbered` gives, by the objects' present ids."""
    return {obj.id: f"o{k}" for k, obj in enumerate(_ordered(objects), 1)}


def _ordered(objects: Sequence[SceneObject]) -> list[SceneObject]:
    return sorted(objects, key=lambda o: (*np.round(o.centre, 3).tolist(), float(o.extents[2])))


def over_workspace(objects: Sequence[SceneObject], workspace: Box) -> list[SceneObject]:
    """The objects whose middle lies over the workspace, with their parts."""
    low, high = workspace.low[:2], workspace.high[:2]
    inside = {o.id for o in objects if ((o.centre[:2] >= low) & (o.centre[:2] <= high)).all()}
    return [o for o in objects if o.id in inside or (o.joint is not None and o.parent in inside)]
