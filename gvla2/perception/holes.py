"""Depth that a camera lost here and there, as on dark surfaces, from what is measured about it on the same surface."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter

from gvla2.geometry.transform import FloatArray

REACH = 2
"""Pixels either way from which a depth is told."""
FEWEST = 4
"""Known pixels of one colour that tell it."""
ALIKE = 24
"""Levels of 255, in each channel, by which pixels of one surface differ at most."""
STRAIGHT = 0.006
"""Metres by which the known depths may be off a plane: at a step in depth nothing is told."""
STEADY = 0.3
"""What keeps a plane through few pixels from tilting, in squared pixels."""


def filled(
    depth: FloatArray, image: NDArray[np.uint8], within: NDArray[np.bool_] | None = None
) -> FloatArray:
    """The depth (H, W), metres, with pixels that are NaN replaced where neighbours of their colour lie in a plane.

    ``image`` (H, W, 3); only pixels of ``within`` (H, W) are replaced, all by default.
    """
    there = np.isfinite(depth)
    side = 2 * REACH + 1
    beside = uniform_filter(there.astype(np.float64), side, mode="constant") * side**2 > FEWEST - 0.5
    rows, columns = np.nonzero(~there & beside & (True if within is None else within))
    down, right = np.mgrid[-REACH : REACH + 1, -REACH : REACH + 1].reshape(2, -1)
    around = (rows[:, None] + REACH + down, columns[:, None] + REACH + right)  # (N, K)
    near = np.pad(depth, REACH, constant_values=np.nan)[around]
    hues = np.pad(image, [(REACH, REACH), (REACH, REACH), (0, 0)])[around].astype(np.int16)
    unlike = np.abs(hues - image[rows, columns][:, None].astype(np.int16)).max(axis=-1)
    known = np.isfinite(near) & (unlike <= ALIKE)
    enough = known.sum(axis=1) >= FEWEST
    rows, columns, near, known = rows[enough], columns[enough], np.nan_to_num(near[enough]), known[enough]
    weight = known / (1.0 + down**2 + right**2)
    basis = np.stack([np.ones(len(down)), down, right])
    left_side = np.einsum("nk,ik,jk->nij", weight, basis, basis) + STEADY * np.diag([0.0, 1.0, 1.0])
    right_side = np.einsum("nk,ik,nk->ni", weight, basis, near)
    plane = np.linalg.solve(left_side, right_side[..., None])[..., 0]
    off = (weight * (near - plane @ basis) ** 2).sum(axis=1) / weight.sum(axis=1)
    told = off < STRAIGHT**2
    result = depth.copy()
    result[rows[told], columns[told]] = plane[told, 0]
    return result
