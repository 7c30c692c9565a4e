"""Pictures to a model's square and masks back from it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from PIL import Image

MEAN, DEVIATION = np.array([0.485, 0.456, 0.406]), np.array([0.229, 0.224, 0.225])
"""Of ImageNet's pixels, by which all models of the family were trained."""


def squared(image: NDArray[np.uint8], side: int) -> NDArray[np.float32]:
    """(3, side, side) float32: the picture (H, W, 3) stretched to a square and normalised."""
    grown = Image.fromarray(image).resize((side, side), Image.Resampling.BILINEAR)
    return np.ascontiguousarray(
        ((np.asarray(grown) / 255.0 - MEAN) / DEVIATION).transpose(2, 0, 1), dtype=np.float32
    )


def enlarged(masks: NDArray[np.float32], size: tuple[int, int]) -> NDArray[np.float32]:
    """Logits (K, C, h, w) at another size (H, W), bilinear."""
    if masks.shape[2:] == tuple(size):
        return masks
    flat = masks.reshape(-1, *masks.shape[2:])
    grown = [np.asarray(Image.fromarray(m).resize(size[::-1], Image.Resampling.BILINEAR)) for m in flat]
    return np.array(grown, dtype=np.float32).reshape(*masks.shape[:2], *size)
