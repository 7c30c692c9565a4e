"""Parts of pictures in which something stands, laid out on few sheets: to encode bare table costs as much as things."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gvla2.perception.clusters import IntArray
from gvla2.perception.prompting import Segments

MARGIN = 20
"""Pixels about what stands there that the model sees of its surroundings."""

Area = tuple[slice, slice]
"""Rows and columns."""


@dataclass(frozen=True)
class Tile:
    """The part ``area`` of picture number ``picture``, and where it lies on its sheet."""

    picture: int
    area: Area
    place: Area


@dataclass(frozen=True)
class Sheet:
    """A picture of tiles (H, W, 3), as large as the pictures that they are from and black between them.

    ``marks`` (H, W): of each pixel what it was marked with, -1 for nothing.
    """

    image: NDArray[np.uint8]
    marks: IntArray
    tiles: tuple[Tile, ...]

    def back(self, picture: int, answer: Segments) -> Segments:
        """An answer about the sheet (1, C, H, W) as one about a picture; nothing lies beside the picture's tiles."""
        logits = np.full_like(answer.logits, -np.inf)
        for tile in self.tiles:
            if tile.picture == picture:
                logits[..., *tile.area] = answer.logits[..., *tile.place]
        return Segments(logits, answer.scores)


def sheets_of(images: Sequence[NDArray[np.uint8]], marks: Sequence[IntArray]) -> list[Sheet]:
    """Sheets that show all marked pixels of pictures (H, W, 3), ``marks`` (H, W) >= 0, at the pictures' own scale.

    Pictures of one size share sheets; where that saves none, each that has marks is a sheet.
    """
    made: list[Sheet] = []
    for size in sorted({image.shape[:2] for image in images}):
        numbers = [n for n, image in enumerate(images) if image.shape[:2] == size and (marks[n] >= 0).any()]
        sheets = packed([(n, area) for n in numbers for area in areas(marks[n])], size)
        if len(sheets) >= len(numbers):
            everything = (slice(0, size[0]), slice(0, size[1]))
            sheets = [[Tile(n, everything, everything)] for n in numbers]
        for tiles in sheets:
            image, marked = np.zeros((*size, 3), np.uint8), np.full(size, -1)
            for tile in tiles:
                image[tile.place] = images[tile.picture][tile.area]
                marked[tile.place] = marks[tile.picture][tile.area]
            made.append(Sheet(image, marked, tuple(tiles)))
    return made


def areas(marked: IntArray) -> list[Area]:
    """The parts of a picture (H, W) about each mark, with a margin; what overlaps is one part."""
    found: list[NDArray[np.int64]] = []
    for mark in np.unique(marked[marked >= 0]):
        spots = np.argwhere(marked == mark)
        low = np.maximum(spots.min(axis=0) - MARGIN, 0)
        box = np.array([low, np.minimum(spots.max(axis=0) + 1 + MARGIN, marked.shape)])
        while near := [other for other in found if (other[0] < box[1]).all() and (box[0] < other[1]).all()]:
            found = [other for other in found if not any(other is one for one in near)]
            box = np.array(
                [
                    np.min([box[0], *(n[0] for n in near)], axis=0),
                    np.max([box[1], *(n[1] for n in near)], axis=0),
                ]
            )
        found.append(box)
    return [(slice(*box[:, 0].tolist()), slice(*box[:, 1].tolist())) for box in found]


def packed(parts: Sequence[tuple[int, Area]], size: tuple[int, int]) -> list[list[Tile]]:
    """Parts of numbered pictures laid on as few sheets (H, W) as shelves allow, the highest first."""
    sheets: list[list[Tile]] = []
    shelves: list[list[int]] = []  # of each its sheet, top, height and the width that is taken
    for picture, area in sorted(parts, key=lambda part: part[1][0].start - part[1][0].stop):
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
        sheets[on].append(Tile(picture, area, (slice(top, top + height), slice(left, left + width))))
        shelf[3] += width
    return sheets
