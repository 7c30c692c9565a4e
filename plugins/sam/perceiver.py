"""The perceiver ``sam``: geometry proposes clusters, a promptable model draws their masks.

Parts of pictures in which something stands are laid out on few sheets: to encode bare table costs as much as objects.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation, distance_transform_edt

from gvla2.errors import ConfigurationError
from gvla2.geometry.views import Observation
from gvla2.perception.clicks import Prompt, Segmenter, Segments, localized
from gvla2.perception.clusters import Clusters, IntArray, MaskCandidate, clusters, fuse, iou, objects_of
from gvla2.perception.frames import BoolArray, ViewFrame, frames_of, raised
from gvla2.perception.labels import labelled
from gvla2.perception.objects import numbered, over_workspace
from gvla2.perception.options import labellers, vision_model
from gvla2.planning.scene import Box, Scene
from gvla2_plugins.sam import SamConfig
from gvla2_plugins.sam.models import Sam2Onnx

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


LEAST = 6
"""Pixels in one picture from which a cluster is asked for there."""
LEAK = 5
"""Pixels about a cluster within which its mask is believed: depth misses edges, a mask may also run along the table."""
AGREES = 0.5
"""Share of a cluster's pixels that its mask must cover."""
COVERED = 0.75
"""Share of a cluster's pixels in the mask of a larger one, over all pictures, from which it is a part of that."""

log = logging.getLogger(__name__)


class SamPerceiver:
    """Objects on a table from RGB-D views; geometry proposes, the model draws the outlines.

    Raises :class:`ConfigurationError` for options that cannot be, :class:`MissingDependencyError` without weights.
    """

    def __init__(self, config: SamConfig, segmenter: Segmenter | None = None) -> None:
        sizes = config.min_points >= 3 and config.min_height > 0 and config.threads >= 0
        if not sizes or not 0 <= config.min_score <= 1:
            raise ConfigurationError(
                "perceiver=sam: min_points must be at least 3, min_height above 0, min_score in [0, 1], threads >= 0."
            )
        self._config = config
        self._vision = vision_model(config.vision, "perceiver.localize") if config.localize else None
        self._labellers = labellers(config)
        self._segmenter = segmenter or Sam2Onnx(config.weights, dict(config.sha256), config.threads)

    def perceive(self, observation: Observation, instruction: str, workspace: Box) -> Scene:
        """The scene inside ``workspace``, objects ordered by x, then y.

        Raises :class:`PerceptionError` when no camera delivers depth, or no level plane is found. The instruction is
        used by ``localize`` alone.
        """
        config = self._config
        frames, table, notes = frames_of(observation.views, workspace)
        found = clusters(
            frames, [raised(f, table, workspace, config.min_height) for f in frames], config.min_points
        )
        answers = self._answers(frames, found)
        whole = wholes(found, answers)
        candidates = [
            each
            for number, given in enumerate(answers)
            for each in self._drawn(number, found.maps[number], whole, given)
        ]
        placed, small = objects_of(fuse(frames, candidates), frames, table, config.min_points)
        objects = numbered(over_workspace(placed, workspace))
        scene = Scene(objects, table.height_over(workspace), workspace, "sam", (*notes, *small))
        if self._vision is not None:
            scene = localized(scene, frames, self._segmenter, table, instruction, self._vision, config.vision)
        return labelled(scene, observation, self._labellers)

    def _answers(self, frames: Sequence[ViewFrame], found: Clusters) -> list[dict[int, Segments]]:
        """For each picture the answer for each cluster that is in sight there."""
        answers: list[dict[int, Segments]] = [{} for _ in frames]
        marks = [
            np.where(in_sight(clustered), clustered + number * found.count, -1)
            for number, clustered in enumerate(found.maps)
        ]
        sheets = sheets_of([frame.view.image for frame in frames], marks)
        for number, sheet in enumerate(sheets):
            log.info("perceiver=sam: sheet %d of %d", number + 1, len(sheets))
            shown = np.unique(sheet.marks[sheet.marks >= 0]).tolist()
            given = self._segmenter.encode(sheet.image).segment(
                [prompt_for(sheet.marks == mark) for mark in shown]
            )
            for i, mark in enumerate(shown):
                picture, k = divmod(mark, found.count)
                answer = Segments(given.logits[i : i + 1], given.scores[i : i + 1])
                answers[picture][k] = sheet.back(mark, answer)
        return answers

    def _drawn(
        self, number: int, clustered: IntArray, whole: Sequence[int], answers: Mapping[int, Segments]
    ) -> list[MaskCandidate]:
        """A candidate for each object that is in sight in one picture, from the answers of its clusters."""
        groups = np.where(clustered >= 0, np.asarray([*whole, -1])[clustered], -1)
        drawn: dict[int, tuple[BoolArray, float]] = {}
        for k, answer in answers.items():
            own = groups == whole[k]
            mask, score = best_mask(answer, own, (groups >= 0) & ~own)
            part = clustered == k
            if score < self._config.min_score or (mask & part).sum() < AGREES * part.sum():
                mask, score = part, self._config.min_score
            before = drawn.get(whole[k], (np.zeros_like(mask), 0.0))
            drawn[whole[k]] = (before[0] | mask, max(before[1], score))
        return [MaskCandidate(number, mask, score, seed=k) for k, (mask, score) in drawn.items()]


def in_sight(clustered: IntArray) -> BoolArray:
    """(H, W) the pixels of clusters that show enough of themselves in a picture to ask for them there."""
    counts = np.bincount(clustered[clustered >= 0])
    return np.append(counts >= LEAST, False)[clustered]  # -1 is the last


def wholes(found: Clusters, answers: Sequence[Mapping[int, Segments]]) -> list[int]:
    """For each cluster the one that it belongs to, mostly itself.

    Depth tears apart what thin struts hold together: where the masks of a larger cluster cover a smaller one, in the
    pictures that show both, the two are one object.
    """
    whole = list(range(found.count))
    for small in range(found.count):
        for large in range(small):
            covered = []
            for clustered, given in zip(found.maps, answers, strict=True):
                part = clustered == small
                if large in given and part.any():
                    own = clustered == large
                    mask, _ = best_mask(given[large], own | part, np.zeros_like(own))
                    covered.append(float((mask & part).sum() / part.sum()))
            if covered and np.mean(covered) >= COVERED:
                whole[small] = whole[large]
                break
    return whole


def prompt_for(own: BoolArray) -> Prompt:
    """A box about the pixels (H, W) and the one that lies deepest in them."""
    rows, columns = np.nonzero(own)
    depth = distance_transform_edt(np.pad(own, 1))[1:-1, 1:-1]
    row, column = np.unravel_index(int(np.argmax(depth)), own.shape)
    box = (float(columns.min()), float(rows.min()), float(columns.max() + 1), float(rows.max() + 1))
    return Prompt(np.array([[column + 0.5, row + 0.5]]), np.array([True]), box)


def best_mask(answer: Segments, own: BoolArray, others: BoolArray) -> tuple[BoolArray, float]:
    """The mask of one answer (1, C, H, W) that the model and the geometry agree on best, without leaks.

    ``own`` are the pixels that asked, ``others`` those of other clusters.
    """
    around = binary_dilation(own, np.ones((3, 3), bool), iterations=LEAK) & ~others
    masks = [np.asarray(mask & around) for mask in answer.masks()[0]]
    worth = [score + iou(mask, own) for mask, score in zip(masks, answer.scores[0], strict=True)]
    best = int(np.argmax(worth))
    return masks[best], float(answer.scores[0][best])
