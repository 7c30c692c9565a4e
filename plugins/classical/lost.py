"""Where no depth was measured in the midst of the bare table: glass and mirrors, which are not seen, but are noted."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation, binary_opening, find_objects, label

from gvla2.geometry.transform import FloatArray
from gvla2_plugins.classical.frames import TableFrame
from gvla2_plugins.classical.pixels import plane_crossings

SMALLEST = 0.02  # metres along the table: what hides less of it is noise
AROUND = 0.8  # share of the pixels about a hole that show the table
ONE_PLACE = 0.15  # metres between the feet of one thing in two pictures


def lost_places(frames: Sequence[TableFrame], flat: Sequence[NDArray[np.bool_]]) -> list[FloatArray]:
    """Points (3,) on the table, one a place, where a camera lost all depth and sees the table all around.

    ``flat`` (H, W), one a frame, are pixels of the table.
    """
    places: list[FloatArray] = []
    for frame, table in zip(frames, flat, strict=True):
        holes, _ = label(binary_opening(frame.lost, iterations=2))
        for number, (down, right) in enumerate(find_objects(holes), 1):
            window = (_wider(down), _wider(right))
            hole = holes[window] == number
            ring = binary_dilation(hole, iterations=4) & ~binary_dilation(hole, iterations=2)
            if not ring.any() or table[window][ring].mean() < AROUND:
                continue
            rows, columns = np.nonzero(hole)
            hidden = plane_crossings(frame, rows + window[0].start, columns + window[1].start)
            if np.ptp(hidden[:, :2], axis=0).min() < SMALLEST:
                continue
            # What is nearest to the camera is its foot; beyond it the thing only hides the table.
            away = np.linalg.norm(hidden - frame.origin, axis=1)
            foot = np.median(hidden[away <= np.percentile(away, 10.0)], axis=0)
            if all(np.linalg.norm(foot - other) > ONE_PLACE for other in places):
                places.append(foot)
    return places


def _wider(span: slice) -> slice:
    return slice(max(0, span.start - 5), span.stop + 5)
