"""Stems of English words (Snowball's Porter2)."""

from __future__ import annotations

from functools import lru_cache

import Stemmer

_STEMMER = Stemmer.Stemmer("english")


@lru_cache(maxsize=32768)
def stem(word: str) -> str:
    """The stem of a casefolded word; names with figures in them stay as they are."""
    return str(_STEMMER.stemWord(word)) if word.isalpha() else word
