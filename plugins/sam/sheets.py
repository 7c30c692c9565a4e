"""Parts of pictures in which something stands, laid out on few sheets: to encode bare table costs as much as things."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gvla2.perception.clusters import IntArray
from gvla2.perception.frames import BoolArray
from gvla2.perception.prompting import Segments

MARGIN = 0.055
"""Share of a picture's sides, about what stands there, that the model sees of its surroundings."""

Area = tuple[slice, slice]
"""Rows and columns."""


@dataclass(frozen=True)
class Tile:
    """The part ``area`` of picture number ``picture`` about what has the mark ``mark``, and its place on a sheet."""

    mark: int
    picture: int
    area: Area
    place: Area


@dataclass(frozen=True)
class TileSheet:
    """A picture of tiles (H, W, 3), as large as the pictures that they are from and black between them.

    ``marks`` (H, W): of each pixel the mark, each in its own tile, -1 for nothing.
    """

    image: NDArray[np.uint8]
    marks: IntArray
    tiles: tuple[Tile, ...]

    def back(self, mark: int, answer: Segments) -> Segments:
        """An answer about a mark on the sheet (1, C, H, W) as one about its picture; nothing lies beside the tile."""
        logits = np.full_like(answer.logits, -np.inf)
        tile = next(tile for tile in self.tiles if tile.mark == mark)
        logits[..., *tile.area] = answer.logits[..., *tile.place]
        return Segments(logits, answer.scores)


def sheets_of(images: Sequence[NDArray[np.uint8]], marks: Sequence[IntArray]) -> list[TileSheet]:
    """Sheets that show what is marked in pictures (H, W, 3), ``marks`` (H, W) >= 0, at the pictures' own scale.

    Each mark is of one picture. Pictures of one size share sheets; where that saves none, each that has marks is one.
    """
    made: list[TileSheet] = []
    for size in sorted({image.shape[:2] for image in images}):
        numbers = [n for n, image in enumerate(images) if image.shape[:2] == size and (marks[n] >= 0).any()]
        own = [(int(mark), n) for n in numbers for mark in np.unique(marks[n][marks[n] >= 0])]
        sheets = packed([(mark, n, about(marks[n] == mark)) for mark, n in own], size)
        if len(sheets) >= len(numbers):
            everything = (slice(0, size[0]), slice(0, size[1]))
            sheets = [[Tile(mark, n, everything, everything) for mark, n in own if n == m] for m in numbers]
        for tiles in sheets:
            image, marked = np.zeros((*size, 3), np.uint8), np.full(size, -1)
            for tile in tiles:
                image[tile.place] = images[tile.picture][tile.area]
                marked[tile.place][marks[tile.picture][tile.area] == tile.mark] = tile.mark
            made.append(TileSheet(image, marked, tuple(tiles)))
    return made


def about(own: BoolArray) -> Area:
    """The part of a picture (H, W) about some of its pixels, with a margin."""
    spots = np.argwhere(own)
    margin = np.round(MARGIN * np.array(own.shape)).astype(int)
    low = np.maximum(spots.min(axis=0) - margin, 0)
    high = np.minimum(spots.max(axis=0) + 1 + margin, own.shape)
    return slice(int(low[0]), int(high[0])), slice(int(low[1]), int(high[1]))


def packed(parts: Sequence[tuple[int, int, Area]], size: tuple[int, int]) -> list[list[Tile]]:
    """Marks with their pictures and parts, laid on as few sheets (H, W) as shelves allow, the highest first."""
    sheets: list[list[Tile]] = []
    shelves: list[list[int]] = []  # of each its sheet, top, height and the width that is taken
    for mark, picture, area in sorted(parts, key=lambda part: part[2][0].start - part[2][0].stop):
        height, width = (side.stop - side.start for side in area)
        shelf = next((s for s in shelves if height <= s[2] and s[3] + width <= size[1]), None)
        if shelf is None:
            bottoms = [max(t.place[0].stop for t in tiles) for tiles in sheets]
            on = next((n for n, bottom in enumerate(bottoms) if bottom + height <= size[0]), len(sheets))
            if on == len(sheets):
                sheets.append([])
            shelf = [on, bottoms[on] if on < len(bottoms) else 0, height, 0]
            shelves.append(shelf)
        on, top, _, left = shelf
        sheets[on].append(Tile(mark, picture, area, (slice(top, top + height), slice(left, left + width))))
        shelf[3] += width
    return sheets
