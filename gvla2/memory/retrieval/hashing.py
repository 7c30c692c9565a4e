"""The hash embedder: character n-grams to unit vectors, without a model and without a download."""

from __future__ import annotations

import unicodedata
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from gvla2.errors import ConfigurationError
from gvla2.memory.retrieval.gram_kernels import add_grams

_CACHED_LETTERS = 20_000


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
            if words := _words(text):
                marked = b"^%b$" % b"$^".join(words)
                add_grams(np.frombuffer(marked, np.uint8), self._shortest, self._longest, row)
        lengths = np.sqrt(np.einsum("nd,nd->n", rows, rows))
        lengths[lengths == 0] = 1.0
        rows /= lengths[:, None]
        return rows.astype(np.float32)


class _Spelling(dict[int, str | None]):
    """What each character becomes: itself (letters, digits), nothing (marks), a space (the rest)."""

    def __missing__(self, code: int) -> str | None:
        category = unicodedata.category(chr(code))
        kept = chr(code) if category[0] in "LN" else None if category == "Mn" else " "
        if len(self) < _CACHED_LETTERS:
            self[code] = kept
        return kept


_SPELLING = _Spelling()


# The same for ASCII, all at once.
_ASCII = bytes(ord(c.lower()) if c.isascii() and c.isalnum() else ord(" ") for c in map(chr, range(256)))


def _words(text: str) -> list[bytes]:
    """Runs of letters, marks and digits of any script, in one canonical spelling, as UTF-8."""
    if text.isascii():
        return text.encode().translate(_ASCII).split()
    spelt = unicodedata.normalize("NFKD", text.casefold()).translate(_SPELLING)
    return spelt.encode("utf-8", "surrogatepass").split()
