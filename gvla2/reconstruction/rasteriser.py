"""A tile-based rasteriser of Gaussians on the CPU, with gradients.

``Rasteriser.render`` gives the image and alpha of one camera; ``forward`` and ``backward`` give them with the
gradients that an optimiser needs. The kernels are numba's, compiled on first use and cached. Work is shared by plain
threads (the kernels release Python's lock), and no result depends on their number: tiles are independent, and sums over
tiles are taken in a fixed order.

A tile's Gaussians are taken nearest first, and each is painted over the pixels of its ellipse, row by row: the
ends of a row follow from a square root, so no pixel outside is touched, and along the row the exponential is a
recurrence of two products. A pixel whose transmittance is spent is skipped, a row and a tile of such pixels too.

The gradient runs front to back as well. With ``rest``, the part of (gradient . final colour) that lies behind
the Gaussian at hand, d loss / d alpha = T (gradient . colour) - rest / (1 - alpha): one number a pixel is enough,
and both kernels walk the same rows in the same order.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from gvla2.errors import ConfigurationError, GeometryError
from gvla2.geometry.camera import Camera
from gvla2.geometry.gaussians import Gaussians
from gvla2.reconstruction.compiled import Floats, Ints, Real, compiled, cores, run_chunks, run_together
from gvla2.reconstruction.rasteriser_projection import (
    BLUE,
    CONIC_A,
    CONIC_B,
    CONIC_DET,
    DEPTH,
    GREEN,
    OPACITY,
    REACH,
    RED,
    SPLAT_COLUMNS,
    TILE,
    U,
    V,
    project,
    project_back,
)

MAX_ALPHA = np.float32(0.99)
"""The most that a single Gaussian hides, as in 3DGS."""
_FRUSTUM_MARGIN = 1.3  # as in 3DGS: beyond it the projection's linearisation is taken at the margin
_FEWEST_FOR_THREADS = 2000  # below, starting a thread costs more than it saves


@dataclass(frozen=True)
class Rasteriser:
    """Paints Gaussians; the defaults are those of 3D Gaussian splatting.

    ``low_pass`` square pixels added to both variances of an ellipse; ``near`` metres, nearer centres are left out;
    ``min_alpha`` contributions below it are left out; ``stop`` a pixel is finished when at most this share of light
    still passes. Raises :class:`ConfigurationError` for values out of range.
    """

    low_pass: float = 0.3
    near: float = 0.01
    min_alpha: float = 1 / 255
    stop: float = 1e-4

    def __post_init__(self) -> None:
        if not (
            0 < self.min_alpha < MAX_ALPHA and self.near > 0 and self.low_pass >= 0 and 0 <= self.stop < 1
        ):
            raise ConfigurationError(
                f"A rasteriser needs 0 < min_alpha < {MAX_ALPHA:g}, near > 0, low_pass >= 0 and 0 <= stop < 1, got "
                f"{self}."
            )

    def render(
        self, gaussians: Gaussians, camera: Camera, background: tuple[float, float, float] = (1.0, 1.0, 1.0)
    ) -> tuple[Floats, Floats]:
        """Image (H, W, 3) and alpha (H, W), both float32 in [0, 1]; the image has the background added."""
        frame = forward(gaussians, camera, background, self)
        return np.clip(frame.image, 0.0, 1.0), frame.alpha


@dataclass(frozen=True)
class Frame:
    """One rendered camera, and what :func:`backward` needs to know of it.

    ``image`` (H, W, 3) with the background, not clipped; ``alpha`` (H, W) in [0, 1]. The rest is the rasteriser's
    own: ``splats`` (N, 12) projected Gaussians, ``boxes`` (N, 4) their tiles, ``offsets`` (tiles + 1,) and
    ``members`` (entries,) each tile's Gaussians, nearest first.
    """

    gaussians: Gaussians
    camera: Camera
    rasteriser: Rasteriser
    image: Floats
    alpha: Floats
    splats: Floats
    boxes: NDArray[np.int32]
    offsets: NDArray[np.int64]
    members: NDArray[np.int32]


@dataclass(frozen=True)
class GaussianGradients:
    """A loss's gradients, each in the shape of the field of :class:`Gaussians` of the same name, float32."""

    centres: Floats
    log_scales: Floats
    rotations: Floats
    opacity_logits: Floats
    sh_dc: Floats


def forward(
    gaussians: Gaussians,
    camera: Camera,
    background: tuple[float, float, float] = (1.0, 1.0, 1.0),
    rasteriser: Rasteriser = Rasteriser(),
) -> Frame:
    """Render, and keep what the gradients need. Raises :class:`GeometryError` for a K that is not a pinhole's."""
    count, height, width = len(gaussians), camera.height, camera.width
    packed = _pack(camera, rasteriser)
    centres, log_scales, rotations, logits, sh_dc, sh_rest = _contiguous(gaussians)
    splats = np.empty((count, SPLAT_COLUMNS), np.float32)
    boxes = np.empty((count, 4), np.int32)

    def project_some(start: int, stop: int) -> None:
        given = centres, log_scales, rotations, logits, sh_dc, sh_rest
        project(start, stop, packed, width, height, *given, splats, boxes)

    run_chunks(project_some, count, _FEWEST_FOR_THREADS)
    # Sorted once, nearest first and equal depths in the Gaussians' order: so is each tile's list then.
    shown = np.flatnonzero(boxes[:, 0] < boxes[:, 1])
    order = shown[np.argsort(splats[shown, DEPTH], kind="stable")]
    offsets, members = _tile_lists(order, boxes, -(-width // TILE), -(-height // TILE))
    image = np.empty((height, width, 3), np.float32)
    left = np.empty((height, width), np.float32)
    colour, stop = np.asarray(background, np.float32), np.float32(rasteriser.stop)
    parts = _parts(count)
    run_together(
        [
            partial(composite, part, parts, offsets, members, splats, colour, stop, image, left)
            for part in range(parts)
        ]
    )
    return Frame(gaussians, camera, rasteriser, image, 1 - left, splats, boxes, offsets, members)


def backward(frame: Frame, to_image: Floats, to_alpha: Floats | None = None) -> GaussianGradients:
    """Gradients of a loss from its gradients ``to_image`` (H, W, 3) and ``to_alpha`` (H, W) at a frame.

    They are those of the unclipped image, of centres in the frame of the Gaussians. Of the colour only the
    constant harmonic is differentiated: ``sh_rest`` is rendered, but neither it nor the centres' share in the
    direction of view gets a gradient. Raises :class:`GeometryError` for a gradient of another size.
    """
    gaussians, boxes = frame.gaussians, frame.boxes
    count, shape = len(gaussians), frame.alpha.shape
    to_image = np.ascontiguousarray(to_image, np.float32)
    to_alpha = np.zeros(shape, np.float32) if to_alpha is None else np.ascontiguousarray(to_alpha, np.float32)
    if to_image.shape != (*shape, 3) or to_alpha.shape != shape:
        raise GeometryError(
            f"A frame of {shape} pixels needs gradients of {(*shape, 3)} and {shape}, "
            f"got {to_image.shape} and {to_alpha.shape}."
        )
    first = np.zeros(count + 1, np.int64)
    np.cumsum((boxes[:, 1] - boxes[:, 0]) * (boxes[:, 3] - boxes[:, 2]), out=first[1:])
    sums = np.zeros((len(frame.members), SUMS), np.float32)
    stop, left = np.float32(frame.rasteriser.stop), 1 - frame.alpha
    lists = frame.offsets, frame.members, boxes, frame.splats, first
    parts = _parts(count)
    run_together(
        [
            partial(composite_back, part, parts, *lists, stop, frame.image, left, to_image, to_alpha, sums)
            for part in range(parts)
        ]
    )
    packed = _pack(frame.camera, frame.rasteriser)
    centres, log_scales, rotations, *_ = _contiguous(gaussians)
    found = [
        np.zeros(size, np.float32) for size in ((count, 3), (count, 3), (count, 4), (count,), (count, 3))
    ]

    def project_some(start: int, stop: int) -> None:
        project_back(start, stop, packed, centres, log_scales, rotations, frame.splats, first, sums, *found)

    run_chunks(project_some, count, _FEWEST_FOR_THREADS)
    return GaussianGradients(*found)


def _pack(camera: Camera, rasteriser: Rasteriser) -> Floats:
    """The camera as the kernels read it, see ``rasteriser_projection.ROTATION`` and the following."""
    K, pose = camera.K, camera.camera_from_world
    if K[1, 0] != 0 or not np.array_equal(K[2], [0, 0, 1]):
        raise GeometryError(
            f"Camera '{camera.name}': K must be upper triangular with last row 0 0 1, got\n{K}"
        )
    # The slopes x/z, y/z at which the image ends; the principal point need not be central, nor in the image.
    corners = np.array([[u, v, 1] for u in (0, camera.width) for v in (0, camera.height)])
    slopes = corners @ np.linalg.inv(K).T
    middle, half = (slopes.max(axis=0) + slopes.min(axis=0)) / 2, np.ptp(slopes, axis=0) / 2
    low, high = middle - _FRUSTUM_MARGIN * half, middle + _FRUSTUM_MARGIN * half
    intrinsics = [K[0, 0], K[0, 1], K[0, 2], K[1, 1], K[1, 2]]
    limits = [low[0], high[0], low[1], high[1], rasteriser.low_pass, rasteriser.near, rasteriser.min_alpha]
    packed = [*pose[:3, :3].ravel(), *pose[:3, 3], *intrinsics, *camera.position, *limits]
    return np.array(packed, dtype=np.float32)


def _contiguous(of: Gaussians) -> list[Floats]:
    """What the kernels read: centres, log-scales, rotations, logits, constant and higher harmonics (none: (0, 0))."""
    rest = np.zeros((0, 0), np.float32) if of.sh_rest is None else of.sh_rest
    arrays = (of.centres, of.log_scales, of.rotations, of.opacity_logits, of.sh_dc, rest)
    return [np.ascontiguousarray(array) for array in arrays]


def _parts(count: int) -> int:
    """Into how many parts the tiles are divided."""
    return 1 if count < _FEWEST_FOR_THREADS else cores()


@compiled
def _tile_lists(
    order: Ints, boxes: Ints, across: int, down: int
) -> tuple[NDArray[np.int64], NDArray[np.int32]]:
    """Offsets (tiles + 1,) and members (entries,): each tile's Gaussians in the given order (N,)."""
    ends = np.zeros(across * down + 1, np.int64)
    for i in order:
        for row in range(boxes[i, 2], boxes[i, 3]):
            for column in range(boxes[i, 0], boxes[i, 1]):
                ends[row * across + column + 1] += 1
    offsets = np.cumsum(ends)
    cursors, members = offsets.copy(), np.empty(offsets[-1], np.int32)
    for i in order:
        for row in range(boxes[i, 2], boxes[i, 3]):
            for column in range(boxes[i, 0], boxes[i, 1]):
                tile = row * across + column
                members[cursors[tile]] = i
                cursors[tile] += 1
    return offsets, members


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


SUMS = 9
"""What a tile knows of one Gaussian's gradient, p = alpha d loss / d alpha summed over its pixels: p, p dx, p dy,
p dx dx, p dx dy, p dy dy, then the gradients of red, green, blue."""


@compiled
def composite(
    part: int,
    parts: int,
    offsets: Ints,
    members: Ints,
    splats: Floats,
    background: Floats,
    stop: Real,
    image: Floats,
    left: Floats,
) -> None:
    """Paint the tiles ``part``, ``part + parts``, ...; ``members`` of a tile are nearest first.

    Writes ``image`` (H, W, 3), unclipped and with the background, and ``left`` (H, W), the light still passing.
    """
    height, width = left.shape
    across = (width + TILE - 1) // TILE
    one, half = np.float32(1.0), np.float32(0.5)
    # Unsigned indices spare numba the test for negative ones.
    light, colour = np.empty(TILE * TILE, np.float32), np.empty((TILE * TILE, 3), np.float32)
    open_in_row = np.empty(TILE, np.uint32)  # a bit for each pixel that still lets light pass
    for tile in range(part, len(offsets) - 1, parts):
        x0, y0 = (tile % across) * TILE, (tile // across) * TILE
        x1, y1 = min(x0 + TILE, width), min(y0 + TILE, height)
        light[:] = one
        colour[:] = np.float32(0.0)
        open_in_row[:] = (np.uint32(1) << np.uint32(x1 - x0)) - np.uint32(1)
        still_open = (x1 - x0) * (y1 - y0)
        for entry in range(offsets[tile], offsets[tile + 1]):
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
                        weight = passing * min(alpha, MAX_ALPHA)
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
    offsets: Ints,
    members: Ints,
    boxes: Ints,
    splats: Floats,
    first_entry: Ints,
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
    across = (width + TILE - 1) // TILE
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
                        used = min(alpha, MAX_ALPHA)
                        weight = passing * used
                        g_red, g_green, g_blue = slope[k, 0], slope[k, 1], slope[k, 2]
                        shade = g_red * red + g_green * green + g_blue * blue
                        behind = rest[k] - weight * shade
                        rest[k] = behind
                        to_red += weight * g_red
                        to_green += weight * g_green
                        to_blue += weight * g_blue
                        if alpha <= MAX_ALPHA:
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
