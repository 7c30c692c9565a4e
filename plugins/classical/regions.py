"""Painted patches: pixels of the table top that do not have the table's colour."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from gvla2.perception.clusters import without_specks
from gvla2_plugins.classical.clusters import groups, join_across_views, pieces_in_views
from gvla2_plugins.classical.footprints import footprint_of
from gvla2_plugins.classical.frames import IntArray, TableFrame
from gvla2_plugins.classical.pixels import Pixels, appearance_of, choose
from gvla2_plugins.classical.solids import evenly
from gvla2_plugins.classical.things import Thing, upright_rectangle

OTHER_LOOK = 7.0  # a table pixel whose look differs by more from the table's has paint on it
ONE_PAINT = 12.0  # patches of one paint differ by less, in look
NARROW = 0.012  # metres: a thinner patch is a seam
REACH = 0.006
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
    look = appearance_of(np.vstack([frame.image[different], table[None]]) / 255.0)
    different[different] = np.linalg.norm(look[:-1] - look[-1], axis=1) > OTHER_LOOK
    return different


def find_patches(
    frames: Sequence[TableFrame],
    painted: Sequence[NDArray[np.bool_]],
    bare: Sequence[NDArray[np.bool_]],
    min_region: float,
    min_points: int,
    colour_step: float,
) -> tuple[Pixels, list[Thing]]:
    """Patches among the ``painted`` table pixels; ``bare`` ones show the table itself; one (H, W) a frame each."""
    pixels = choose(frames, [without_specks(mask) for mask in painted], on_plane=True)
    if len(pixels) == 0:
        return pixels, []
    pieces = pieces_in_views(pixels, jump=0.05, colour_step=0.5 * colour_step)
    labels = join_across_views(pixels, pieces, REACH)
    fitted = [_fit(frames, pixels, members, bare) for members in groups(labels, min_points)]
    patches: list[Thing] = []
    for patch in sorted(fitted, key=lambda p: -p.extents.prod()):
        sides, look = patch.extents[:2], np.median(pixels.look[patch.members], axis=0)
        # A piece of one that is already found, cut off by what stands on it.
        piece = any(
            whole.covers(patch.centre[None, :2])[0]
            and np.linalg.norm(look - np.median(pixels.look[whole.members], axis=0)) < ONE_PAINT
            for whole in patches
        )
        if sides.prod() >= min_region and sides.min() >= NARROW and not piece:
            patches.append(patch)
    return pixels, patches


def _fit(
    frames: Sequence[TableFrame], pixels: Pixels, members: IntArray, bare: Sequence[NDArray[np.bool_]]
) -> Thing:
    outline = footprint_of(frames, pixels, members, bare)
    (width, depth), yaw = outline.lengths, outline.yaw
    noun = "circle"
    if not outline.round:
        yaw, width, depth = upright_rectangle(yaw, width, depth)
        noun = "square" if depth > 0.85 * width else "patch"
    centre, extents = np.array([*outline.middle, 0.5 * PAINT]), np.array([width, depth, PAINT])
    return Thing(
        "region", members, pixels.points[members], centre, yaw, extents, outline.agreement, noun=noun
    )
