"""Silhouettes of point sets, drawn into images.

A point set has no outline of its own: its discs of some radius r are drawn and the radius is taken back, which
closes the gaps between the points and leaves the outline where the outermost points are (a morphological
closing). Both steps use real-valued distances, so that the outline is right to a fraction of a pixel.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_erosion

from gvla2.geometry.camera import Camera
from gvla2.geometry.transform import FloatArray
from gvla2.reconstruction.compiled import compiled, run_chunks
from gvla2.reconstruction.support import NEAR, projection

Field = NDArray[np.float32]
SHELL = 1.5
"""Pixels beyond the drawn discs in which distances are exact; more than a pixel's diagonal."""
_LEAST_RADIUS, _MOST_RADIUS = 1.0, 8.0  # pixels
_CELL = 8  # pixels; side of the cells in which points are counted


@dataclass(frozen=True)
class Outline:
    """The silhouette of points in one image.

    ``inside`` (H, W) pixels from a pixel's centre to the outline, positive inside; exact near the outline,
    clipped at a few pixels elsewhere. ``nearest`` (H, W) the index of the point drawn nearest, -1 where none is.
    ``radius`` in pixels is the radius of the closing.
    """

    inside: Field
    nearest: NDArray[np.int32]
    radius: float

    @property
    def mask(self) -> NDArray[np.bool_]:
        """(H, W) pixels whose centre is inside."""
        return np.asarray(self.inside >= 0)


def outline(points: FloatArray, camera: Camera, radius: float | None = None) -> Outline:
    """The outline of world points (N, 3), contiguous float64; points that are not finite are left out.

    ``radius`` of the closing in pixels, chosen by the points' density (:func:`closing_radius`) if None.
    """
    height, width = camera.height, camera.width
    uv = projected(points, camera)
    if radius is None:
        radius = closing_radius(uv, width, height)
    distance = np.full((height, width), np.inf, dtype=np.float32)
    nearest = np.full((height, width), -1, dtype=np.int32)
    _draw(uv, radius, distance, nearest)
    reach = np.float32(radius + SHELL)
    inside = np.where(distance <= reach, np.float32(SHELL), -reach)
    _close(distance, radius, inside)
    return Outline(inside, nearest, radius)


def closing_radius(uv: NDArray[np.float32], width: int, height: int) -> float:
    """The radius, in pixels, of the largest gap to be expected between projected points (N, 2), NaN ignored.

    For a Poisson process of density d over an area A the largest empty disc has d pi r^2 = ln(d A); d is the
    fifth percentile over cells of 8 pixels that lie within the object, so that thin spots count.
    """
    counts = np.zeros((height // _CELL + 1, width // _CELL + 1), dtype=np.int64)
    _count(uv, width, height, counts)
    taken = counts > 0
    if not taken.any():
        return _LEAST_RADIUS
    core = binary_erosion(taken, np.ones((3, 3), dtype=np.bool_))
    many = core.sum() >= 8
    per_cell = np.percentile(counts[core], 5) if many else counts[taken].mean()
    density = max(float(per_cell), 1.0) / _CELL**2
    expected = max(np.log(density * _CELL**2 * taken.sum()), 1.0)
    return float(np.clip(np.sqrt(expected / (np.pi * density)), _LEAST_RADIUS, _MOST_RADIUS))


def projected(points: FloatArray, camera: Camera) -> NDArray[np.float32]:
    """Pixels and depth (N, 3) of contiguous world points (N, 3), NaN for those that are not in front."""
    uvz = np.empty((len(points), 3), dtype=np.float32)
    run_chunks(partial(_project, points, projection(camera), uvz), len(points))
    return uvz


@compiled
def _project(points: FloatArray, P: FloatArray, uvz: NDArray[np.float32], start: int, stop: int) -> None:
    for n in range(start, stop):
        x, y, z = points[n, 0], points[n, 1], points[n, 2]
        depth = P[2, 0] * x + P[2, 1] * y + P[2, 2] * z + P[2, 3]
        if not depth > NEAR:
            uvz[n] = np.nan
            continue
        uvz[n, 0] = (P[0, 0] * x + P[0, 1] * y + P[0, 2] * z + P[0, 3]) / depth
        uvz[n, 1] = (P[1, 0] * x + P[1, 1] * y + P[1, 2] * z + P[1, 3]) / depth
        uvz[n, 2] = depth


@compiled
def _count(uv: NDArray[np.float32], width: int, height: int, counts: NDArray[np.int64]) -> None:
    for n in range(len(uv)):
        u, v = uv[n, 0], uv[n, 1]
        if u >= 0 and v >= 0 and u < width and v < height:
            counts[int(v) // _CELL, int(u) // _CELL] += 1


@compiled
def _draw(
    uv: NDArray[np.float32],
    radius: float,
    distance: Field,
    nearest: NDArray[np.int32],
) -> None:
    """Distance (H, W) from pixel centres to the nearest disc: exact in the shell, infinite beyond it.

    A pixel that holds a point is within any closing radius; only the others are searched, ring by ring, and
    only until the answer is known to be within the radius. So a dense set costs little more than its rim.
    """
    height, width = distance.shape
    reach = np.float32(radius + SHELL)
    margin = int(np.ceil(reach + 0.5))  # points out there reach into the image
    rows, columns = height + 2 * margin, width + 2 * margin
    first = np.full((rows, columns), -1, dtype=np.int32)  # the points of a pixel, as linked lists
    following = np.empty(len(uv), dtype=np.int32)
    for n in range(len(uv)):
        u, v = uv[n, 0] + margin, uv[n, 1] + margin
        if u >= 0 and v >= 0 and u < columns and v < rows:
            i, j = int(v), int(u)
            following[n] = first[i, j]
            first[i, j] = n
    sums = np.zeros((rows + 1, columns + 1), dtype=np.int32)
    for i in range(rows):
        row = np.int32(0)
        for j in range(columns):
            row += np.int32(first[i, j] >= 0)
            sums[i + 1, j + 1] = row + sums[i, j + 1]
    for i in range(height):
        for j in range(width):
            a, b = i + margin, j + margin
            if first[a, b] >= 0:
                distance[i, j] = np.float32(0.0)
                nearest[i, j] = first[a, b]
                continue
            if (
                sums[a + margin + 1, b + margin + 1]
                - sums[a - margin, b + margin + 1]
                - sums[a + margin + 1, b - margin]
                + sums[a - margin, b - margin]
            ) == 0:
                continue
            x, y = np.float32(j + 0.5), np.float32(i + 0.5)
            best, which = reach, np.int32(-1)
            for ring in range(1, margin + 1):
                # No point of this ring or a later one is nearer than this.
                if best <= max(np.float32(ring - 0.5), np.float32(radius)):
                    break
                for k in range(-ring, ring + 1):
                    step = 1 if abs(k) == ring else 2 * ring
                    for m in range(-ring, ring + 1, step):
                        n = first[a + k, b + m]
                        while n >= 0:
                            across, down = uv[n, 0] - x, uv[n, 1] - y
                            d = np.sqrt(across * across + down * down)
                            if d < best:
                                best, which = d, n
                            n = following[n]
            if which >= 0:
                distance[i, j] = best
                nearest[i, j] = which


@compiled
def _close(distance: Field, radius: float, inside: Field) -> None:
    """Lower ``inside`` (H, W) to the signed distance to the outline left when discs of ``radius`` are taken back."""
    height, width = distance.shape
    window = int(np.ceil(radius + SHELL + 1))
    for i in range(height):
        for j in range(width):
            # Pixels just outside the discs know how far off the discs' edge is, to a fraction of a pixel.
            beyond = distance[i, j] - np.float32(radius)
            if not (beyond > 0 and beyond <= SHELL):
                continue
            for k in range(max(i - window, 0), min(i + window + 1, height)):
                for m in range(max(j - window, 0), min(j + window + 1, width)):
                    apart = np.sqrt(np.float32((k - i) * (k - i) + (m - j) * (m - j)))
                    inside[k, m] = min(inside[k, m], apart - beyond - np.float32(radius))
