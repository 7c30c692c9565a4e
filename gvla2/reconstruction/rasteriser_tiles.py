"""Which Gaussians a tile shows, in which order, and which pixels of it each covers: numba kernels, float32."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from gvla2.reconstruction.compiled import Floats, Ints, Real, compiled
from gvla2.reconstruction.rasteriser_projection import CONIC_A, CONIC_DET, DEPTH, REACH, V


@compiled
def scatter(
    start: int,
    stop: int,
    across: int,
    boxes: Ints,
    splats: Floats,
    cursors: Ints,
    members: Ints,
    depths: Floats,
) -> None:
    """Append Gaussians ``start`` to ``stop`` to their tiles' lists, at ``cursors`` (tiles,), which it moves."""
    for i in range(start, stop):
        for row in range(boxes[i, 2], boxes[i, 3]):
            for column in range(boxes[i, 0], boxes[i, 1]):
                tile = row * across + column
                at = cursors[tile]
                members[at] = i
                depths[at] = splats[i, DEPTH]
                cursors[tile] = at + 1


@compiled
def sort_by_key(
    keys: NDArray[np.uint32],
    values: Ints,
    other_keys: NDArray[np.uint32],
    other_values: Ints,
) -> None:
    """Sort by ``keys`` (n,), bit patterns of positive floats, stably, in place: radix sort by bytes from below."""
    n = len(keys)
    if n < 2:
        return
    least, most = keys[0], keys[0]
    for k in range(n):
        least, most = min(least, keys[k]), max(most, keys[k])
    spread = most - least  # near depths share their upper bytes, which then need no pass
    counts = np.empty(256, np.int32)
    shift = 0
    while (spread >> shift) > 0:
        counts[:] = 0
        for k in range(n):
            counts[((keys[k] - least) >> shift) & 255] += 1
        total = 0
        for k in range(256):
            total, counts[k] = total + counts[k], total
        for k in range(n):
            digit = ((keys[k] - least) >> shift) & 255
            at = counts[digit]
            other_keys[at], other_values[at] = keys[k], values[k]
            counts[digit] = at + 1
        keys[:] = other_keys
        values[:] = other_values
        shift += 8


@compiled
def row_range(
    splat: Floats,
    low: int,
    high: int,
) -> tuple[int, int]:
    """First and last row within ``low`` <= y < ``high`` whose pixel centres the ellipse reaches."""
    half = np.float32(0.5)
    tall = math.sqrt(np.float32(2.0) * splat[REACH] * splat[CONIC_A] / splat[CONIC_DET])
    first = int(max(np.ceil(splat[V] - tall - half), np.float32(low)))
    last = int(min(np.floor(splat[V] + tall - half), np.float32(high - 1)))
    return first, last


@compiled
def row_span(
    u: Real,
    room: Real,
    shift: Real,
    inverse_a: Real,
    low: int,
    high: int,
) -> tuple[int, int, Real]:
    """One row of an ellipse: first and last column within ``low`` <= x < ``high`` (last < first when empty), and t.

    With t = dx + (B / A) dy the exponent is -1/2 (A t t + (det / A) dy dy), without a mixed term that cancels;
    ``shift`` is (B / A) dy and ``room`` what the second term leaves of REACH. t is that of the first pixel.
    """
    half = np.float32(0.5)
    reach = math.sqrt(np.float32(2.0) * room * inverse_a)
    middle = u - shift - half
    first = int(max(np.ceil(middle - reach), np.float32(low)))
    last = int(min(np.floor(middle + reach), np.float32(high - 1)))
    return first, last, np.float32(first) - middle
