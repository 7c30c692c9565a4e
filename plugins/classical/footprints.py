"""Outlines of what is flat, between its points and those seen beside it, and patches painted on the table."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation

from gvla2.perception.clusters import without_specks
from gvla2.planning.colours import appearance
from gvla2_plugins.classical import ClassicalConfig
from gvla2_plugins.classical.pixels import (
    IntArray,
    Pixels,
    TableFrame,
    choose,
    groups,
    join_across_views,
    pieces_in_views,
    plane_crossings,
)
from gvla2_plugins.classical.solids import (
    Kind,
    SeenObject,
    box_distance,
    cylinder_distance,
    evenly,
    fit_solid,
    narrow_yaw,
    solid,
)

# Metres and radians about the rectangle of the points, for a fit of one.
ROOM = np.array([0.015, 0.015, 0.1, 0.015, 0.015, 1.0, 1.0])
MOST = 700  # points of each kind


def flat_object(
    frames: Sequence[TableFrame],
    pixels: Pixels,
    members: IntArray,
    bare: Sequence[NDArray[np.bool_]],
    top: float = 0.0,
) -> SeenObject:
    """The flat object of the pixels ``members`` (N,), as a box or a cylinder from the table to ``top`` metres.

    Its outline runs between its own points and those seen beside it, half way up: ``bare`` (H, W), one a frame, are
    pixels that show what is not of it.
    """
    points = pixels.points[members]
    outside = [np.zeros((0, 3))]
    for number, (frame, mask) in enumerate(zip(frames, bare, strict=True)):
        mine = members[pixels.view[members] == number]
        if not len(mine):
            continue
        # Only around the object: a dilation of the whole picture takes longer than the fit.
        first = np.maximum(np.array([pixels.row[mine].min(), pixels.column[mine].min()]) - 2, 0)
        near = mask[first[0] : pixels.row[mine].max() + 3, first[1] : pixels.column[mine].max() + 3]
        own = np.zeros(near.shape, dtype=bool)
        own[pixels.row[mine] - first[0], pixels.column[mine] - first[1]] = True
        rows, columns = np.nonzero(binary_dilation(own, iterations=2) & near & ~own)
        outside.append(plane_crossings(frame, rows + first[0], columns + first[1], 0.5 * top))
    beside = evenly(np.concatenate(outside), MOST)
    yaw, middle, lengths = narrow_yaw(points[:, :2], trim=0.2)
    seen = evenly(points, MOST)
    # Of no height that counts: a slab and a drum from far below to far above.
    slab = np.array([*middle, yaw, *lengths, 1.0, -1.0])
    drum = np.array([*middle, lengths.mean(), 1.0, -1.0])
    may_be_round = lengths.max() < 1.2 * lengths.min()
    fits = []
    for distance, start in ((box_distance, slab), (cylinder_distance, drum))[: 1 + may_be_round]:
        room = ROOM[: len(start)]
        limits = start - room, start + room
        fitted = fit_solid(
            distance, start, seen, beside, hold=(-2, -1), limits=limits, filled=True, tolerance=0.004
        )
        fits.append(fitted)
    kind: Kind = "cylinder" if may_be_round and fits[-1].cost < 0.5 * fits[0].cost else "box"
    fit = fits[-1 if kind == "cylinder" else 0]
    return solid(kind, pixels, members, [*fit.parameters[:-2], max(top, PAINT), 0.0], fit.agreement)


OTHER_LOOK = 7.0  # a table pixel whose look differs by more from the table's has paint on it
ONE_PAINT = 12.0  # patches of one paint differ by less, in look
NARROW = 0.012  # metres: a thinner patch is a seam
REACH = 0.006
SLACK = 0.006  # metres by which a fit may make the rectangle of its points larger
PAINT = 0.001  # metres: the thickness that a painted patch is given


def unlike_table(frame: TableFrame, plane: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """(H, W) bool: pixels of ``plane`` that look different from most of them, in this view."""
    if not plane.any():
        return plane
    colours = frame.image[plane]
    bins = np.ravel_multi_index(tuple((colours >> 4).T), (16, 16, 16))
    common = colours[bins == np.bincount(bins).argmax()]
    table = np.median(evenly(common, 5000), axis=0)
    near = np.logical_and.reduce(np.abs(colours - table).T <= 16)  # the mode may straddle two bins
    table = np.median(evenly(colours[near], 5000), axis=0) if near.any() else table
    other = frame.image != np.rint(table).astype(np.uint8)
    different: NDArray[np.bool_] = plane & (other[..., 0] | other[..., 1] | other[..., 2])
    look = appearance(np.vstack([frame.image[different], table[None]]) / 255.0)
    different[different] = np.linalg.norm(look[:-1] - look[-1], axis=1) > OTHER_LOOK
    return different


def find_patches(
    frames: Sequence[TableFrame],
    painted: Sequence[NDArray[np.bool_]],
    bare: Sequence[NDArray[np.bool_]],
    config: ClassicalConfig,
) -> tuple[Pixels, list[SeenObject]]:
    """Patches among the ``painted`` table pixels; ``bare`` ones show the table itself; one (H, W) a frame each."""
    pixels = choose(frames, [without_specks(mask) for mask in painted], on_plane=True)
    if len(pixels) == 0:
        return pixels, []
    pieces = pieces_in_views(pixels, jump=0.05, colour_step=0.5 * config.colour_step)
    labels = join_across_views(pixels, pieces, REACH)
    # On wood or stone most are a seam or a knot: the slow fit is for those that may be large enough.
    large = [
        members
        for members in groups(labels, config.min_points)
        if _may_be(pixels, members, config.min_region)
    ]
    fitted = [_patch(frames, pixels, members, bare) for members in large]
    patches: list[SeenObject] = []
    for patch in sorted(fitted, key=lambda p: -p.extents.prod()):
        sides, look = patch.extents[:2], np.median(pixels.look[patch.members], axis=0)
        # A piece of one that is already found, cut off by what stands on it.
        piece = any(
            whole.covers(patch.centre[None, :2])[0]
            and np.linalg.norm(look - np.median(pixels.look[whole.members], axis=0)) < ONE_PAINT
            for whole in patches
        )
        if sides.prod() >= config.min_region and sides.min() >= NARROW and not piece:
            patches.append(patch)
    return pixels, patches


def _may_be(pixels: Pixels, members: IntArray, min_region: float) -> bool:
    """Whether a patch could have its least area and width, its outline being uncertain by a few millimetres."""
    sides = narrow_yaw(pixels.points[members, :2], trim=0.2)[2] + SLACK
    return bool(sides.prod() >= min_region and sides.min() >= NARROW)


def _patch(
    frames: Sequence[TableFrame], pixels: Pixels, members: IntArray, bare: Sequence[NDArray[np.bool_]]
) -> SeenObject:
    flat = flat_object(frames, pixels, members, bare)
    width, depth, _ = flat.extents
    noun = "circle" if flat.kind == "cylinder" else "square" if depth > 0.85 * width else "patch"
    return replace(flat, kind="region", noun=noun)
