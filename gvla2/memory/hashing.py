"""The hash embedder: character n-grams to unit vectors, without a model and without a download."""

from __future__ import annotations

import unicodedata
from collections import Counter
from collections.abc import Sequence
from functools import lru_cache
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from gvla2.errors import ConfigurationError

_CACHED_WORDS = 50_000
_CACHED_LETTERS = 20_000
_CACHED_LENGTH = 32  # longer words seldom come twice, and would make the cache large


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
        self._of_word = lru_cache(maxsize=_CACHED_WORDS)(self._grams)

    @property
    def model(self) -> str:
        """Identifier kept with stored vectors; it changes with anything that changes the vectors."""
        return f"hash-char-{self._shortest}-{self._longest}-{self._dimension}-v1"

    def embed(self, texts: Sequence[str]) -> NDArray[np.float32]:
        """(N, dimension) unit rows; a text without letters or digits gives a zero row."""
        rows = np.zeros((len(texts), self._dimension), dtype=np.float64)
        for row, text in zip(rows, texts, strict=True):
            self._fill(row, text)
        lengths = np.sqrt(np.einsum("nd,nd->n", rows, rows))
        lengths[lengths == 0] = 1.0
        rows /= lengths[:, None]
        return rows.astype(np.float32)

    def _fill(self, row: NDArray[np.float64], text: str) -> None:
        codes: list[int] = []
        for word in _words(text):
            codes += self._of_word(word) if len(word) <= _CACHED_LENGTH else self._grams(word)
        once = set(codes)
        if len(once) == len(codes):
            found = np.array(codes, dtype=np.int64)
            amounts = np.where(found >= 1 << 31, 1.0, -1.0)
        else:
            counts = Counter(codes)
            found = np.array(list(counts), dtype=np.int64)
            amounts = np.where(found >= 1 << 31, 1.0, -1.0) * np.sqrt(list(counts.values()))
        # The highest bit signs, the others place: colliding grams cancel as often as they add.
        row += np.bincount((found & 0x7FFFFFFF) % self._dimension, amounts, self._dimension)

    def _grams(self, word: str) -> list[int]:
        """The codes of the word's n-grams: a CRC-32 each, over UTF-8."""
        marked = f"^{word}$"
        if marked.isascii():
            letters = marked.encode()
            return [
                crc32(letters[i : i + size])
                for size in range(self._shortest, self._longest + 1)
                for i in range(len(letters) - size + 1)
            ]
        return [
            crc32(marked[i : i + size].encode("utf-8", "surrogatepass"))
            for size in range(self._shortest, self._longest + 1)
            for i in range(len(marked) - size + 1)
        ]


class _Spelling(dict[int, str | None]):
    """What each character becomes: itself (letters, digits), nothing (marks), a space (the rest)."""

    def __missing__(self, code: int) -> str | None:
        category = unicodedata.category(chr(code))
        kept = chr(code) if category[0] in "LN" else None if category == "Mn" else " "
        if len(self) < _CACHED_LETTERS:
            self[code] = kept
        return kept


_SPELLING = _Spelling()


def _words(text: str) -> list[str]:
    """Runs of letters, marks and digits of any script, in one canonical spelling."""
    if text.isascii():
        return text.lower().translate(_SPELLING).split()
    return unicodedata.normalize("NFKD", text.casefold()).translate(_SPELLING).split()
