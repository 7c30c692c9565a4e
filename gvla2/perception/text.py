"""Names from the text on packages, read in the cameras' own pictures by RapidOCR."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from gvla2.errors import MissingDependencyError
from gvla2.geometry.transform import FloatArray
from gvla2.geometry.views import Observation, View
from gvla2.perception.labels import Naming, crop_of
from gvla2.planning.scene import PRINTED, Scene, SceneObject

CROP = 480
"""Pixels of the longer side that an object's crop is enlarged to: letters of a name are then 30 to 100 pixels high."""
ENLARGED = 10.0
"""Largest factor of that: what is smaller has no letters."""
LEAST = 12
"""Pixels of a crop's shorter side below which nothing can be read on it."""
TURNS = 4
"""Quarter turns in which a crop is read."""
SURE = 0.8
"""Least score of a line of text that is believed: below it the words are mostly misread."""
SHORTEST = 3
"""Letters of a word that names something."""
MOST_WORDS = 8
IN_A_LINE = 2
"""A line of more words than this says something about the object ("just add milk"): it is not its name."""
MARGIN = 0.1
"""Margin of a crop as a share of its longer side: letters at its edge are not found."""
NAME = 0.5
"""Letters lower than this share of the highest ones on an object say something about it, not its name."""
NEAR = 0.012
"""Metres from an object's box within which a pixel is the object's."""


@dataclass(frozen=True)
class _Line:
    """A line of text that was read, its score in [0, 1], its corners (4, 2) in the crop, around it, and the height of
    its letters, metres.
    """

    text: str
    score: float
    corners: FloatArray
    height: float = 0.0

    def covers(self, other: _Line) -> bool:
        """Whether the middle of another line lies in it."""
        middle = other.corners.mean(axis=0) - self.corners[0]
        sides = self.corners[[1, 3]] - self.corners[0]
        return all(0 <= side @ middle <= side @ side for side in sides)


class TextReader:
    """A :class:`~gvla2.perception.labels.Labeller` whose names are the words that are read on an object.

    Crops of each object are enlarged, stretched in brightness, and read in four turns. Where a simulator has finer
    pictures (:attr:`Observation.finer`) those are read. A line counts where the object itself is seen at its middle.
    Raises :class:`MissingDependencyError` without RapidOCR.
    """

    source = PRINTED

    def __init__(self) -> None:
        self._read = _engine()

    def names(self, objects: Sequence[SceneObject], scene: Scene, observation: Observation) -> list[Naming]:
        """One answer per object: its words as one label, as sure as its surest line."""
        found: list[list[_Line]] = [[] for _ in objects]
        for view in observation.views:
            if view.depth is not None:
                shown, points = observation.shown(view), view.points()
                for obj, lines in zip(objects, found, strict=True):
                    lines += self._lines(obj, shown, points)
        return list(map(_naming, objects, found))

    def _lines(self, obj: SceneObject, view: View, points: FloatArray) -> Iterator[_Line]:
        """The lines of text on an object in a picture; ``points`` (H, W, 3) is what its camera sees, in the world."""
        corner, crop, _ = crop_of(view, obj, MARGIN)
        if min(crop.shape[:2]) < LEAST:
            return
        factor = min(CROP / max(crop.shape[:2]), ENLARGED)
        size = round(factor * crop.shape[1]), round(factor * crop.shape[0])
        image = np.asarray(Image.fromarray(_stretched(crop)).resize(size, Image.Resampling.BICUBIC))
        lines: list[_Line] = []
        for turn in range(TURNS):
            read = self._read(np.ascontiguousarray(np.rot90(image, turn)[..., ::-1]))
            for box, text, score in zip(read.boxes, read.txts, read.scores, strict=True) if read.txts else ():
                corners = np.array([_turned_back(at, turn, size) for at in np.asarray(box)]) / factor
                if score >= SURE:
                    lines.append(_Line(text, float(score), corners))
        for line in _best(lines):
            u, v = ((corner + line.corners.mean(axis=0)) * points.shape[1] / view.camera.width).astype(int)
            point = points[min(v, points.shape[0] - 1), min(u, points.shape[1] - 1)]
            if np.isfinite(point).all() and obj.distances(point) <= NEAR:
                away = float(np.linalg.norm(point - view.camera.position))
                sides = np.linalg.norm(line.corners[[1, 3]] - line.corners[0], axis=1)
                yield replace(line, height=away * float(sides.min()) / view.camera.K[1, 1])


def words_in(text: str) -> list[str]:
    """The words of a line, in lower case, without numbers, signs and letters of other alphabets."""
    split = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", text)
    return [word for word in re.findall(r"[a-z]+", split.casefold()) if len(word) >= SHORTEST]


def _naming(obj: SceneObject, lines: Sequence[_Line]) -> Naming:
    """The words of short lines in the largest print, with the noun of the object's shape."""
    heights: dict[str, float] = {}
    for line in lines:
        words = words_in(line.text)
        for word in words if len(words) <= IN_A_LINE else ():
            heights[word] = max(line.height, heights.get(word, 0.0))
    if not heights:
        return Naming("", 0.0, why="No name is read on it.")
    large = [word for word, height in heights.items() if height >= NAME * max(heights.values())]
    words = sorted(large, key=lambda word: -heights[word])[:MOST_WORDS]
    return Naming(" ".join([*words, obj.label.split()[-1]]), max(line.score for line in lines))


def _best(lines: Sequence[_Line]) -> list[_Line]:
    """The lines without those at whose place more letters were read, or surer ones, in another turn."""
    kept: list[_Line] = []
    for line in sorted(lines, key=lambda line: -line.score * len(line.text)):
        if not any(other.covers(line) for other in kept):
            kept.append(line)
    return kept


def _stretched(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """A picture (H, W, 3) from its darkest to its brightest: packages stand in shadows."""
    low, high = np.percentile(image.max(axis=2), [2.0, 98.0])
    return np.asarray(255 * np.clip((image - low) / max(high - low, 1.0), 0.0, 1.0)).astype(np.uint8)


def _turned_back(at: FloatArray, turn: int, size: tuple[int, int]) -> FloatArray:
    """Where a pixel (x, y) of a picture after quarter turns to the left was in it; ``size`` is its width and height."""
    (x, y), (width, height) = at, size
    return np.array([(x, y), (width - y, x), (width - x, height - y), (y, height - x)][turn])


def _engine() -> Any:
    """RapidOCR with the models in its wheel, on one core."""
    try:
        from rapidocr import RapidOCR
    except ModuleNotFoundError as error:
        raise MissingDependencyError(
            "rapidocr", "perceiver.read_text=true", "pip install 'gvla2[text]'"
        ) from error
    return RapidOCR(
        params={
            "Global.log_level": "error",
            "Global.use_cls": False,
            "Det.limit_side_len": LEAST,
            "EngineConfig.onnxruntime.intra_op_num_threads": 1,
            "EngineConfig.onnxruntime.inter_op_num_threads": 1,
        }
    )
