"""Front-to-back compositing of Gaussians in tiles, and its gradient: numba kernels, float32.

A tile's Gaussians are taken nearest first, and each is painted over the pixels of its ellipse, row by row: the
ends of a row follow from a square root, so no pixel outside is touched, and along the row the exponential is a
recurrence of two products. A pixel whose transmittance is spent is skipped, a row and a tile of such pixels too.

The gradient runs front to back as well. With ``rest``, the part of (gradient . final colour) that lies behind
the Gaussian at hand, d loss / d alpha = T (gradient . colour) - rest / (1 - alpha): one number a pixel is enough,
and both kernels walk the same rows in the same order.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from gvla2.reconstruction.compiled import Floats, Ints, Real, compiled
from gvla2.reconstruction.rasteriser_projection import (
    BLUE,
    CONIC_A,
    CONIC_B,
    CONIC_DET,
    GREEN,
    OPACITY,
    REACH,
    RED,
    TILE,
    U,
    V,
)
from gvla2.reconstruction.rasteriser_tiles import row_range, row_span, sort_by_key

SUMS = 9
"""What a tile knows of one Gaussian's gradient, p = alpha d loss / d alpha summed over its pixels: p, p dx, p dy,
p dx dx, p dx dy, p dy dy, then the gradients of red, green, blue."""


@compiled
def composite(
    part: int,
    parts: int,
    across: int,
    offsets: Ints,
    members: Ints,
    keys: NDArray[np.uint32],
    splats: Floats,
    background: Floats,
    max_alpha: Real,
    stop: Real,
    image: Floats,
    left: Floats,
    longest: int,
) -> None:
    """Sort and paint the tiles ``part``, ``part + parts``, ...; rows of ``members`` end up nearest first.

    Writes ``image`` (H, W, 3), unclipped and with the background, and ``left`` (H, W), the light still passing.
    """
    height, width = left.shape
    one, half = np.float32(1.0), np.float32(0.5)
    other_keys, other_values = np.empty(longest, np.uint32), np.empty(longest, np.int32)
    # Unsigned indices spare numba the test for negative ones.
    light, colour = np.empty(TILE * TILE, np.float32), np.empty((TILE * TILE, 3), np.float32)
    open_in_row = np.empty(TILE, np.uint32)  # a bit for each pixel that still lets light pass
    for tile in range(part, len(offsets) - 1, parts):
        x0, y0 = (tile % across) * TILE, (tile // across) * TILE
        x1, y1 = min(x0 + TILE, width), min(y0 + TILE, height)
        begin, end = offsets[tile], offsets[tile + 1]
        count = end - begin
        sort_by_key(keys[begin:end], members[begin:end], other_keys[:count], other_values[:count])
        light[:] = one
        colour[:] = np.float32(0.0)
        open_in_row[:] = (np.uint32(1) << np.uint32(x1 - x0)) - np.uint32(1)
        still_open = (x1 - x0) * (y1 - y0)
        for entry in range(begin, end):
            if still_open == 0:
                break
            splat = splats[members[entry]]
            u, v, a, opacity, reach = splat[U], splat[V], splat[CONIC_A], splat[OPACITY], splat[REACH]
            red, green, blue = splat[RED], splat[GREEN], splat[BLUE]
            inverse_a = one / a
            lean, flat = splat[CONIC_B] * inverse_a, half * splat[CONIC_DET] * inverse_a
            shrink = math.exp(-a)
            top, bottom = row_range(splat, y0, y1)
            for y in range(top, bottom + 1):
                if open_in_row[y - y0] == 0:
                    continue
                dy = np.float32(y) + half - v
                down = flat * dy * dy
                if not down < reach:
                    continue
                first, last, t = row_span(u, reach - down, lean * dy, inverse_a, x0, x1)
                if first > last or not (open_in_row[y - y0] >> np.uint32(first - x0)) & (
                    (np.uint32(2) << np.uint32(last - first)) - np.uint32(1)
                ):
                    continue
                alpha = opacity * math.exp(-half * a * t * t - down)
                ratio = math.exp(-a * (t + half))
                row = np.uint64((y - y0) * TILE)
                start = row + np.uint64(first - x0)
                for k in range(start, start + np.uint64(last + 1 - first)):
                    passing = light[k]
                    if passing > stop:
                        weight = passing * min(alpha, max_alpha)
                        colour[k, 0] += weight * red
                        colour[k, 1] += weight * green
                        colour[k, 2] += weight * blue
                        passing -= weight
                        light[k] = passing
                        if passing <= stop:
                            open_in_row[y - y0] &= ~(np.uint32(1) << np.uint32(k - row))
                            still_open -= 1
                    alpha *= ratio
                    ratio *= shrink
        for y in range(y0, y1):
            for x in range(x0, x1):
                k = (y - y0) * TILE + x - x0
                left[y, x] = light[k]
                for channel in range(3):
                    image[y, x, channel] = colour[k, channel] + light[k] * background[channel]


@compiled
def composite_back(
    part: int,
    parts: int,
    across: int,
    offsets: Ints,
    members: Ints,
    boxes: Ints,
    splats: Floats,
    first_entry: Ints,
    max_alpha: Real,
    stop: Real,
    image: Floats,
    left: Floats,
    to_image: Floats,
    to_alpha: Floats,
    partial: Floats,
) -> None:
    """Write ``partial`` (entries, 9), see ``SUMS``, for the tiles ``part``, ``part + parts``, ...

    ``to_image`` (H, W, 3) and ``to_alpha`` (H, W) are the loss's gradients at the image and at alpha = 1 - left.
    """
    height, width = left.shape
    one, half, zero = np.float32(1.0), np.float32(0.5), np.float32(0.0)
    light, rest = np.empty(TILE * TILE, np.float32), np.empty(TILE * TILE, np.float32)
    slope = np.empty((TILE * TILE, 3), np.float32)
    open_in_row = np.empty(TILE, np.uint32)  # a bit for each pixel that still lets light pass
    for tile in range(part, len(offsets) - 1, parts):
        begin, end = offsets[tile], offsets[tile + 1]
        if begin == end:
            continue
        tile_column, tile_row = tile % across, tile // across
        x0, y0 = tile_column * TILE, tile_row * TILE
        x1, y1 = min(x0 + TILE, width), min(y0 + TILE, height)
        light[:] = one
        open_in_row[:] = (np.uint32(1) << np.uint32(x1 - x0)) - np.uint32(1)
        still_open = (x1 - x0) * (y1 - y0)
        for y in range(y0, y1):
            for x in range(x0, x1):
                k = (y - y0) * TILE + x - x0
                rest[k] = -to_alpha[y, x] * left[y, x]
                for channel in range(3):
                    slope[k, channel] = to_image[y, x, channel]
                    rest[k] += to_image[y, x, channel] * image[y, x, channel]
        for entry in range(begin, end):
            if still_open == 0:
                break
            i = members[entry]
            splat = splats[i]
            u, v, a, opacity, reach = splat[U], splat[V], splat[CONIC_A], splat[OPACITY], splat[REACH]
            red, green, blue = splat[RED], splat[GREEN], splat[BLUE]
            inverse_a = one / a
            lean, flat = splat[CONIC_B] * inverse_a, half * splat[CONIC_DET] * inverse_a
            shrink = math.exp(-a)
            top, bottom = row_range(splat, y0, y1)
            s0 = sx = sy = sxx = sxy = syy = to_red = to_green = to_blue = zero
            for y in range(top, bottom + 1):
                if open_in_row[y - y0] == 0:
                    continue
                dy = np.float32(y) + half - v
                down = flat * dy * dy
                if not down < reach:
                    continue
                first, last, t = row_span(u, reach - down, lean * dy, inverse_a, x0, x1)
                if first > last or not (open_in_row[y - y0] >> np.uint32(first - x0)) & (
                    (np.uint32(2) << np.uint32(last - first)) - np.uint32(1)
                ):
                    continue
                alpha = opacity * math.exp(-half * a * t * t - down)
                ratio = math.exp(-a * (t + half))
                dx = t - lean * dy
                r0 = rx = rxx = zero
                row = np.uint64((y - y0) * TILE)
                start = row + np.uint64(first - x0)
                for k in range(start, start + np.uint64(last + 1 - first)):
                    passing = light[k]
                    if passing > stop:
                        used = min(alpha, max_alpha)
                        weight = passing * used
                        g_red, g_green, g_blue = slope[k, 0], slope[k, 1], slope[k, 2]
                        shade = g_red * red + g_green * green + g_blue * blue
                        behind = rest[k] - weight * shade
                        rest[k] = behind
                        to_red += weight * g_red
                        to_green += weight * g_green
                        to_blue += weight * g_blue
                        if alpha <= max_alpha:
                            p = alpha * (passing * shade - behind / (one - used))
                            r0 += p
                            rx += p * dx
                            rxx += p * dx * dx
                        passing -= weight
                        light[k] = passing
                        if passing <= stop:
                            open_in_row[y - y0] &= ~(np.uint32(1) << np.uint32(k - row))
                            still_open -= 1
                    alpha *= ratio
                    ratio *= shrink
                    dx += one
                s0 += r0
                sx += rx
                sy += r0 * dy
                sxx += rxx
                sxy += rx * dy
                syy += r0 * dy * dy
            columns = boxes[i, 1] - boxes[i, 0]
            at = first_entry[i] + (tile_row - boxes[i, 2]) * columns + tile_column - boxes[i, 0]
            partial[at, 0], partial[at, 1], partial[at, 2] = s0, sx, sy
            partial[at, 3], partial[at, 4], partial[at, 5] = sxx, sxy, syy
            partial[at, 6], partial[at, 7], partial[at, 8] = to_red, to_green, to_blue
