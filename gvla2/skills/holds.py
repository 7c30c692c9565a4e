"""Holds: the parts of an object that fit between the fingers of a hand from above.

Either the whole object, between two of its faces; or a slim upper end (a nozzle, a neck, a handle), found from its
points; or the wall of a hollow object, with one finger inside.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from gvla2.geometry.transform import FloatArray
from gvla2.planning.arm import Hand
from gvla2.planning.scene import ROUND, SceneObject
from gvla2.skills.parameters import deepest
from gvla2.skills.proposals import horizontal

GRASP_PLAY = 0.004
"""The opened hand must be wider than the object by this much, metres: 2 mm of perceived width and 1 mm a side."""
SNUG = 0.008
"""Gap on each side if the hand is not fully opened, metres."""
EITHER_WAY = ((1.0, ""), (-1.0, " turned round"))
YAWS, RIM_YAWS = 8, 16
SLIMMER = 0.012
"""An upper end is a hold of its own if it is slimmer than the whole by this much, metres."""
FEWEST = 25
"""The fewest points that define a part's outline."""
STRAYS = (0.01, 0.99)
"""Quantiles of an object's points that bound its width; points beyond them are outliers."""
SHALLOW = 0.006
"""Least depth of the tool below the top, metres: the fingers' pads then overlap the object by 15 mm."""


@dataclass(frozen=True)
class Hold:
    """Fingers closing along ``closing`` (3,) over ``width`` metres, at ``xy`` (2,), at most ``depth`` below the top.

    ``slide`` is how far it may be shifted along the hand's breadth, ``opening`` in [0, 1] the hand's greatest opening,
    ``cost`` a deduction from the preference, ``part`` "top", "rim" or "" for the whole object.
    """

    closing: FloatArray
    width: float
    name: str
    xy: FloatArray
    depth: float = np.inf
    slide: float = 0.0
    opening: float = 1.0
    cost: float = 0.0
    part: str = ""


def holds(theme: SceneObject, hand: Hand) -> list[Hold]:
    """All holds that fit in the hand, those of the whole object first."""
    return [*_fitting(theme, hand), *slim_top(theme, hand), *wall(theme, hand)]


def has_hold(theme: SceneObject, hand: Hand) -> bool:
    """Whether there is any hold; the upper end, which takes longest, is looked at last."""
    return bool(_fitting(theme, hand) or wall(theme, hand) or slim_top(theme, hand))


def _fitting(theme: SceneObject, hand: Hand) -> list[Hold]:
    return [h for h in whole(theme, hand) if h.width + GRASP_PLAY <= hand.max_width]


def whole(theme: SceneObject, hand: Hand) -> Iterator[Hold]:
    """Around the whole object, even if too wide: at any yaw if it is round, else by its pairs of upright faces."""
    xy = theme.centre[:2]
    if theme.shape in ROUND:
        for k in range(YAWS):
            angle = 2 * np.pi * k / YAWS
            width = float(theme.extents[:2].max())
            yield Hold(horizontal(angle), width, f"yaw {np.degrees(angle):.0f}°", xy)
        return
    axes = theme.world_from_object[:3, :3]
    for i in (i for i in range(3) if abs(axes[2, i]) < 0.5):
        flat = axes[:, i] * [1.0, 1.0, 0.0]
        flat = flat / np.linalg.norm(flat)
        width = float(theme.extents[i])
        beside = np.array([-flat[1], flat[0], 0.0])
        slide = max(0.0, float(np.abs(beside @ axes) @ theme.extents) - hand.finger_breadth)
        for sign, flip in EITHER_WAY:
            yield Hold(sign * flat, width, f"across its {width * 1000:.0f} mm{flip}", xy, slide=slide)


def slim_top(theme: SceneObject, hand: Hand) -> list[Hold]:
    """Around an upper end that is slimmer than the whole, as deep as it fits in the hand."""
    if len(theme.points) < FEWEST or theme.shape in ("region", "sphere"):
        return []
    top = float(np.quantile(theme.points[:, 2], 0.995))
    broad = float(theme.extents[:2].max())
    for depth in np.arange(min(deepest(hand), 0.5 * (theme.top - theme.bottom)), SHALLOW - 1e-9, -0.003):
        band = theme.points[theme.points[:, 2] > top - depth - hand.tip_beyond_tcp]
        if len(band) < FEWEST:
            return []
        found = [h for h in _around(theme, band[:, :2], float(depth), hand) if h.width < broad - SLIMMER]
        if found:
            return found
    return []


def _around(theme: SceneObject, band: FloatArray, depth: float, hand: Hand) -> list[Hold]:
    """Holds that fit around points (N, 2) of an upper end, starting with its slimmest side."""
    turns = (
        np.arctan2(theme.world_from_object[1, 0], theme.world_from_object[0, 0]) + np.pi * np.arange(36) / 36
    )
    widths = np.ptp(spans(band, turns), axis=0)
    if widths.min() + GRASP_PLAY > hand.max_width or widths.min() >= theme.extents[:2].max() - SLIMMER:
        return []
    yaw = float(turns[widths.argmin()])
    found = []
    yaws = yaw + np.pi * np.arange(2 * YAWS) / YAWS
    ends, sides = spans(band, yaws).T, spans(band, yaws + 0.5 * np.pi).T
    for k, ((low, high), (left, right)) in enumerate(zip(ends, sides, strict=True)):
        closing = horizontal(yaw + np.pi * k / YAWS)
        beside = np.array([-closing[1], closing[0], 0.0])
        width = float(high - low)
        if width + GRASP_PLAY > hand.max_width:
            continue
        xy = closing[:2] * 0.5 * (low + high) + beside[:2] * 0.5 * (left + right)
        name = f"the slim top, {width * 1000:.0f} mm, yaw {np.degrees(yaw + np.pi * k / YAWS) % 360:.0f}°"
        # A box that is held askew turns in the hand.
        found.append(Hold(closing, width, name, xy, depth, cost=0.05, part="top"))
    slimmest = min((h.width for h in found), default=0.0)
    return [h for h in found if h.width < slimmest + 0.004]


def wall(theme: SceneObject, hand: Hand) -> list[Hold]:
    """By the wall of an open round object, with one finger inside if there is room for it."""
    broad = float(theme.extents[:2].max())
    room = theme.opening - hand.finger_thickness - 0.01  # between the inner finger and the opposite wall
    if theme.opening <= 0.0 or theme.shape not in ("cylinder", "other") or room < 0.01:
        return []
    thickness = max(0.002, 0.5 * (broad - theme.opening))
    opening = min(1.0, (thickness + min(2 * SNUG + 0.012, room)) / hand.max_width)
    if thickness + GRASP_PLAY > hand.max_width * opening:
        return []
    radius = 0.5 * (broad - thickness)
    found = []
    for k in range(RIM_YAWS):
        angle = 2 * np.pi * k / RIM_YAWS
        out = horizontal(angle)
        xy = theme.centre[:2] + radius * out[:2]
        for sign, flip in EITHER_WAY:
            name = f"by its wall at {np.degrees(angle):.0f}°{flip}"
            found.append(Hold(sign * out, thickness, name, xy, opening=opening, cost=0.1, part="rim"))
    return found


def spans(points: FloatArray, angles: FloatArray) -> FloatArray:
    """(2, A) lowest and highest coordinates of points (N, 2), without outliers, along directions (A,), radians."""
    ways = np.stack([np.cos(angles), np.sin(angles)])
    return np.asarray(np.quantile(ways.T @ points.T, STRAYS, axis=1))
