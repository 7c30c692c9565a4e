"""LPIPS v0.1 with AlexNet (Zhang et al. 2018): a learned distance of images, computed with numpy and scipy.

Features of five layers are scaled to unit length at each pixel, their squared differences weighted by a learned head
and averaged over the picture. The forward pass is a handful of matrix products: no deep learning library is needed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter

from gvla2.errors import GeometryError
from gvla2.evaluation.lpips_weights import LAYERS, Weights, read_weights

Floats = NDArray[np.float32]

# The published scaling of images in [-1, 1] (mean and deviation of ImageNet on that range).
_SHIFT = np.array([-0.030, -0.088, -0.188], dtype=np.float32)
_SCALE = np.array([0.458, 0.448, 0.450], dtype=np.float32)
_STRIDES, _PADDING = (4, 1, 1, 1, 1), (2, 2, 1, 1, 1)
_POOLED = (1, 2)  # layers whose input is pooled first
_LEAST = 32  # pixels a side: below, the last pooling has nothing left


@dataclass(frozen=True)
class Features:
    """An image's five feature maps (H, W, C), each pixel of unit length."""

    maps: tuple[Floats, ...]


class Lpips:
    """The distance; holds the weights. Features of a target can be kept and compared many times."""

    def __init__(self, weights: Weights | None = None) -> None:
        """Raises :class:`gvla2.errors.MissingDependencyError` when no weights are given or cached."""
        self._weights = weights or read_weights()

    def features(self, image: NDArray[np.floating]) -> Features:
        """Features of an image (H, W, 3) in [0, 1], at least 32 pixels a side."""
        pixels = np.asarray(image, dtype=np.float32)
        if pixels.ndim != 3 or pixels.shape[2] != 3 or min(pixels.shape[:2]) < _LEAST:
            raise GeometryError(
                f"LPIPS takes images (H, W, 3) of at least {_LEAST} pixels a side, got {pixels.shape}."
            )
        x = ((2 * pixels - 1) - _SHIFT) / _SCALE
        maps = []
        for layer in range(LAYERS):
            if layer in _POOLED:
                x = _pool(x)
            x = _convolve(
                x, self._weights.kernels[layer], self._weights.biases[layer], _STRIDES[layer], _PADDING[layer]
            )
            np.maximum(x, 0, out=x)
            maps.append(x / (np.sqrt(np.sum(x * x, axis=-1, keepdims=True)) + np.float32(1e-10)))
        return Features(tuple(maps))

    def between(self, a: Features, b: Features) -> float:
        """The distance of two images' features: 0 for the same image, about 0.7 for a poor likeness."""
        total = 0.0
        for one, other, head in zip(a.maps, b.maps, self._weights.heads, strict=True):
            if one.shape != other.shape:
                raise GeometryError("LPIPS compares images of the same size.")
            total += float(np.mean(np.square(one - other) @ head, dtype=np.float64))
        return total

    def __call__(self, image: NDArray[np.floating], target: NDArray[np.floating]) -> float:
        """The distance of two images (H, W, 3) in [0, 1]."""
        return self.between(self.features(image), self.features(target))


def _convolve(x: Floats, kernel: Floats, bias: Floats, stride: int, padding: int) -> Floats:
    """(H, W, C) with a kernel (k, k, C, D): one matrix product over all windows."""
    size = kernel.shape[0]
    padded = np.pad(x, ((padding, padding), (padding, padding), (0, 0)))
    windows = sliding_window_view(padded, (size, size), axis=(0, 1))[::stride, ::stride]  # (H', W', C, k, k)
    height, width = windows.shape[:2]
    rows = windows.transpose(0, 1, 3, 4, 2).reshape(height * width, -1)
    return (rows @ kernel.reshape(-1, kernel.shape[3]) + bias).reshape(height, width, -1)


def _pool(x: Floats) -> Floats:
    """Maximum over 3 x 3 windows, two pixels apart."""
    return np.asarray(maximum_filter(x, size=(3, 3, 1))[1:-1:2, 1:-1:2])
