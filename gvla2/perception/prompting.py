"""The interface of promptable segmentation models: one encoding per picture, then any number of prompts."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from gvla2.geometry.transform import FloatArray


@dataclass(frozen=True)
class Prompt:
    """A target in a picture, in pixels, the first pixel's centre at (0.5, 0.5).

    ``points`` (P, 2) as (u, v); ``positive`` (P,) whether each is on the thing or beside it; ``box`` is (left, top,
    right, bottom) or None. At least one point or a box.
    """

    points: FloatArray
    positive: NDArray[np.bool_]
    box: tuple[float, float, float, float] | None = None

    @classmethod
    def click(cls, u: float, v: float) -> Prompt:
        """One point on the thing."""
        return cls(np.array([[u, v]]), np.array([True]))


@dataclass(frozen=True)
class Segments:
    """Answers to K prompts, C masks each, from the part under a point to the whole.

    ``logits`` (K, C, H, W) float32 at the picture's size, a pixel is inside where it is above 0; ``scores`` (K, C) is
    the model's estimate of each mask's IoU, in [0, 1].
    """

    logits: NDArray[np.float32]
    scores: FloatArray

    def masks(self) -> NDArray[np.bool_]:
        """(K, C, H, W)."""
        return np.asarray(self.logits > 0)


class EncodedPicture(Protocol):
    """An encoded picture."""

    def segment(self, prompts: list[Prompt]) -> Segments:
        """The masks for the prompts; K = 0 is allowed."""
        ...


class Segmenter(Protocol):
    """A model that segments what it is pointed at: SAM, SAM 2, MobileSAM."""

    def encode(self, image: NDArray[np.uint8]) -> EncodedPicture:
        """Encode one picture (H, W, 3) RGB."""
        ...
