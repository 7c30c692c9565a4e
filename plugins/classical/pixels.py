"""Chosen pixels of all views as one list, with their neighbours in the images."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gvla2.geometry.transform import FloatArray
from gvla2.planning.colours import appearance
from gvla2_plugins.classical.frames import IntArray, TableFrame


@dataclass(frozen=True)
class Pixels:
    """N pixels: ``view``, ``row``, ``column`` (N,); ``points`` (N, 3) in the frames' frame, metres; ``rgb`` (N, 3)
    in [0, 1]; ``look`` (N, 3) colour coordinates (see ``gvla2.planning.colours``); ``maps`` one (H, W) a view, the
    pixel's place in the list or -1.
    """

    view: IntArray
    row: IntArray
    column: IntArray
    points: FloatArray
    rgb: FloatArray
    look: FloatArray
    maps: tuple[IntArray, ...]

    def __len__(self) -> int:
        return len(self.view)

    def neighbours(self, jump: float) -> IntArray:
        """(E, 2) pairs of chosen pixels that touch along a side in one image, less than ``jump`` metres apart."""
        pairs = []
        for index in self.maps:
            for one, other in ((index[:, :-1], index[:, 1:]), (index[:-1], index[1:])):
                both = (one >= 0) & (other >= 0)
                pairs.append(np.stack([one[both], other[both]], axis=1))
        touching: IntArray = np.concatenate(pairs)
        return np.asarray(touching[np.linalg.norm(np.subtract(*self.points[touching.T]), axis=1) < jump])


def choose(
    frames: Sequence[TableFrame], masks: Sequence[NDArray[np.bool_]], *, on_plane: bool = False
) -> Pixels:
    """The pixels of ``masks``, one (H, W) a frame.

    With ``on_plane`` their points are where the rays cross z = 0: the noise of the depth then has no say.
    """
    spots = [np.nonzero(mask) for mask in masks]
    starts = np.cumsum([0, *(len(rows) for rows, _ in spots)])
    maps = tuple(np.full(mask.shape, -1, dtype=np.int64) for mask in masks)
    for index, spot, start, end in zip(maps, spots, starts, starts[1:], strict=False):
        index[spot] = np.arange(start, end)
    shown = list(zip(frames, spots, strict=True))
    points = [plane_crossings(frame, at[0], at[1]) if on_plane else frame.points[at] for frame, at in shown]
    rgb = np.concatenate([frame.image[at] for frame, at in shown]) / 255.0
    view = np.repeat(np.arange(len(spots)), np.diff(starts))
    row, column = np.concatenate(spots, axis=1)
    return Pixels(view, row, column, np.concatenate(points), rgb, appearance_of(rgb), maps)


def plane_crossings(frame: TableFrame, rows: IntArray, columns: IntArray, height: float = 0.0) -> FloatArray:
    """(N, 3) points where the pixels' rays cross z = ``height`` of the frame's frame."""
    rays = frame.rays[rows, columns]
    slope = np.where(np.abs(rays[:, 2]) > 1e-6, rays[:, 2], np.nan)
    return np.asarray(frame.origin + rays * ((height - frame.origin[2]) / slope)[:, None])


def appearance_of(rgb: FloatArray) -> FloatArray:
    """``appearance`` (N, 3) of colours (N, 3), worked out once a distinct colour."""
    packed: IntArray = np.ravel_multi_index(tuple(np.rint(rgb * 255).astype(np.int64).T), (256, 256, 256))
    distinct, inverse = np.unique(packed, return_inverse=True)
    table = np.stack([distinct >> 16, (distinct >> 8) & 255, distinct & 255], axis=1) / 255.0
    return np.asarray(appearance(table)[inverse])
