"""Thin layers: a board about as high as the least height that counts is one thing or paint, never some of each."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from gvla2_plugins.classical.clusters import groups, join_across_views, pieces_in_views
from gvla2_plugins.classical.frames import TableFrame
from gvla2_plugins.classical.pixels import choose

NEAR = (0.5, 2.0)  # of the least height: layers whose middle lies between these are judged as wholes
UP = 0.75  # of the least height: a layer whose middle is higher is a thing
FEWEST = 12  # pixels of a layer in one view
AS_LEVEL = 1.5  # of the table's noise, by which the pixels of a layer differ at most
STEP = 5e-4  # metres: and by this more

Masks = list[NDArray[np.bool_]]


def settle_layers(
    frames: Sequence[TableFrame],
    raised: Masks,
    paint: Masks,
    rise: float,
    noise: float,
    reach: float,
    jump: float,
    colour_step: float,
    least: int,
) -> tuple[Masks, Masks]:
    """``raised`` and ``paint``, one (H, W) a frame, with all pixels of a level layer of one paint in one of them.

    A pixel's height errs, the middle of a whole layer's does not. ``rise`` is the height from which one pixel counts
    as raised, ``noise`` the table's; ``reach`` as of ``join_across_views`` and
    ``jump`` as of ``pieces_in_views``, in metres.
    """
    pixels = choose(frames, [up | flat for up, flat in zip(raised, paint, strict=True)])
    if not len(pixels):
        return raised, paint
    pieces = pieces_in_views(pixels, jump, colour_step)
    chosen = np.zeros(len(pixels), dtype=bool)
    for members in groups(pieces, FEWEST):
        heights = pixels.points[members, 2]
        middle = float(np.median(heights))
        level = 1.4826 * float(np.median(np.abs(heights - middle))) < AS_LEVEL * noise + STEP
        chosen[members] = level and NEAR[0] * rise < middle < NEAR[1] * rise
    if not chosen.any():
        return raised, paint
    layers = choose(frames, [(at >= 0) & np.append(chosen, False)[at] for at in pixels.maps])
    labels = join_across_views(layers, pieces_in_views(layers, jump, colour_step), reach)
    up = np.zeros(len(layers) + 1, dtype=bool)
    down = up.copy()
    for members in groups(labels, least):
        side = up if np.median(layers.points[members, 2]) > UP * rise else down
        side[members] = True
    return (
        [(mask | up[at]) & ~down[at] for mask, at in zip(raised, layers.maps, strict=True)],
        [(mask | down[at]) & ~up[at] for mask, at in zip(paint, layers.maps, strict=True)],
    )
