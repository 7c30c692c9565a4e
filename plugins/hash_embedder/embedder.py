"""Signed hashing of character n-grams."""

from __future__ import annotations

import unicodedata
from collections import Counter
from collections.abc import Sequence
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from gvla2.errors import ConfigurationError


class HashEmbedder:
    """Texts to unit vectors by the character n-grams of their words.

    The same text gives the same vector on every machine and in every process (CRC-32, not Python's own hash), so
    vectors may be stored. N-grams don't cross words; a word's ends are marked; letters lose their case, width and
    accents. A gram that occurs n times counts sqrt(n). Scripts without spaces work as one long word.
    """

    def __init__(self, dimension: int = 512, shortest: int = 3, longest: int = 5) -> None:
        if dimension < 8 or not 1 <= shortest <= longest:
            raise ConfigurationError(
                f"The hash embedder needs dimension >= 8 and 1 <= shortest <= longest; got dimension={dimension}, "
                f"shortest={shortest}, longest={longest}."
            )
        self._dimension, self._shortest, self._longest = dimension, shortest, longest

    @property
    def model(self) -> str:
        """Identifier kept with stored vectors; it changes with anything that changes the vectors."""
        return f"hash-char-{self._shortest}-{self._longest}-{self._dimension}-v1"

    def embed(self, texts: Sequence[str]) -> NDArray[np.float32]:
        """(N, dimension) unit rows; a text without letters or digits gives a zero row."""
        rows = np.zeros((len(texts), self._dimension), dtype=np.float64)
        for row, text in zip(rows, texts, strict=True):
            for gram, count in self._grams(text).items():
                code = crc32(gram.encode("utf-8", "surrogatepass"))
                # The highest bit signs, the others place: colliding grams cancel as often as they add.
                row[(code & 0x7FFFFFFF) % self._dimension] += (1.0 if code >> 31 else -1.0) * count**0.5
        lengths = np.linalg.norm(rows, axis=1, keepdims=True)
        return np.divide(rows, lengths, out=np.zeros_like(rows), where=lengths > 0).astype(np.float32)

    def _grams(self, text: str) -> Counter[str]:
        grams: Counter[str] = Counter()
        for word in _words(text):
            marked = f"^{word}$"
            for size in range(self._shortest, self._longest + 1):
                grams.update(marked[i : i + size] for i in range(len(marked) - size + 1))
        return grams


def _words(text: str) -> list[str]:
    """Runs of letters, marks and digits of any script, in one canonical spelling."""
    plain = unicodedata.normalize("NFKD", text.casefold())
    kept = "".join(
        c if unicodedata.category(c)[0] in "LN" else "" if unicodedata.category(c) == "Mn" else " "
        for c in plain
    )
    return kept.split()
