"""A tile-based rasteriser of Gaussians on the CPU: image and alpha of one camera.

The kernels are numba's, compiled on first use and cached. Work is shared by plain threads (the kernels release
Python's lock), and no result depends on their number: tiles are independent.

A Gaussian is projected by its axes: with the columns of L = R S and the projection's Jacobian J at its centre, the
ellipse is V V^T + low_pass I with V = J W L. Keeping V (2, 3) instead of a 3x3 covariance makes the determinant a sum
of squares: |v1 x v2|^2 + low_pass (|v1|^2 + |v2|^2) + low_pass^2 loses nothing to cancellation.

A tile's Gaussians are taken nearest first, and each is painted over the pixels of its ellipse, row by row: the
ends of a row follow from a square root, so no pixel outside is touched, and along the row the exponential is a
recurrence of two products. A pixel whose transmittance is spent is skipped, a row and a tile of such pixels too.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gvla2.errors import ConfigurationError, GeometryError
from gvla2.geometry.camera import Camera
from gvla2.geometry.compiled import Floats, Ints, Real, cores, fused, run_chunks, run_together
from gvla2.geometry.gaussians import Gaussians

MAX_ALPHA = np.float32(0.99)
"""The most that a single Gaussian hides, as in 3DGS."""
STOP = np.float32(1e-4)
"""A pixel is finished when at most this share of light still passes."""
TILE = 16
"""Side of the square tiles in pixels."""
_FRUSTUM_MARGIN = 1.3  # as in 3DGS: beyond it the projection's linearisation is taken at the margin
_FEWEST_FOR_THREADS = 2000  # below, starting a thread costs more than it saves

U, V, CONIC_A, CONIC_B, CONIC_DET, OPACITY, REACH, RED, GREEN, BLUE, DEPTH = range(11)
"""Columns of a projected Gaussian ("splat"). A and B belong to the conic ((A, B), (B, C)), the inverse of the ellipse;
REACH is ln(opacity / min_alpha): alpha is above min_alpha while half the squared Mahalanobis distance is below it."""
SPLAT_COLUMNS = 11

ROTATION, TRANSLATION, INTRINSICS, SLOPES, LOW_PASS, NEAR, MIN_ALPHA = 0, 9, 12, 17, 21, 22, 23
"""Offsets in the camera's vector: camera_from_world (9 + 3), k00 k01 k02 k11 k12, the least and greatest slopes x/z,
y/z at which the projection is linearised, and the renderer's options."""

MOST_SPREAD = np.float32(1e3)
"""A standard deviation of this multiple of the depth covers any image; more would only overflow."""
SH_C0 = np.float32(0.2820948)


@dataclass(frozen=True)
class Rasteriser:
    """Paints Gaussians; the defaults are those of 3D Gaussian splatting.

    ``low_pass`` square pixels added to both variances of an ellipse; ``near`` metres, nearer centres are left out;
    ``min_alpha`` contributions below it are left out. Raises :class:`ConfigurationError` for values out of range.
    """

    low_pass: float = 0.3
    near: float = 0.01
    min_alpha: float = 1 / 255

    def __post_init__(self) -> None:
        if not (0 < self.min_alpha < MAX_ALPHA and self.near > 0 and self.low_pass >= 0):
            raise ConfigurationError(
                f"A rasteriser needs 0 < min_alpha < {MAX_ALPHA:g}, near > 0 and low_pass >= 0, got {self}."
            )

    def render(
        self, gaussians: Gaussians, camera: Camera, background: tuple[float, float, float] = (1.0, 1.0, 1.0)
    ) -> tuple[Floats, Floats]:
        """Image (H, W, 3) and alpha (H, W), both float32 in [0, 1]; the image has the background added.

        Raises :class:`GeometryError` for a K that is not a pinhole's.
        """
        count, height, width = len(gaussians), camera.height, camera.width
        splats, boxes = np.empty((count, SPLAT_COLUMNS), np.float32), np.empty((count, 4), np.int32)
        given: Any = _pack(camera, self), width, height, *_contiguous(gaussians), splats, boxes
        run_chunks(lambda start, stop: _project(start, stop, *given), count, _FEWEST_FOR_THREADS)
        # Sorted once, nearest first and equal depths in the Gaussians' order: so is each tile's list then.
        shown = np.flatnonzero(boxes[:, 0] < boxes[:, 1])
        order = shown[np.argsort(splats[shown, DEPTH], kind="stable")]
        offsets, members = _tile_lists(order, boxes, -(-width // TILE), -(-height // TILE))
        image, left = np.empty((height, width, 3), np.float32), np.empty((height, width), np.float32)
        tiles = offsets, members, splats, np.asarray(background, np.float32), image, left
        workers = 1 if count < _FEWEST_FOR_THREADS else cores()
        run_together([partial(_composite, worker, workers, *tiles) for worker in range(workers)])
        return np.clip(image, 0.0, 1.0), 1 - left


def _contiguous(of: Gaussians) -> list[Floats]:
    """Contiguous centres, log-scales, rotations, logits and constant harmonics."""
    arrays = (of.centres, of.log_scales, of.rotations, of.opacity_logits, of.sh_dc)
    return [np.ascontiguousarray(array) for array in arrays]


def _pack(camera: Camera, rasteriser: Rasteriser) -> Floats:
    """The camera as the kernels read it, see :data:`ROTATION` and the following."""
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
    packed = [*pose[:3, :3].ravel(), *pose[:3, 3], *intrinsics, *limits]
    return np.array(packed, dtype=np.float32)


@fused
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


@fused
def _composite(
    worker: int,
    workers: int,
    offsets: Ints,
    members: Ints,
    splats: Floats,
    background: Floats,
    image: Floats,
    left: Floats,
) -> None:
    """Paint the tiles ``worker``, ``worker + workers``, ...; ``members`` of a tile are nearest first.

    Writes ``image`` (H, W, 3), unclipped and with the background, and ``left`` (H, W), the light still passing.
    With t = dx + (B / A) dy the exponent is -1/2 (A t t + (det / A) dy dy), without a mixed term that cancels.
    """
    height, width = left.shape
    across = (width + TILE - 1) // TILE
    one, two, half = np.float32(1.0), np.float32(2.0), np.float32(0.5)
    # Unsigned indices spare numba the test for negative ones.
    light, colour = np.empty(TILE * TILE, np.float32), np.empty((TILE * TILE, 3), np.float32)
    open_in_row = np.empty(TILE, np.uint32)  # a bit for each pixel that still lets light pass
    for tile in range(worker, len(offsets) - 1, workers):
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
            tall = math.sqrt(two * reach * a / splat[CONIC_DET])
            top = int(max(np.ceil(v - tall - half), np.float32(y0)))
            bottom = int(min(np.floor(v + tall - half), np.float32(y1 - 1)))
            for y in range(top, bottom + 1):
                if open_in_row[y - y0] == 0:
                    continue
                dy = np.float32(y) + half - v
                down = flat * dy * dy
                if not down < reach:
                    continue
                wide = math.sqrt(two * (reach - down) * inverse_a)
                middle = u - lean * dy - half
                first = int(max(np.ceil(middle - wide), np.float32(x0)))
                last = int(min(np.floor(middle + wide), np.float32(x1 - 1)))
                t = np.float32(first) - middle
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
                    if passing > STOP:
                        weight = passing * min(alpha, MAX_ALPHA)
                        colour[k, 0] += weight * red
                        colour[k, 1] += weight * green
                        colour[k, 2] += weight * blue
                        passing -= weight
                        light[k] = passing
                        if passing <= STOP:
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


@fused
def _project(
    start: int,
    stop: int,
    camera: Floats,
    width: int,
    height: int,
    centres: Floats,
    log_scales: Floats,
    rotations: Floats,
    logits: Floats,
    sh_dc: Floats,
    splats: Floats,
    boxes: Ints,
) -> None:
    """Project Gaussians ``start`` to ``stop``.

    Writes ``splats`` (N, 11) and ``boxes`` (N, 4), the first and last-plus-one tile column, then row, empty for a
    Gaussian that is not seen.
    """
    low_pass, near, min_alpha = camera[LOW_PASS], camera[NEAR], camera[MIN_ALPHA]
    axes, image = np.empty((3, 3), np.float32), np.empty((2, 3), np.float32)
    one, two, half = np.float32(1.0), np.float32(2.0), np.float32(0.5)
    for i in range(start, stop):
        boxes[i, 0] = boxes[i, 1] = boxes[i, 2] = boxes[i, 3] = 0
        cx, cy, cz = centres[i, 0], centres[i, 1], centres[i, 2]
        x = camera[0] * cx + camera[1] * cy + camera[2] * cz + camera[9]
        y = camera[3] * cx + camera[4] * cy + camera[5] * cz + camera[10]
        z = camera[6] * cx + camera[7] * cy + camera[8] * cz + camera[11]
        if not z > near:
            continue
        opacity = one / (one + math.exp(-logits[i]))
        if not opacity > min_alpha:
            continue
        _axes(log_scales[i], rotations[i], MOST_SPREAD * z, axes)
        # V = J W L; far outside the image J is taken at its margin, as in 3DGS.
        slope_x = min(max(x / z, camera[SLOPES]), camera[SLOPES + 1])
        slope_y = min(max(y / z, camera[SLOPES + 2]), camera[SLOPES + 3])
        k00, k01, k11 = camera[INTRINSICS], camera[INTRINSICS + 1], camera[INTRINSICS + 3]
        image[:] = np.float32(0.0)
        for j in range(3):
            along_x = (camera[j] - slope_x * camera[6 + j]) * (one / z)
            along_y = (camera[3 + j] - slope_y * camera[6 + j]) * (one / z)
            for k in range(3):
                image[0, k] += (k00 * along_x + k01 * along_y) * axes[j, k]
                image[1, k] += k11 * along_y * axes[j, k]
        xx, yy = (image[0] * image[0]).sum(), (image[1] * image[1]).sum()
        xy = (image[0] * image[1]).sum()
        c0 = image[0, 1] * image[1, 2] - image[0, 2] * image[1, 1]
        c1 = image[0, 2] * image[1, 0] - image[0, 0] * image[1, 2]
        c2 = image[0, 0] * image[1, 1] - image[0, 1] * image[1, 0]
        det = c0 * c0 + c1 * c1 + c2 * c2 + low_pass * (xx + yy) + low_pass * low_pass
        if not (det > 0 and det < np.inf):  # flat and edge-on without a low-pass
            continue
        xx, yy = xx + low_pass, yy + low_pass
        u = k00 * x / z + k01 * y / z + camera[INTRINSICS + 2]
        v = k11 * y / z + camera[INTRINSICS + 4]
        # The pixels whose centres (k + 0.5) lie in the box around the ellipse where alpha reaches min_alpha.
        reach = math.log(opacity / min_alpha)
        half_u, half_v = math.sqrt(two * reach * xx), math.sqrt(two * reach * yy)
        left, right = np.ceil(u - half_u - half), np.floor(u + half_u - half)
        top, bottom = np.ceil(v - half_v - half), np.floor(v + half_v - half)
        if not (
            left <= right and top <= bottom and right >= 0 and bottom >= 0 and left < width and top < height
        ):
            continue
        boxes[i, 0], boxes[i, 1] = int(max(left, 0)) // TILE, int(min(right, width - 1)) // TILE + 1
        boxes[i, 2], boxes[i, 3] = int(max(top, 0)) // TILE, int(min(bottom, height - 1)) // TILE + 1
        splats[i, U], splats[i, V], splats[i, DEPTH] = u, v, z
        splats[i, CONIC_A], splats[i, CONIC_B], splats[i, CONIC_DET] = yy / det, -xy / det, one / det
        splats[i, OPACITY], splats[i, REACH] = opacity, reach
        for k in range(3):
            splats[i, RED + k] = max(half + SH_C0 * sh_dc[i, k], np.float32(0.0))


@fused
def _axes(log_scale: Floats, rotation: Floats, most: Real, axes: Floats) -> None:
    """Write L = R S (3, 3), one axis of the Gaussian a column, none longer than ``most``."""
    w, x, y, q = rotation[0], rotation[1], rotation[2], rotation[3]
    one, two = np.float32(1.0), np.float32(2.0)
    inverse = one / math.sqrt(w * w + x * x + y * y + q * q)
    w, x, y, q = w * inverse, x * inverse, y * inverse, q * inverse
    a = min(math.exp(log_scale[0]), most)
    b = min(math.exp(log_scale[1]), most)
    c = min(math.exp(log_scale[2]), most)
    axes[0, 0] = (one - two * (y * y + q * q)) * a
    axes[1, 0] = two * (x * y + w * q) * a
    axes[2, 0] = two * (x * q - w * y) * a
    axes[0, 1] = two * (x * y - w * q) * b
    axes[1, 1] = (one - two * (x * x + q * q)) * b
    axes[2, 1] = two * (y * q + w * x) * b
    axes[0, 2] = two * (x * q + w * y) * c
    axes[1, 2] = two * (y * q - w * x) * c
    axes[2, 2] = (one - two * (x * x + y * y)) * c
