"""Rectangles of a picture: the part worth showing, and labels that cover neither each other nor their objects."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from gvla2.geometry.transform import FloatArray


class Rect(NamedTuple):
    """A rectangle in picture coordinates, y downwards; pixels or SVG units."""

    x0: float
    y0: float
    x1: float
    y1: float

    @property
    def centre(self) -> tuple[float, float]:
        """Its middle."""
        return (self.x0 + self.x1) / 2, (self.y0 + self.y1) / 2

    @property
    def width(self) -> float:
        """Its width; 0 when it is empty."""
        return max(0.0, self.x1 - self.x0)

    @property
    def height(self) -> float:
        """Its height; 0 when it is empty."""
        return max(0.0, self.y1 - self.y0)

    @property
    def area(self) -> float:
        """Its area; 0 when it is empty."""
        return self.width * self.height

    def overlap(self, other: Rect) -> float:
        """Area shared with ``other``."""
        low, high = map(max, self[:2], other[:2]), map(min, self[2:], other[2:])
        return Rect(*low, *high).area

    def grown(self, by: float) -> Rect:
        """The rectangle with ``by`` more on every side."""
        return Rect(self.x0 - by, self.y0 - by, self.x1 + by, self.y1 + by)


def around(x: float, y: float, radius: float) -> Rect:
    """The square of half side ``radius`` about a point."""
    return Rect(x - radius, y - radius, x + radius, y + radius)


def part_about(points: FloatArray, size: tuple[int, int], grow: float, least: float) -> Rect:
    """The square part of a picture of ``size`` (width, height) with the points (N, 2), in whole pixels.

    Its side is ``grow`` times what the points need and at least ``least``, as far as the picture goes. Without points
    it is the whole picture.
    """
    whole = np.array(size)
    if not len(points):
        return Rect(0, 0, *size)
    low, high = points.min(axis=0), points.max(axis=0)
    extent = np.minimum(np.ceil(max(least, grow * (high - low).max())), whole)
    start = np.clip((low + high - extent) // 2, 0, whole - extent)
    return Rect(*np.concatenate([start, start + extent]).tolist())


def place(
    near: Rect, size: tuple[float, float], taken: Sequence[Rect], bounds: Rect, gap: float = 4.0
) -> Rect:
    """The best of some 40 places of a label of ``size`` (width, height) about ``near``.

    Overlap with ``taken`` and area outside ``bounds`` cost most, then distance; the result always lies inside
    ``bounds`` if it fits.
    """
    width, height = size
    cx, cy = near.centre
    best, best_cost = Rect(cx, cy, cx + width, cy + height), float("inf")
    for ring in range(4):
        if 0.15 * ring * width * height >= best_cost:
            break  # nothing further out is better
        away = gap + ring * (height + gap)
        columns = (cx - width / 2, near.x0 - away - width, near.x1 + away)
        rows = (near.y0 - away - height, near.y1 + away, cy - height / 2)
        for order, (x, y) in enumerate((x, y) for y in rows for x in columns):
            x = min(max(x, bounds.x0), max(bounds.x0, bounds.x1 - width))
            y = min(max(y, bounds.y0), max(bounds.y0, bounds.y1 - height))
            spot = Rect(x, y, x + width, y + height)
            covered = sum(spot.overlap(other) for other in taken)
            cost = covered + 0.5 * spot.overlap(near) + spot.area * (0.15 * ring + 0.01 * order)
            if cost < best_cost:
                best, best_cost = spot, cost
    return best
