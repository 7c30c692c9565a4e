"""A BERT encoder in numpy, float32: the minimum for six small layers.

Devlin et al., "BERT" (2019), as ``transformers`` computes it in evaluation.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float32]


class Encoder:
    """The encoder of a checkpoint with ``heads`` attention heads a layer."""

    def __init__(self, weights: dict[str, Array], heads: int, epsilon: float) -> None:
        self._weights, self._heads, self._epsilon = weights, heads, np.float32(epsilon)
        names = [name.split(".")[2] for name in weights if name.startswith("encoder.layer.")]
        self._layers = 1 + max(map(int, names))

    def __call__(self, tokens: NDArray[np.int64], mask: NDArray[np.bool_]) -> Array:
        """(B, T, D) states of the last layer for (B, T) ``tokens``; those outside ``mask`` are ignored."""
        embedded = self._weights["embeddings.word_embeddings.weight"][tokens]
        embedded = embedded + self._weights["embeddings.position_embeddings.weight"][: tokens.shape[1]]
        state = self._normed(
            "embeddings", embedded + self._weights["embeddings.token_type_embeddings.weight"][0]
        )
        hidden = np.where(mask, 0.0, -np.inf).astype(np.float32)[:, None, None]  # (B, 1, 1, T)
        for layer in range(self._layers):
            state = self._layer(f"encoder.layer.{layer}", state, hidden)
        return state

    def _layer(self, name: str, state: Array, hidden: Array) -> Array:
        query, key, value = (
            self._split(self._linear(f"{name}.attention.self.{part}", state))
            for part in ("query", "key", "value")
        )
        weights = query @ key.swapaxes(-1, -2) / np.float32(query.shape[-1] ** 0.5) + hidden  # (B, H, T, T)
        weights = np.exp(weights - weights.max(axis=-1, keepdims=True))
        weights /= weights.sum(axis=-1, keepdims=True)
        seen = (weights @ value).swapaxes(1, 2).reshape(state.shape)
        state = self._normed(
            f"{name}.attention.output", self._linear(f"{name}.attention.output.dense", seen) + state
        )
        inner = self._linear(f"{name}.intermediate.dense", state)
        inner *= np.float32(0.5) * (1 + _erf(inner / np.float32(2**0.5)))  # GELU
        return self._normed(f"{name}.output", self._linear(f"{name}.output.dense", inner) + state)

    def _split(self, state: Array) -> Array:
        batch, length, width = state.shape
        return state.reshape(batch, length, self._heads, width // self._heads).swapaxes(1, 2)

    def _linear(self, name: str, state: Array) -> Array:
        # One product of two matrices: numpy would process a stack of them one by one.
        flat = state.reshape(-1, state.shape[-1]) @ self._weights[f"{name}.weight"].T
        flat += self._weights[f"{name}.bias"]
        return np.asarray(flat.reshape(*state.shape[:-1], -1))

    def _normed(self, name: str, state: Array) -> Array:
        centred = state - state.mean(axis=-1, keepdims=True)
        spread = np.sqrt(np.square(centred).mean(axis=-1, keepdims=True) + self._epsilon)
        scaled: Array = centred / spread * self._weights[f"{name}.LayerNorm.weight"]
        return scaled + self._weights[f"{name}.LayerNorm.bias"]


def _erf(x: Array) -> Array:
    """The error function to 1.5e-7 (Abramowitz and Stegun 7.1.26): scipy's takes a third of a second to import."""
    t = 1 / (1 + np.float32(0.3275911) * np.abs(x))
    series = np.zeros_like(t)
    for factor in (1.061405429, -1.453152027, 1.421413741, -0.284496736, 0.254829592):
        series = (series + np.float32(factor)) * t
    return np.asarray(np.copysign(1 - series * np.exp(-x * x), x), np.float32)
