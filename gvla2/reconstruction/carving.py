"""Space carving: from silhouettes to a closed, coloured surface.

The visual hull (Laurentini 1994) is the zero of a field that is metres, not a count of voxels, so that marching
cubes finds the surface far more finely than the grid is spaced.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter, label, map_coordinates
from scipy.optimize import linprog

from gvla2.errors import GeometryError
from gvla2.geometry.compiled import fused, run_chunks
from gvla2.geometry.mesh import TriangleMesh
from gvla2.geometry.transform import FloatArray
from gvla2.geometry.views import Views
from gvla2.reconstruction.appearance import vertex_colours
from gvla2.reconstruction.contracts import Reconstruction
from gvla2.reconstruction.silhouette import Silhouette, depth_maps, mask_agreement, mask_silhouettes
from gvla2.reconstruction.support import projection
from gvla2.reconstruction.surfels import surfels

_MARGIN = 0.5  # pixels around a mask's box: a mask is known to half a pixel

_DEEP = 3.0  # the field is exact within this many voxels of the surface and clipped beyond


@dataclass(frozen=True)
class Field:
    """``values`` (X, Y, Z) float32, metres inside the hull (negative outside), at origin + step * index."""

    values: NDArray[np.float32]
    origin: FloatArray
    step: float

    def points(self, index: NDArray[np.intp]) -> FloatArray:
        """(N, 3) world points of voxels (N, 3)."""
        return np.asarray(self.origin + self.step * index, dtype=np.float64)


class PackedSilhouettes(NamedTuple):
    """Silhouettes of any sizes in flat arrays, as the kernel wants them."""

    projections: FloatArray  # (S, 3, 4)
    sizes: NDArray[np.int64]  # (S, 3) width, height, first pixel
    metres: FloatArray  # (S,) size of a pixel at depth 1
    cut: NDArray[np.bool_]  # (S, 4)
    distances: NDArray[np.float32]  # all pixels


def pack(silhouettes: Sequence[Silhouette]) -> PackedSilhouettes:
    """Silhouettes for :func:`fill`."""
    starts = np.cumsum([0] + [s.distance.size for s in silhouettes])
    return PackedSilhouettes(
        np.array([projection(s.camera) for s in silhouettes]),
        np.array(
            [[*s.distance.shape[::-1], start] for s, start in zip(silhouettes, starts[:-1], strict=True)]
        ),
        np.array([2.0 / (s.camera.K[0, 0] + s.camera.K[1, 1]) for s in silhouettes]),
        np.array([s.cut for s in silhouettes]),
        np.concatenate([s.distance.ravel() for s in silhouettes]),
    )


def fill(packed: PackedSilhouettes, bounds: FloatArray, step: float) -> Field:
    """The field on a grid of spacing ``step`` (metres) that covers ``bounds`` (2, 3) with two voxels around.

    A view in which a point falls outside the image says nothing about it if the mask is cut on that side, and that
    the point is outside the object if not.
    """
    shape = np.ceil((bounds[1] - bounds[0]) / step).astype(np.int64) + 5
    origin = 0.5 * (bounds[0] + bounds[1]) - 0.5 * step * (shape - 1)
    values = np.empty(tuple(shape), dtype=np.float32)
    run_chunks(partial(_fill, values, origin, step, packed, _DEEP * step), len(values), least=16)
    # Whatever reaches the grid's end is closed there: a surface has no rim.
    for axis in range(3):
        for end in (0, -1):
            layer = np.moveaxis(values, axis, 0)[end]
            np.minimum(layer, np.float32(-0.5 * step), out=layer)
    return Field(values, origin, step)


@fused
def _fill(
    values: NDArray[np.float32],
    origin: FloatArray,
    step: float,
    packed: PackedSilhouettes,
    deep: float,
    start: int,
    stop: int,
) -> None:
    projections, sizes, metres, cut, distances = packed
    _, ny, nz = values.shape
    for i in range(start, stop):
        x = origin[0] + step * i
        for j in range(ny):
            y = origin[1] + step * j
            for k in range(nz):
                z = origin[2] + step * k
                least = deep
                seen = False
                for s in range(len(projections)):
                    P = projections[s]
                    depth = P[2, 0] * x + P[2, 1] * y + P[2, 2] * z + P[2, 3]
                    if depth <= 1e-6:
                        least = -deep
                        break
                    u = (P[0, 0] * x + P[0, 1] * y + P[0, 2] * z + P[0, 3]) / depth - 0.5
                    v = (P[1, 0] * x + P[1, 1] * y + P[1, 2] * z + P[1, 3]) / depth - 0.5
                    width, height, first = sizes[s, 0], sizes[s, 1], sizes[s, 2]
                    unknown = (
                        (u < -0.5 and cut[s, 0])
                        or (v < -0.5 and cut[s, 1])
                        or (u > width - 0.5 and cut[s, 2])
                        or (v > height - 0.5 and cut[s, 3])
                    )
                    if unknown:
                        continue
                    inside_u = min(max(u, 0.0), width - 1.0)
                    inside_v = min(max(v, 0.0), height - 1.0)
                    column, row = min(int(inside_u), width - 2), min(int(inside_v), height - 2)
                    column, row = max(column, 0), max(row, 0)
                    right, below = min(column + 1, width - 1), min(row + 1, height - 1)
                    a, b = inside_u - column, inside_v - row
                    top, bottom = first + row * width, first + below * width
                    d00, d01 = distances[top + column], distances[top + right]
                    d10, d11 = distances[bottom + column], distances[bottom + right]
                    if d00 == np.inf or d01 == np.inf or d10 == np.inf or d11 == np.inf:
                        continue
                    seen = True
                    distance = (1 - b) * ((1 - a) * d00 + a * d01) + b * ((1 - a) * d10 + a * d11)
                    distance -= abs(u - inside_u) + abs(v - inside_v)
                    least = min(least, distance * metres[s] * depth)
                    if least <= -deep:
                        least = -deep
                        break
                values[i, j, k] = least if seen else -deep


def frusta_bounds(silhouettes: Sequence[Silhouette]) -> FloatArray | None:
    """The box (2, 3) around the intersection of the masks' frusta, metres; None where they bound no such box.

    They do not meet, or leave the depth open: one view alone, or views side by side. Raises :class:`GeometryError` when
    every mask fills its whole image.
    """
    if all(s.cut.all() for s in silhouettes):
        raise GeometryError(
            "Every mask fills its whole image: nothing bounds the object. Are the masks inverted?"
        )
    status, bounds = _box(np.array([row for s in silhouettes for row in _sides(s)]))
    if status == "open":
        # A mask that is cut on a side ends there for want of anything better.
        _, bounds = _box(np.array([row for s in silhouettes for row in _sides(s, cut=True)]))
    return None if bounds is None or _too_long(bounds, silhouettes) else bounds


def _sides(s: Silhouette, cut: bool = False) -> list[FloatArray]:
    """Half-spaces (4,) with row . (x, 1) >= 0 of the mask's frustum: its sides, and the front of the camera."""
    P = projection(s.camera)
    rows = [P[2]]
    for side, (axis, sign) in enumerate(((0, 1.0), (1, 1.0), (0, -1.0), (1, -1.0))):
        if cut or not s.cut[side]:
            rows.append(sign * (P[axis] - (s.box[side] - sign * _MARGIN) * P[2]))
    return rows


def _box(rows: FloatArray) -> tuple[str, FloatArray | None]:
    """('ok', (2, 3) box) of a polytope of half-spaces (H, 4), or ('empty' | 'open', None)."""
    rows = rows / np.linalg.norm(rows[:, :3], axis=1, keepdims=True)
    box: FloatArray = np.empty((2, 3))
    for axis in range(3):
        for end, sign in enumerate((1.0, -1.0)):
            cost = np.zeros(3)
            cost[axis] = sign
            answer = linprog(cost, A_ub=-rows[:, :3], b_ub=rows[:, 3], bounds=(None, None), method="highs")
            if answer.status != 0 or answer.x is None:
                return ("open" if answer.status == 3 else "empty"), None
            box[end, axis] = float(answer.x[axis])
    return "ok", box


def _reach(s: Silhouette, depth: float) -> float:
    """Half the diagonal of the mask's box at a depth, metres."""
    size = (s.box[2:] - s.box[:2]) / np.array([s.camera.K[0, 0], s.camera.K[1, 1]])
    return 0.5 * depth * float(np.hypot(*size))


def _too_long(bounds: FloatArray, silhouettes: Sequence[Silhouette]) -> bool:
    """Whether the frusta meet so flatly that their box is far longer than anything the masks show."""
    middle = bounds.mean(axis=0)
    depths = [float(s.camera.project(middle)[1]) for s in silhouettes]
    widest = max(2 * _reach(s, max(d, 1e-6)) for s, d in zip(silhouettes, depths, strict=True))
    return float(np.linalg.norm(bounds[1] - bounds[0])) > 8 * widest


_COARSE = 40  # voxels along a side of the search for the object
_LONGEST = 4.0  # a grid is at most this many resolutions long, however thin the object
_SMALL_PART = 0.02  # parts of less than this share of the largest part must be needed by a mask
_NEEDED = 0.005  # share of a mask that a small part alone must explain to be kept
_AGREEMENT = 0.90  # below this mean IoU with the masks, one view may be speaking against the others
_GAIN = 0.08  # what dropping a view must bring


@dataclass(frozen=True)
class Carving:
    """A carved object: ``mesh`` with colours, ``normals`` (V, 3) smooth, unit and outward, ``seen`` (V,) bool.

    ``seen``: which vertices took their colour from a view; the others took their neighbours'. ``status`` is ``"ok"`` or
    what was done otherwise, and why.
    """

    mesh: TriangleMesh
    normals: FloatArray
    seen: NDArray[np.bool_]
    status: str = "ok"

    def to_reconstruction(self, count: int = 15_000) -> Reconstruction:
        """The mesh, and about ``count`` flat Gaussians on it."""
        return Reconstruction(surfels(self.mesh, self.normals, count), self.mesh, self.status)


def carve(views: Views, resolution: int = 96) -> Carving:
    """Carve the object that the views' masks show.

    The grid has about ``resolution`` cubed voxels. Views without a mask and views with an empty one are ignored; when
    the others' silhouettes have no point in common, the worst of them is dropped, again and again. The status reports
    each of these. Deterministic.

    Raises :class:`GeometryError` when no mask shows anything, when two views contradict each other or leave the
    object's depth open, and for a ``resolution`` below 8.
    """
    if resolution < 8:
        raise GeometryError(f"Carving needs a resolution of at least 8 voxels a side, got {resolution}.")
    shown, notes = mask_silhouettes(views)
    used, dropped = _agreeing(shown)
    field = without_specks(_field(used, resolution), used)
    mesh = surface_of(field)
    normals = normals_of(field, mesh.vertices)
    depths = depth_maps(mesh, [s.camera for s in used])
    colours, seen = vertex_colours(mesh, normals, used, depths, 2.0 * field.step)
    if dropped:
        notes = (f"fallback: the views disagree, so {', '.join(dropped)} was dropped", *notes)
    return Carving(replace(mesh, colours=colours), normals, seen, "; ".join(notes) or "ok")


def hull_field(views: Views, resolution: int = 96) -> Field:
    """The visual hull of the views' masks as :func:`carve` makes it, before a surface is taken."""
    used, _ = _agreeing(mask_silhouettes(views)[0])
    return _field(used, resolution)


def _agreeing(shown: tuple[Silhouette, ...]) -> tuple[tuple[Silhouette, ...], list[str]]:
    """The silhouettes that have an object in common, and the names of those that were dropped to get there."""
    dropped: list[str] = []
    used = shown
    while True:
        now = _coarse_agreement(used)
        if now >= _AGREEMENT or (now > 0 and len(used) < 4):
            return used, dropped
        names = " and ".join(f"'{s.camera.name}'" for s in used)
        if len(used) == 1:
            raise GeometryError(
                f"The view {names} alone leaves the object's depth open: carving needs two or more."
            )
        if len(used) == 2:
            raise GeometryError(
                f"The views {names} contradict each other or look the same way: nothing bounded lies in both "
                "silhouettes. Check that the masks show the same object, and the cameras' poses: are they inverted, "
                "or of another convention?"
            )
        without = [used[:i] + used[i + 1 :] for i in range(len(used))]
        scores = [_coarse_agreement(rest) for rest in without]
        best = int(np.argmax(scores))
        if now > 0 and scores[best] < now + _GAIN:
            return used, dropped
        dropped.append(f"view '{used[best].camera.name}'")
        used = without[best]


def _coarse_agreement(used: Sequence[Silhouette]) -> float:
    """Mean IoU of a coarse hull with the masks that it was carved from; 0 when there is no hull."""
    bounds, packed = frusta_bounds(used), pack(used)
    found = None if bounds is None else _tighten(packed, bounds)
    if found is None:
        return 0.0
    field = _grid(packed, found, 24)
    if not (field.values > 0).any():
        # Thinner than a coarse voxel everywhere, but there.
        return _AGREEMENT
    return mask_agreement(surface_of(field), used)


def _tighten(packed: PackedSilhouettes, bounds: FloatArray) -> FloatArray | None:
    """The box (2, 3) around all that may be inside the hull, None when nothing is."""
    for _ in range(2):
        step = float(np.cbrt(np.prod(np.maximum(bounds[1] - bounds[0], 1e-9)))) / _COARSE
        step = max(step, float((bounds[1] - bounds[0]).max()) / (_LONGEST * _COARSE))
        field = fill(packed, bounds, step)
        # The field grows at most a metre a metre: a voxel whose centre lies deeper outside holds nothing.
        index = np.argwhere(field.values > -0.9 * step)
        if len(index) == 0:
            return None
        low, high = field.points(index.min(axis=0)), field.points(index.max(axis=0))
        bounds = np.stack(
            [np.maximum(low - step, bounds[0] - step), np.minimum(high + step, bounds[1] + step)]
        )
    return bounds


def _grid(packed: PackedSilhouettes, bounds: FloatArray, resolution: int) -> Field:
    extent = bounds[1] - bounds[0]
    step = max(float(np.cbrt(np.prod(extent))) / resolution, float(extent.max()) / (_LONGEST * resolution))
    return fill(packed, bounds, step)


def _field(used: Sequence[Silhouette], resolution: int) -> Field:
    packed, region = pack(used), frusta_bounds(used)
    bounds = None if region is None else _tighten(packed, region)
    if bounds is None:
        raise GeometryError("The silhouettes have no point in common within the bounds.")
    for finer in (1, 2, 3):
        field = _grid(packed, bounds, finer * resolution)
        if (field.values > 0).any():
            return field
    raise GeometryError(
        f"The silhouettes' common part is thinner than a voxel ({1e3 * field.step:.2f} mm); "
        "raise the resolution or check the masks."
    )


def without_specks(field: Field, used: Sequence[Silhouette]) -> Field:
    """The field without small parts that no mask needs: where cones cross by chance, phantoms appear."""
    parts, count = label(field.values > 0, structure=np.ones((3, 3, 3)))
    if count <= 1:
        return field
    sizes = np.bincount(parts.ravel())[1:]
    small = np.flatnonzero(sizes < _SMALL_PART * sizes.max()) + 1
    if len(small) == 0:
        return field
    # The skin alone casts the same shadow as the whole.
    skin = (parts > 0) & (field.values < 1.5 * field.step) & ~np.isin(parts, small)
    main = field.points(np.argwhere(skin))
    unexplained = [s.inside & ~_footprint(main, s, field.step) for s in used]
    values = field.values.copy()
    for part in small:
        index = np.argwhere(parts == part)
        points = field.points(index)
        needed = any(
            (_footprint(points, s, field.step) & open_).sum() > _NEEDED * s.inside.sum()
            for s, open_ in zip(used, unexplained, strict=True)
        )
        if not needed:
            values[tuple(index.T)] = -0.5 * field.step
    return Field(values, field.origin, field.step)


def _footprint(points: FloatArray, s: Silhouette, step: float) -> NDArray[np.bool_]:
    """(H, W) bool, pixels that voxels of size ``step`` around points (N, 3) cover."""
    covered = np.zeros(s.distance.shape, dtype=np.bool_)
    uv, depth = s.camera.project(points)
    uv = uv[s.camera.inside(uv)].astype(np.intp)
    covered[uv[:, 1], uv[:, 0]] = True
    reach = int(np.ceil(0.5 * step * s.camera.K[0, 0] / max(float(depth.min()), step)))
    return np.asarray(gaussian_filter(covered.astype(np.float32), 0.5 * reach) > 1e-3) if reach else covered


def surface_of(field: Field) -> TriangleMesh:
    """The field's zero as a mesh without colours."""
    from skimage.measure import marching_cubes

    index, faces, _, _ = marching_cubes(  # type: ignore[no-untyped-call]
        field.values, 0.0, gradient_direction="ascent"
    )
    return TriangleMesh(field.points(index), faces.astype(np.int64))


def normals_of(field: Field, points: FloatArray) -> FloatArray:
    """(N, 3) smooth outward unit normals at points (N, 3) of the field's zero."""
    index = (points - field.origin) / field.step
    smooth = gaussian_filter(np.asarray(field.values, dtype=np.float32), 1.5)
    slopes = [map_coordinates(np.gradient(smooth, axis=axis), index.T, order=1) for axis in range(3)]
    normals = -np.stack(slopes, axis=1).astype(np.float64)
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    return np.where(length > 1e-12, normals / np.maximum(length, 1e-12), [0.0, 0.0, 1.0])
