"""From pixels above the table to things: first within each image, then across the views.

Within an image neighbourhood is exact, however far apart the points of a steep face lie; across views, pieces of
like colour that lie on one another are the same thing.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_closing, binary_dilation, binary_fill_holes, distance_transform_edt
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from gvla2.geometry.transform import FloatArray
from gvla2.planning.colours import LIGHTNESS_WEIGHT
from gvla2_plugins.classical.frames import IntArray, TableFrame
from gvla2_plugins.classical.pixels import Pixels, appearance_of

LIKE = 14.0  # hues of pieces of one thing differ by less
SHADED = 0.62  # L* + 16 of a thing's darkest face, over that of its lightest, is more
LEAST = 3  # pixels of a piece; fewer are specks
DEEP = 3  # pixels that a mask grows down
MOST = 9000  # points that are searched for neighbours across views


def pieces_in_views(pixels: Pixels, jump: float, colour_step: float) -> IntArray:
    """(N,) piece of each pixel: connected within its image, without a jump of depth or colour."""
    pairs = pixels.neighbours(jump)
    change = np.linalg.norm(pixels.look[pairs[:, 0]] - pixels.look[pairs[:, 1]], axis=1)
    return components(len(pixels), pairs[change < colour_step])


def join_across_views(pixels: Pixels, pieces: IntArray, reach: float, *, looks: bool = True) -> IntArray:
    """(N,) thing of each pixel, -1 for specks: pieces of several views whose points lie within ``reach`` metres of
    one another, and that look alike, unless ``looks`` are to have no say.
    """
    sizes = np.bincount(pieces)
    keep = np.nonzero(sizes[pieces] >= LEAST)[0]
    if len(keep) == 0:
        return np.full(len(pixels), -1, dtype=np.int64)
    sample = keep[:: max(1, -(-len(keep) // MOST))]
    sampled = np.bincount(pieces[sample], minlength=len(sizes))
    pairs = cKDTree(pixels.points[sample]).query_pairs(reach, output_type="ndarray")
    a, b = sample[pairs[:, 0]], sample[pairs[:, 1]]
    across = (pieces[a] != pieces[b]) & (pixels.view[a] != pixels.view[b])
    a, b = a[across], b[across]
    # A vote is a point of one piece with some neighbour in the other, counted once.
    count = len(sizes)
    votes = np.unique(np.concatenate([a * count + pieces[b], b * count + pieces[a]]))
    keys, counts = np.unique(pieces[votes // count] * count + votes % count, return_counts=True)
    keys = np.stack([keys // count, keys % count], axis=1)
    small = np.minimum(sampled[keys[:, 0]], sampled[keys[:, 1]])
    like = np.ones(len(keys), dtype=bool)
    if looks:
        own = piece_looks(pixels, pieces)
        like = alike(own[keys[:, 0]], own[keys[:, 1]])
    joined = keys[like & (counts >= np.maximum(2, (0.12 if looks else 0.08) * small))]
    things = components(len(sizes), joined)[pieces]
    things[sizes[pieces] < LEAST] = -1
    return things


def join_in_bodies(pixels: Pixels, things: IntArray, bodies: IntArray) -> IntArray:
    """(N,) things (N,) of one body (N,) and one paint made one, the larger ones' names kept.

    Noise at rims tears the two sides of a wall apart: no image shows them as neighbours.
    """
    named = things.copy()
    leaders: list[tuple[int, int, FloatArray]] = []  # body, thing, look
    order = np.argsort(-np.bincount(things[things >= 0], minlength=1), kind="stable")
    for k in order:
        mine = np.nonzero(things == k)[0]
        own = bodies[mine][bodies[mine] >= 0]
        if not len(own):
            continue
        body, look = int(np.bincount(own).argmax()), np.median(pixels.look[mine], axis=0)
        leader = next((t for b, t, other in leaders if b == body and alike(look, other)), -1)
        if leader < 0:
            leaders.append((body, int(k), look))
        else:
            named[mine] = leader
    return named


def piece_looks(pixels: Pixels, pieces: IntArray) -> FloatArray:
    """(P, 3) mean look of each piece."""
    sizes = np.maximum(1, np.bincount(pieces))
    return np.stack([np.bincount(pieces, weights=pixels.look[:, k]) / sizes for k in range(3)], axis=1)


def alike(one: FloatArray, other: FloatArray) -> NDArray[np.bool_]:
    """(...,) bool: looks (..., 3) that light alone may tell apart: one hue, lightness within what slope can do."""
    hue = np.linalg.norm(one[..., :2] - other[..., :2], axis=-1)
    lightness = [look[..., 2] / LIGHTNESS_WEIGHT + 16.0 for look in (one, other)]
    return np.asarray((hue < LIKE) & (np.minimum(*lightness) > SHADED * np.maximum(*lightness)))


def grow_down(
    frames: Sequence[TableFrame],
    masks: Sequence[NDArray[np.bool_]],
    low: Sequence[NDArray[np.bool_]],
    different: Sequence[NDArray[np.bool_]],
    colour_step: float,
) -> list[NDArray[np.bool_]]:
    """The masks (H, W) with the lowest pixels of each thing, which lie too near to the table to be told by height.

    A pixel of ``low`` that looks ``different`` from the table joins a mask at most :data:`DEEP` pixels off, where it
    looks like the nearest pixel there: paint beside a thing is left alone.
    """
    grown = []
    for frame, mask, near, other in zip(frames, masks, low, different, strict=True):
        # What looks unlike the table inside a raised rim is the floor of a plate or a bowl.
        current = mask | (binary_fill_holes(binary_closing(mask)) & near & other)
        fresh = binary_dilation(current, iterations=DEEP, mask=current | (near & other)) & ~current
        nearest = distance_transform_edt(~current, return_distances=False, return_indices=True)
        looks = [appearance_of(frame.image[at] / 255.0) for at in (fresh, tuple(nearest[:, fresh]))]
        fresh[fresh] = np.linalg.norm(looks[0] - looks[1], axis=1) < 0.5 * colour_step
        grown.append(current | fresh)
    return grown


def components(count: int, pairs: IntArray) -> IntArray:
    """(count,) the connected component of each node, given edges (E, 2)."""
    graph = coo_matrix((np.ones(len(pairs), dtype=np.int8), (pairs[:, 0], pairs[:, 1])), shape=(count, count))
    return np.asarray(connected_components(graph, directed=False)[1], dtype=np.int64)


def groups(labels: IntArray, least: int) -> list[IntArray]:
    """The indices of each label in (N,), -1 for none, that at least ``least`` have."""
    members = (np.nonzero(labels == k)[0] for k in np.unique(labels[labels >= 0]))
    return [one for one in members if len(one) >= least]
