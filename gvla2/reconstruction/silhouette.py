"""Silhouettes: masks as signed distances to their contours, outlines of points, depth maps of meshes, and their IoU.

A point set has no outline of its own: its discs of some radius r are drawn and the radius is taken back, which
closes the gaps between the points and leaves the outline where the outermost points are (a morphological
closing). Both steps use real-valued distances, so that the outline is right to a fraction of a pixel.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.ndimage import binary_dilation, binary_erosion, distance_transform_edt, map_coordinates

from gvla2.errors import GeometryError
from gvla2.geometry.camera import Camera
from gvla2.geometry.compiled import fused, run_chunks, run_together
from gvla2.geometry.mesh import TriangleMesh
from gvla2.geometry.raycast import draw
from gvla2.geometry.transform import FloatArray, transform_points
from gvla2.geometry.views import View, Views
from gvla2.reconstruction.support import NEAR, as_points, mask_of, projection

FEWEST_PIXELS = 4
"""A mask of fewer pixels than this is empty."""


@dataclass(frozen=True)
class Silhouette:
    """One view's mask as carving needs it.

    ``distance`` (H, W) float32: pixels from each pixel's centre to the contour, positive inside, +inf where the view
    says nothing (the robot hides the background there). ``box`` (4,): left, top, right and bottom end of the mask,
    pixels. ``cut`` (4,) bool: on which of these sides the mask reaches the image's border, so that the object may go
    on outside the image.
    """

    camera: Camera
    image: NDArray[np.uint8]
    distance: NDArray[np.float32]
    box: FloatArray
    cut: NDArray[np.bool_]

    @property
    def inside(self) -> NDArray[np.bool_]:
        """(H, W) bool, where the object is."""
        return np.asarray((self.distance > 0) & np.isfinite(self.distance))

    def sample(self, uv: FloatArray) -> FloatArray:
        """(N,) distances in pixels at pixels (N, 2), bilinear; the nearest value outside the image, NaN at NaN."""
        known = np.asarray(np.isfinite(uv).all(axis=1))
        where = np.where(known[:, None], uv - 0.5, 0.0)[:, ::-1].T
        # Where nothing is known the distance is infinite, and infinity times a weight of 0 is none.
        near = map_coordinates(np.minimum(self.distance, np.float32(1e6)), where, order=1, mode="nearest")
        return np.asarray(np.where(known, near, np.nan))


def mask_silhouettes(views: Views) -> tuple[tuple[Silhouette, ...], tuple[str, ...]]:
    """The views' silhouettes and a note for each view that has none.

    Raises :class:`GeometryError` when no view shows the object, or a mask is not a number somewhere.
    """
    found, notes = [], []
    for view in views:
        if view.mask is None:
            notes.append(f"view '{view.name}' has no mask and is ignored")
            continue
        if not np.isfinite(view.mask).all():
            raise GeometryError(f"View '{view.name}': the mask has values that are not numbers.")
        if int((view.mask > 0.5).sum()) < FEWEST_PIXELS:
            notes.append(f"the mask of view '{view.name}' is empty and the view is ignored")
            continue
        found.append(_silhouette(view, view.mask))
    if not found:
        raise GeometryError(
            f"No view shows the object: of {len(views)} views none has a mask with at least "
            f"{FEWEST_PIXELS} pixels above 0.5."
        )
    return tuple(found), tuple(notes)


def signed_distance(mask: NDArray[np.floating]) -> NDArray[np.float32]:
    """(H, W) pixels to the contour mask = 0.5, positive inside, linear in the mask near the contour.

    The whole image inside gives +inf everywhere, nothing inside -inf.
    """
    mask = np.asarray(mask, dtype=np.float32)
    inside = mask > 0.5
    if inside.all() or not inside.any():
        return np.full(mask.shape, np.inf if inside.all() else -np.inf, dtype=np.float32)
    padded = np.pad(mask, 1, mode="edge")
    down, across = np.abs(np.diff(padded[:, 1:-1], axis=0)), np.abs(np.diff(padded[1:-1], axis=1))
    steepest = np.maximum.reduce([down[:-1], down[1:], across[:, :-1], across[:, 1:]])
    contour = binary_dilation(inside) & ~binary_erosion(inside, border_value=1)
    # At a pixel beside the contour the mask's value says where between two centres the contour runs.
    own = np.clip((mask - 0.5) / np.maximum(steepest, 0.05), -1.0, 1.0)
    far, nearest = distance_transform_edt(~contour, return_indices=True)
    return np.asarray(np.where(inside, far, -far) + own[nearest[0], nearest[1]], dtype=np.float32)


def mask_iou(covered: NDArray[np.bool_], s: Silhouette) -> float:
    """Intersection over union of drawn pixels (H, W) with the mask, where the view says anything."""
    covered = covered & np.isfinite(s.distance)
    union = (covered | s.inside).sum()
    return float((covered & s.inside).sum() / union) if union else 0.0


def _silhouette(view: View, mask: NDArray[np.float32]) -> Silhouette:
    inside = mask > 0.5
    rows, columns = np.flatnonzero(inside.any(axis=1)), np.flatnonzero(inside.any(axis=0))
    box = np.array([columns[0], rows[0], columns[-1] + 1, rows[-1] + 1], dtype=np.float64)
    size = (view.camera.width, view.camera.height)
    cut = np.array([box[0] == 0, box[1] == 0, box[2] == size[0], box[3] == size[1]])
    distance = signed_distance(mask)
    if view.robot_mask is not None:
        # What the robot's own body hides is no evidence against the object.
        distance[view.robot_mask & ~inside] = np.inf
    return Silhouette(view.camera, view.image, distance, box, cut)


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


@fused
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


@fused
def _count(uv: NDArray[np.float32], width: int, height: int, counts: NDArray[np.int64]) -> None:
    for n in range(len(uv)):
        u, v = uv[n, 0], uv[n, 1]
        if u >= 0 and v >= 0 and u < width and v < height:
            counts[int(v) // _CELL, int(u) // _CELL] += 1


@fused
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


@fused
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


def depth_map(mesh: TriangleMesh, camera: Camera, farthest: bool = False) -> NDArray[np.float32]:
    """(H, W) float32 depth along the camera's z of the nearest surface at each pixel's centre, inf where none is.

    ``farthest`` takes the farthest surface instead.
    """
    size = (camera.height, camera.width)
    depth = np.full(size, 0.0 if farthest else np.inf, dtype=np.float32)
    hits = np.full(size, -1, dtype=np.int64)
    corners = transform_points(camera.camera_from_world, mesh.vertices) @ camera.K.T
    draw(np.ascontiguousarray(corners), mesh.faces, 0, depth, hits, farthest)
    return np.where(hits >= 0, depth, np.float32(np.inf))


def depth_maps(
    mesh: TriangleMesh, cameras: Sequence[Camera], farthest: bool = False
) -> list[NDArray[np.float32]]:
    """Depth maps (:func:`depth_map`) for several cameras."""
    return run_together([partial(depth_map, mesh, camera, farthest) for camera in cameras])


def mask_agreement(mesh: TriangleMesh, silhouettes: Sequence[Silhouette]) -> float:
    """Mean IoU of the mesh's silhouettes with the views' masks."""
    depths = depth_maps(mesh, [s.camera for s in silhouettes])
    return float(np.mean([mask_iou(np.isfinite(d), s) for d, s in zip(depths, silhouettes, strict=True)]))


def symmetric_iou(points: ArrayLike, views: Views, *, faces: ArrayLike | None = None) -> float:
    """Mean over the views of |S n M| / |S u M|, of silhouette S and mask M > 0.5; NaN when every mask is empty.

    Views with an empty mask are left out.
    ``points`` (N, 3) metres; with ``faces`` (F, 3) they are a mesh's vertices and its triangles are drawn, else S is
    the points' closed outline, much the same for 10 thousand and for 300 thousand points of one surface.
    Raises :class:`GeometryError` for a view without a mask, and for faces or their vertices that a mesh must not have.
    """
    found = []
    for drawn, view in zip(silhouettes(points, views, faces=faces), views, strict=True):
        mask = mask_of(view) > 0.5
        if mask.any():
            found.append((drawn & mask).sum() / (drawn | mask).sum())
    return float(np.mean(found)) if found else float("nan")


def silhouettes(
    points: ArrayLike, views: Views, *, faces: ArrayLike | None = None
) -> list[NDArray[np.bool_]]:
    """One silhouette (H, W) a view, true where the pixel's centre is covered; arguments as in :func:`symmetric_iou`."""
    array, cameras = as_points(points), [view.camera for view in views]
    if faces is None:
        outlines = run_together([partial(outline, array, camera) for camera in cameras])
        return [drawn.mask for drawn in outlines]
    mesh = TriangleMesh(array, np.asarray(faces))
    return [np.isfinite(depth) for depth in depth_maps(mesh, cameras)]
