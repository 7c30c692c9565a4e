"""LPIPS v0.1 with AlexNet (Zhang et al. 2018): a learned distance of images, computed with numpy and scipy.

Features of five layers are scaled to unit length at each pixel, their squared differences weighted by a learned head
and averaged over the picture. The forward pass is a handful of matrix products: no deep learning library is needed.

``scripts/fetch_lpips`` puts the published weights into the cache.
"""

from __future__ import annotations

import io
import zipfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter

from gvla2.errors import ConfigurationError, GeometryError, MissingDependencyError
from gvla2.io.array_cache import cache_folder

Floats = NDArray[np.float32]

LICENCE = "BSD (LPIPS heads BSD-2-Clause; AlexNet weights of torchvision, BSD-3-Clause)"
FETCH = "scripts/fetch_lpips"

_SHAPES = ((11, 11, 3, 64), (5, 5, 64, 192), (3, 3, 192, 384), (3, 3, 384, 256), (3, 3, 256, 256))
# The published scaling of images in [-1, 1] (mean and deviation of ImageNet on that range).
_SHIFT = np.array([-0.030, -0.088, -0.188], dtype=np.float32)
_SCALE = np.array([0.458, 0.448, 0.450], dtype=np.float32)
_STRIDES, _PADDING = (4, 1, 1, 1, 1), (2, 2, 1, 1, 1)
_POOLED = (1, 2)  # layers whose input is pooled first
_LEAST = 32  # pixels a side: below, the last pooling has nothing left


@dataclass(frozen=True)
class Weights:
    """Kernels (k, k, C, D) and biases (D,) of the five convolutions, and the heads (D,), all float32."""

    kernels: tuple[Floats, ...]
    biases: tuple[Floats, ...]
    heads: tuple[Floats, ...]


class Lpips:
    """The distance; holds the weights. Features of a target can be kept and compared many times."""

    def __init__(self, weights: Weights | None = None) -> None:
        """Raises :class:`gvla2.errors.MissingDependencyError` when no weights are given or cached."""
        self._weights = weights or read_weights()

    def features(self, image: NDArray[np.floating]) -> list[Floats]:
        """Five feature maps (H', W', C) of an image (H, W, 3) in [0, 1], each pixel of unit length."""
        pixels = np.asarray(image, dtype=np.float32)
        if pixels.ndim != 3 or pixels.shape[2] != 3 or min(pixels.shape[:2]) < _LEAST:
            raise GeometryError(
                f"LPIPS takes images (H, W, 3) of at least {_LEAST} pixels a side, got {pixels.shape}."
            )
        x, maps = ((2 * pixels - 1) - _SHIFT) / _SCALE, []
        for layer, (kernel, bias) in enumerate(zip(self._weights.kernels, self._weights.biases, strict=True)):
            if layer in _POOLED:  # the maximum over 3 x 3 windows, two pixels apart
                x = np.asarray(maximum_filter(x, size=(3, 3, 1))[1:-1:2, 1:-1:2])
            x = np.maximum(_convolve(x, kernel, bias, _STRIDES[layer], _PADDING[layer]), 0)
            maps.append(x / (np.sqrt(np.sum(x * x, axis=-1, keepdims=True)) + np.float32(1e-10)))
        return maps

    def between(self, a: Sequence[Floats], b: Sequence[Floats]) -> float:
        """The distance of two images' features: 0 for the same image, about 0.7 for a poor likeness."""
        if [one.shape for one in a] != [other.shape for other in b]:
            raise GeometryError("LPIPS compares images of the same size.")
        layers = zip(a, b, self._weights.heads, strict=True)
        return sum(float(np.mean(np.square(x - y) @ head, dtype=np.float64)) for x, y, head in layers)

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


def weights_path() -> Path:
    """The cache file of fetched weights."""
    return cache_folder() / "weights" / "lpips-alexnet-v0.1.npz"


def read_weights(path: Path | None = None) -> Weights:
    """The weights from the cache, or from your own ``.npz``: ``kernelN``, ``biasN`` and ``headN`` for N from 0 to 4.

    Raises :class:`MissingDependencyError` when there is no such file, :class:`ConfigurationError` when it holds
    anything else.
    """
    source = path or weights_path()
    if not source.is_file():
        raise MissingDependencyError(f"the weight file {source}", "LPIPS", FETCH, LICENCE)
    layers = range(len(_SHAPES))
    try:
        with np.load(io.BytesIO(source.read_bytes())) as kept:
            kernels, biases, heads = (
                tuple(kept[f"{name}{n}"].astype(np.float32) for n in layers)
                for name in ("kernel", "bias", "head")
            )
    except (OSError, ValueError, KeyError, TypeError, EOFError, zipfile.BadZipFile) as error:
        raise ConfigurationError(
            f"{source} does not hold LPIPS weights ({error}). {FETCH} gets them."
        ) from error
    if tuple(kernel.shape for kernel in kernels) != _SHAPES:
        raise ConfigurationError(f"{source} holds LPIPS weights of the wrong shape.")
    return Weights(kernels, biases, heads)
