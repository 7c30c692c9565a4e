"""Masks of named objects in every picture, fused into one scene."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import NDArray

from gvla2.errors import ConfigurationError
from gvla2.geometry.views import Observation
from gvla2.perception.clusters import MaskCandidate, fuse, objects_of
from gvla2.perception.frames import BoolArray, frames_of
from gvla2.perception.labels import labelled
from gvla2.perception.objects import numbered, over_workspace
from gvla2.perception.options import labellers
from gvla2.planning.scene import Box, Scene

if TYPE_CHECKING:
    from gvla2_plugins.open_vocabulary import VocabularyConfig

_BETWEEN = re.compile(
    r"\b(?:pick|lift|put|place|move|push|pull|open|close|take|grasp|slide|sort|stack|insert|turn|press|up|down|in|into|on|"
    r"onto|to|from|of|off|out|at|by|the|a|an|all|left|right|front|behind|next|between|and|then|it|its|with)\b|[^\w\s-]"
)
"""Words and punctuation between the names of objects in an instruction."""


@dataclass(frozen=True)
class FoundMask:
    """A mask (H, W) of the object that ``label`` names, and its score in [0, 1]."""

    mask: BoolArray
    score: float
    label: str


class Finder(Protocol):
    """A model that finds by words."""

    def find(self, image: NDArray[np.uint8], words: list[str], threshold: float) -> list[FoundMask]:
        """Masks for all words in one picture (H, W, 3)."""
        ...


class VocabularyPerceiver:
    """Asks a model for masks of named objects; depth places them."""

    def __init__(self, config: VocabularyConfig, finder: Finder) -> None:
        if not 0 < config.threshold < 1 or config.min_points < 3:
            raise ConfigurationError(
                "perceiver=sam3: threshold must be in (0, 1) and min_points at least 3, got "
                f"{config.threshold} and {config.min_points}."
            )
        self._config, self._finder = config, finder
        self._labellers = labellers(config)

    def perceive(self, observation: Observation, instruction: str, workspace: Box) -> Scene:
        """The scene inside ``workspace``; raises :class:`PerceptionError` like every perceiver."""
        frames, table, notes = frames_of(observation.views, workspace)
        words = list(self._config.words) or named_in(instruction)
        if not words:
            notes.append("The instruction names nothing to look for: give perceiver.words=[...].")
        candidates = [
            MaskCandidate(number, found.mask, found.score, found.label)
            for number, frame in enumerate(frames if words else ())
            for found in self._finder.find(frame.view.image, words, self._config.threshold)
        ]
        objects, small = objects_of(fuse(frames, candidates), frames, table, self._config.min_points)
        inside = numbered(over_workspace(objects, workspace))
        scene = Scene(inside, table.height_over(workspace), workspace, "sam3", (*notes, *small))
        return labelled(scene, observation, self._labellers)


def named_in(instruction: str) -> list[str]:
    """The noun phrases of an instruction, each once, in its order."""
    phrases = (" ".join(p.split()) for p in _BETWEEN.sub("\0", instruction.casefold()).split("\0"))
    return [p for p in dict.fromkeys(phrases) if p]
