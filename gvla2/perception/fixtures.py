"""Large known objects of which cameras see only a part: where they stand, and how far their parts are open.

The surface of a scan, turned in steps, is correlated with the seen points in a grid: what stands on it, hides it or
touches it then only adds points that the scan leaves unexplained. The best places are refined as in the gallery.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import fft
from scipy.spatial.transform import Rotation

from gvla2.geometry.compiled import compiled
from gvla2.geometry.transform import FloatArray, invert_rigid, rigid, transform_points
from gvla2.perception.articulated import MovingPart
from gvla2.perception.fitting import (
    Fit,
    SeenPoints,
    Sights,
    judged,
    mark_free,
    refined,
    visible,
)
from gvla2.perception.scans import KnownScan
from gvla2.planning.scene import PartJoint

CELL = 0.02
"""Side of a cell of the grid, metres."""
YAWS = 24
ABOVE = 0.012
"""Metres above the table from which points count: paint and the table's noise do not."""
PLACES, APART = 4, 0.05
"""Places of a scan that are refined, and the least distance between two of like turn, metres."""
MARGIN = 0.3
"""Metres around the seen points in which a scan's middle may lie."""
BEHIND = 0.03
"""A cell is free where a camera measured something at least this far behind its middle, metres."""
LEVELS = (-1, 0, 1)
"""Heights over the table that are tried, in cells: fixtures sink into tables, or stand on feet that are not drawn."""
SUNK = 0.03
"""Metres by which a fixture may reach below the table."""
FEW = 60
"""Minimum number of cells in which a scan's surface and the seen points meet."""
NEARBY = 0.02
"""Metres around a placed scan within which seen points are laid onto it."""
SPREAD = 0.008
"""One seen point is used in each cell of this side, metres: a face seen at a slant counts as much as any other."""
ROUGH, FINE = 150, 500
"""Number of these that is used to shift the scan into place, and to lay it onto them."""
BEST, KEPT, LAID = 12, 3, 6
"""Shifts of a place that cameras judge, those that are kept, and the number of all that is laid onto the points."""
THOROUGH, ROUNDS = 2, 3
"""Places that are refined further, and how often."""
HOPELESS = -8.0
"""Log-odds of a place that is not refined further."""
LOOKED_THROUGH = 2.0
"""How much worse it is that a surface is not there than that a seen point is left unexplained."""
STEPS = 9
"""Positions of a joint that are tried, and again between the neighbours of the best."""
OPENED = 400
"""Number of a part's points that tell how far it is open."""
OPEN_BY = 0.05
"""A part is open only where that explains more of its surface, by this share of what is seen of it."""


@dataclass(frozen=True)
class SeenGrid:
    """Cells from ``low`` (3,) on; ``seen`` are the transforms of what each is, by height: see :func:`seen_grid`.
    ``points`` (N, 3) are the seen ones, one in each cell of :data:`SPREAD`.
    """

    points: FloatArray
    low: FloatArray
    size: tuple[int, int]
    seen: NDArray[np.complex64]


def likely_places(scan: KnownScan, grid: SeenGrid, table: float) -> list[FloatArray]:
    """Poses (4, 4) of an upright scan on the table whose surface meets most occupied cells and fewest free ones."""
    floor = float(scan.points[:, 2].min())
    found: list[tuple[float, float, FloatArray]] = []
    for yaw in 2 * np.pi * np.arange(YAWS) / YAWS:
        counts = _correlated(grid, scan.points, float(yaw), floor)  # (H, R, C)
        for at in np.argpartition(counts, -PLACES, axis=None)[-PLACES:]:
            rise, row, column = np.unravel_index(at, counts.shape)
            height = table - floor + CELL * LEVELS[rise]
            spot = np.array([*(grid.low[:2] + CELL * np.array([row, column])), height])
            found.append((float(counts[rise, row, column]), float(yaw), spot))
    found.sort(key=lambda each: -each[0])
    kept: list[tuple[float, FloatArray]] = []
    for count, yaw, spot in found:
        if count < FEW or len(kept) == PLACES:
            break
        near = [
            np.linalg.norm(spot - other) < APART and np.cos(yaw - turned) > np.cos(1.6 * 2 * np.pi / YAWS)
            for turned, other in kept
        ]
        if not any(near):
            kept.append((yaw, spot))
    return [rigid(Rotation.from_euler("z", yaw).as_matrix(), spot) for yaw, spot in kept]


def seen_grid(points: FloatArray, sights: Sights, table: float) -> SeenGrid | None:
    """The cells around points (N, 3), world metres: 1 where some of them are, -1 where a camera looked through; None
    where nothing stands on the table.
    """
    up = points[points[:, 2] > table + ABOVE]
    if len(up) < FEW:
        return None
    low = np.array([*(up[:, :2].min(axis=0) - MARGIN), table])
    cells = ((up - low) / CELL).astype(int)
    rows, columns = (
        int(fft.next_fast_len(int(n), real=True)) for n in cells[:, :2].max(axis=0) + MARGIN / CELL + 1
    )
    size = (int(cells[:, 2].max()) + 2, rows, columns)
    state = np.zeros(size, dtype=np.float32)
    for sight in sights:
        mark_free(state, low, CELL, sight.lens, sight.depth, BEHIND)
    state[cells[:, 2], cells[:, 0], cells[:, 1]] = 1.0
    return SeenGrid(spread(points), low, (rows, columns), fft.rfft2(state))


def spread(points: FloatArray) -> FloatArray:
    """One of points (N, 3) in each cell of :data:`SPREAD`."""
    cells = ((points - points.min(axis=0)) / SPREAD).astype(np.int64)
    return points[
        np.unique(np.ravel_multi_index(tuple(cells.T), tuple(cells.max(axis=0) + 1)), return_index=True)[1]
    ]


def _correlated(grid: SeenGrid, points: FloatArray, yaw: float, floor: float) -> NDArray[np.float32]:
    """(H, R, C) sum of the cells that a surface's points (M, 3), turned by ``yaw`` radians, meet when their origin is
    moved to each cell and their lowest, at ``floor`` metres, to each of :data:`LEVELS`.
    """
    height = min(len(grid.seen), int((points[:, 2].max() - floor) / CELL) + 1)
    surface = np.zeros((height, *grid.size), dtype=np.float32)
    _fill(surface, points, np.cos(yaw), np.sin(yaw), floor)
    turned = fft.rfft2(surface, overwrite_x=True)
    products = np.zeros((len(LEVELS), *turned.shape[1:]), dtype=np.complex64)
    for rise, product in zip(LEVELS, products, strict=True):
        _add_products(grid.seen, turned, rise, product)
    return np.asarray(fft.irfft2(products, s=grid.size, overwrite_x=True))


@compiled
def _fill(surface: NDArray[np.float32], points: FloatArray, cos: float, sin: float, floor: float) -> None:
    """Set the cells (H, R, C) that turned points (M, 3) above the table meet, those before the origin from behind."""
    height, rows, columns = surface.shape
    for n in range(len(points)):
        up = points[n, 2] - floor
        level = int(up / CELL)
        if up > ABOVE and level < height:
            row = int(np.floor((cos * points[n, 0] - sin * points[n, 1]) / CELL))
            column = int(np.floor((sin * points[n, 0] + cos * points[n, 1]) / CELL))
            surface[level, row % rows, column % columns] = 1.0


@compiled
def _add_products(
    seen: NDArray[np.complex64], turned: NDArray[np.complex64], rise: int, product: NDArray[np.complex64]
) -> None:
    """Add to ``product`` (R, C) the correlation, over heights, of transforms (H, R, C) and (H', R, C), the second one
    raised by ``rise`` cells.
    """
    _, rows, columns = seen.shape
    for level in range(max(0, rise), min(len(seen), len(turned) + rise)):
        for row in range(rows):
            for column in range(columns):
                product[row, column] += (
                    seen[level, row, column] * turned[level - rise, row, column].conjugate()
                )


def upright(pose: FloatArray) -> FloatArray:
    """The pose (4, 4) without tilt."""
    turn = pose[:3, :3]
    yaw = float(np.arctan2(turn[1, 0] - turn[0, 1], turn[0, 0] + turn[1, 1]))
    return rigid(Rotation.from_euler("z", yaw).as_matrix(), pose[:3, 3])


def motion_of(joint: PartJoint, by: float) -> FloatArray:
    """(4, 4) the motion of a part by ``by`` metres or radians on its joint."""
    if joint.slides:
        return rigid(translation=by * joint.axis)
    turn = Rotation.from_rotvec(by * joint.axis).as_matrix()
    return rigid(turn, joint.origin - turn @ joint.origin)


def moved_scan(scan: KnownScan, number: int, position: float) -> KnownScan:
    """The scan with its joint ``number`` at another position."""
    link, own = scan.links[number], scan.owners == number
    motion = motion_of(link.joint, position - link.joint.position)
    points, normals, links = scan.points.copy(), scan.normals.copy(), list(scan.links)
    points[own] = transform_points(motion, points[own])
    normals[own] = normals[own] @ motion[:3, :3].T
    links[number] = replace(link, joint=replace(link.joint, position=position))
    return replace(scan, points=points, normals=normals, links=tuple(links))


def opened(scan: KnownScan, seen: SeenPoints, pose: FloatArray) -> KnownScan:
    """The scan, placed by ``pose`` (4, 4), with each joint where its part explains most of what cameras measured.

    A part is closed unless it is clearly seen elsewhere: what is hidden stays as it is in the file.
    """
    for number, link in enumerate(scan.links):
        own = np.flatnonzero(scan.owners == number)
        own = own[:: max(1, len(own) // OPENED)]
        step = link.joint.reach / (STEPS - 1)

        def score(
            position: float,
            points: FloatArray = scan.points[own],
            normals: FloatArray = scan.normals[own],
            joint: PartJoint = link.joint,
        ) -> float:
            moved = pose @ motion_of(joint, position - joint.position)
            shown, through, _ = visible(points, normals, moved, seen)
            return shown - LOOKED_THROUGH * through

        best = max(np.linspace(0.0, link.joint.reach, STEPS), key=score)
        best = max(np.linspace(max(0.0, best - step), min(link.joint.reach, best + step), STEPS), key=score)
        if best != link.joint.position and score(float(best)) > score(0.0) + OPEN_BY * len(own):
            scan = moved_scan(scan, number, float(best))
    return scan


def in_world(joint: PartJoint, pose: FloatArray) -> PartJoint:
    """A scan's joint in the world, the scan placed by ``pose`` (4, 4)."""
    return replace(joint, axis=pose[:3, :3] @ joint.axis, origin=transform_points(pose, joint.origin))


def moving_parts(scan: KnownScan, pose: FloatArray) -> list[MovingPart]:
    """The parts of a scan placed by ``pose`` (4, 4), in the world."""
    return [
        MovingPart(
            link.name, transform_points(pose, scan.points[scan.owners == number]), in_world(link.joint, pose)
        )
        for number, link in enumerate(scan.links)
    ]


def find_large(scan: KnownScan, grid: SeenGrid, sights: Sights, table: float) -> Fit | None:
    """The best fit of a scan that stands upright on the table among what is seen, of which others may hide it; None
    where its surface hardly meets any of it.
    """
    points, skin = grid.points, scan.skin
    starts = [_starts(skin, points, sights, table, pose) for pose in likely_places(skin, grid, table)]
    likely = sorted((each for place in starts for each in place), key=lambda each: each[0])
    # What stands open fits badly until it is opened: of a scan with joints the best of each place is followed.
    rivals = starts if skin.links else [[each] for each in likely[:LAID]]
    laid = [[_laid(skin, points, sights, table, pose) for _, pose in place] for place in rivals]
    places = [max(filter(None, place), key=lambda each: each[0], default=None) for place in laid]
    found = [each for each in places if each is not None and each[1].odds > HOPELESS]
    found = sorted(found, key=lambda each: -each[0])[: PLACES if skin.links else THOROUGH]
    for number in range(len(found)):
        for _ in range(ROUNDS):
            fit = found[number][1]
            poses = [fit.world_from_scan]
            if any(link.joint.position for link in fit.scan.links):  # it was placed as if it were closed
                poses += [pose for _, pose in _starts(fit.scan, points, sights, table, fit.world_from_scan)]
            laid_again = [_laid(fit.scan, points, sights, table, pose, joints=True) for pose in poses]
            again = max(filter(None, laid_again), key=lambda each: each[0], default=None)
            if again is None or again[0] <= found[number][0]:
                break
            found[number] = again
    if not found:
        return None
    _, best = max(found, key=lambda each: each[0])
    for number, link in enumerate(best.scan.links):
        if link.joint.position != scan.links[number].joint.position:
            scan = moved_scan(scan, number, link.joint.position)
    return replace(best, scan=scan)


def _starts(
    scan: KnownScan, points: FloatArray, sights: Sights, table: float, pose: FloatArray
) -> list[tuple[float, FloatArray]]:
    """The pose (4, 4), moved within its cell and turned within its step to where the seen points near it lie nearest
    and least of the surface was looked through: the best few, each with how badly it fits. Closest points alone stop
    where two of three faces fit, or at the wrong one of two layers.
    """
    near = points[scan.nearest.query(transform_points(invert_rigid(pose), points))[0] < NEARBY + CELL]
    if len(near) < FEW:
        return []
    near = near[:: max(1, len(near) // ROUGH)]
    some = slice(None, None, max(1, len(scan.points) // ROUGH))
    sides, turns = CELL * np.linspace(-1.0, 1.0, 5), (2 * np.pi / YAWS) * np.linspace(-0.5, 0.5, 5)
    shifts = np.stack(np.meshgrid(sides, sides, sides[1:-1]), axis=-1).reshape(-1, 3)
    turned = Rotation.from_euler("z", turns[:, None]).as_matrix() @ pose[:3, :3]
    turned, shifts = turned.repeat(len(shifts), axis=0), np.tile(pose[:3, 3] + shifts, (len(turns), 1))
    gaps = scan.nearest.mean_distances(near, turned, shifts, NEARBY)
    seen = _seen(near, sights, table)
    tried = []
    for k in np.argsort(gaps, kind="stable")[:BEST]:
        start = rigid(turned[k], shifts[k])
        shown, through, _ = visible(scan.points[some], scan.normals[some], start, seen)
        tried.append((float(gaps[k]) + NEARBY * through / max(1, shown + through), start))
    return sorted(tried, key=lambda each: each[0])[:KEPT]


def _seen(points: FloatArray, sights: Sights, table: float) -> SeenPoints:
    """The seen points (N, 3) near a place; their looks are not asked for."""
    return SeenPoints(points, np.full(points.shape, np.nan), sights, table - SUNK)


def _laid(
    scan: KnownScan,
    points: FloatArray,
    sights: Sights,
    table: float,
    pose: FloatArray,
    *,
    joints: bool = False,
) -> tuple[float, Fit] | None:
    """The scan laid onto the seen points near it, and how much of what is seen it explains, in cells, less what cameras
    looked through; with ``joints``, opened as it is seen to be.
    """
    near = points[scan.nearest.query(transform_points(invert_rigid(pose), points))[0] < NEARBY]
    if len(near) < FEW:
        return None
    seen = _seen(near, sights, table)
    pose = upright(refined(scan, seen, pose, fine=FINE))
    if joints:
        scan = opened(scan, seen, pose)
    fit = judged(scan, seen, pose)
    return fit.support - LOOKED_THROUGH * fit.through * len(near), fit
