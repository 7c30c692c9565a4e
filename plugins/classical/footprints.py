"""Outlines of what is flat: a rectangle or a circle between the points of it and those seen beside it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation

from gvla2.geometry.transform import FloatArray
from gvla2_plugins.classical.frames import IntArray, TableFrame
from gvla2_plugins.classical.pixels import Pixels, plane_crossings
from gvla2_plugins.classical.solids import box_distance, cylinder_distance, evenly, fit_solid, narrow_yaw

# Metres and radians about the rectangle of the points, for a fit of one.
ROOM = np.array([0.015, 0.015, 0.1, 0.015, 0.015, 1.0, 1.0])
MOST = 700  # points of each kind


@dataclass(frozen=True)
class Footprint:
    """``round`` or not; ``middle`` (2,), ``yaw``, ``lengths`` (2,) in the table's frame, metres and radians;
    ``agreement`` in [0, 1] as of :class:`~gvla2_plugins.classical.solids.SolidFit`.
    """

    round: bool
    middle: FloatArray
    yaw: float
    lengths: FloatArray
    agreement: float


def footprint_of(
    frames: Sequence[TableFrame],
    pixels: Pixels,
    members: IntArray,
    bare: Sequence[NDArray[np.bool_]],
    height: float = 0.0,
) -> Footprint:
    """The outline of the flat thing of the pixels ``members`` (N,) that lies ``height`` metres above the table.

    ``bare`` (H, W), one a frame, are pixels that show what is not of it.
    """
    points = pixels.points[members]
    outside = [np.zeros((0, 3))]
    for number, (frame, mask) in enumerate(zip(frames, bare, strict=True)):
        mine = members[pixels.view[members] == number]
        own = np.zeros(mask.shape, dtype=bool)
        own[pixels.row[mine], pixels.column[mine]] = True
        rows, columns = np.nonzero(binary_dilation(own, iterations=2) & mask & ~own)
        outside.append(plane_crossings(frame, rows, columns, height))
    beside = evenly(np.concatenate(outside), MOST)
    yaw, middle, lengths = narrow_yaw(points[:, :2], trim=0.2)
    seen = evenly(points, MOST)
    # Of no height that counts: a slab and a drum from far below to far above.
    slab = np.array([*middle, yaw, *lengths, 1.0, -1.0])
    drum = np.array([*middle, lengths.mean(), 1.0, -1.0])
    fits = []
    for distance, start in ((box_distance, slab), (cylinder_distance, drum)):
        room = ROOM[: len(start)]
        limits = start - room, start + room
        fitted = fit_solid(
            distance, start, seen, beside, hold=(-2, -1), limits=limits, filled=True, tolerance=0.004
        )
        fits.append(fitted)
    square, disc = fits
    if disc.cost < 0.5 * square.cost and lengths.max() < 1.2 * lengths.min():
        cx, cy, width = disc.parameters[:3]
        return Footprint(True, np.array([cx, cy]), 0.0, np.array([width, width]), disc.agreement)
    cx, cy, yaw, *sides = square.parameters[:5]
    return Footprint(False, np.array([cx, cy]), float(yaw), np.array(sides), square.agreement)
