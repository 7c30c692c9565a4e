"""Bodies: what hangs together in three dimensions above the table, whatever its colours.

Within an image neighbourhood is exact, however far apart the points of a steep face lie; across views, points that
lie on one another are of one body. What a body is painted like decides nothing here.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from gvla2_plugins.classical.clusters import components, join_across_views
from gvla2_plugins.classical.frames import IntArray, TableFrame, seen_through
from gvla2_plugins.classical.pixels import Pixels

FRAGMENT = 0.3  # of a body's points: what is smaller, near, and not seen to be apart, is a piece of it
NEAR, HIDDEN = 0.02, 0.05  # metres between a body and its fragment; the latter where nothing else carries it
APART = 0.006  # metres behind a gap's middle where free space tells two bodies apart
HANGING = 0.01  # metres above the table: a fragment that is no lower rests on its body
SAME_PAINT = 2.5  # neighbouring pixels of one paint differ by less, in look, where pictures have no noise
TEXTURED = 0.13  # share of neighbours that differ by more, from which paint tells no parts; drawn: < .09
FEWEST = 100  # pairs of neighbours that tell how a body is painted


def bodies_of(
    frames: Sequence[TableFrame], pixels: Pixels, jump: float, reach: float, least: int
) -> IntArray:
    """(N,) body of each pixel, -1 for specks: neighbours in an image within ``jump`` metres of one another, and
    points of different views within ``reach``.
    """
    pieces = components(len(pixels), pixels.neighbours(jump))
    labels = join_across_views(pixels, pieces, reach, looks=False)
    return _with_fragments(frames, pixels, labels, least)


def _with_fragments(frames: Sequence[TableFrame], pixels: Pixels, labels: IntArray, least: int) -> IntArray:
    """Fragments given to the body beside them, where no camera saw through the gap; small ones left are specks."""
    labels = labels.copy()
    sizes = np.bincount(labels[labels >= 0], minlength=1)
    order = np.argsort(sizes)
    for k in order:
        mine = np.nonzero(labels == k)[0]
        if not len(mine):
            continue
        rest = np.nonzero((labels >= 0) & (labels != k))[0]
        rest = rest[sizes[labels[rest]] * FRAGMENT > len(mine)] if len(rest) else rest
        low, high = pixels.points[mine].min(axis=0) - HIDDEN, pixels.points[mine].max(axis=0) + HIDDEN
        at = pixels.points[rest]
        rest = rest[((at > low) & (at < high)).all(axis=1)]
        if len(rest):
            distance, nearest = map(np.asarray, cKDTree(pixels.points[rest]).query(pixels.points[mine]))
            closest = np.argsort(distance)[:5]
            one, other = pixels.points[mine[closest]], pixels.points[rest[nearest[closest]]]
            gap = np.concatenate([one + share * (other - one) for share in (0.3, 0.5, 0.7)])
            hangs = pixels.points[mine, 2].min() > HANGING
            apart = seen_through(frames, gap, APART).any()
            if distance.min() < (HIDDEN if hangs else NEAR) and (hangs or not apart):
                host = labels[rest[nearest[closest[0]]]]
                labels[mine] = host
                sizes[host] += len(mine)
                continue
        if len(mine) < least:
            labels[mine] = -1
    return labels


def textured(pixels: Pixels, labels: IntArray, jump: float, noise: float) -> NDArray[np.bool_]:
    """(B,) bool by label: bodies of whose neighbouring pixels many differ in look by more than ``noise`` explains.

    ``noise`` is what neighbouring pixels of one paint differ by, in colour from 0 to 1.
    """
    pairs = pixels.neighbours(jump)
    one, other = pairs[(np.diff(labels[pairs], axis=1) == 0)[:, 0] & (labels[pairs[:, 0]] >= 0)].T
    differ = np.linalg.norm(pixels.look[one] - pixels.look[other], axis=1) > SAME_PAINT
    # In the dark a little noise is much of hue.
    differ &= np.linalg.norm(pixels.rgb[one] - pixels.rgb[other], axis=1) > 3.0 * noise
    count = int(labels.max(initial=-1)) + 1
    pairs_of = np.bincount(labels[one], minlength=count)
    share = np.bincount(labels[one], differ, minlength=count) / np.maximum(1, pairs_of)
    return np.asarray((share > TEXTURED) & (pairs_of >= FEWEST))
