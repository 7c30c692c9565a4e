"""The terms that texts are searched by: words of any language, without stop words, stemmed by Snowball."""

from __future__ import annotations

import re
import unicodedata
from functools import lru_cache

from Stemmer import Stemmer

from gvla2.memory.indexing.stop_words import STOP_WORDS

MAX_TEXT = 8192
"""What is read of a text, in characters: a query of a megabyte costs no more than one of a page."""
MAX_WORD = 64
"""Longer words (encoded data, mostly) count by their beginning."""
LONG = 6
"""Terms from which on the sentences of a query are looked at one by one."""
MAX_SENTENCES = 8
_SENTENCE = re.compile(r"[.;!?](?=\s|$)|[\n。；！？]")
_WORD = re.compile(r"\w+")
# Scripts that put no spaces between words: Thai, Lao, Khmer, Myanmar, kana, Han.
_UNSPACED = re.compile(
    r"([\u0e00-\u0eff\u1000-\u109f\u1780-\u17ff\u3040-\u30ff\u3400-\u4dbf\u4e00-\u9fff\uf900-\ufaff]+)"
)
_STEMMER = Stemmer("english", 0)


def terms(text: str) -> frozenset[str]:
    """The distinct terms of a text, of its first ``MAX_TEXT`` characters."""
    return frozenset(_stem(word) for word in words(text) if word not in STOP_WORDS)


def words(text: str) -> list[str]:
    """Casefolded words in reading order; scripts without spaces give their character pairs."""
    text = text[:MAX_TEXT]
    if text.isascii():
        return [word[:MAX_WORD] for word in _WORD.findall(text.lower())]
    found: list[str] = []
    for word in _WORD.findall(unicodedata.normalize("NFKC", text).casefold()):
        # Splitting by a group gives what lies between the runs at even places, and the runs at odd ones.
        for place, part in enumerate(_UNSPACED.split(word)):
            if place % 2:
                found += [part[i : i + 2] for i in range(max(len(part) - 1, 1))]
            elif part:
                found.append(part[:MAX_WORD])
    return found


@lru_cache(maxsize=16)
def questions(query: str) -> tuple[frozenset[str], ...]:
    """The terms of a query, then those of the sentences of a longer one that have two or more.

    Whoever instructs tells of circumstances too ("The guests come at seven; set the table."), which records that know
    what to do do not share. () for a query without terms.
    """
    whole = terms(query)
    if len(whole) < LONG:
        return (whole,) if whole else ()
    parts = [some for part in _SENTENCE.split(query[:MAX_TEXT]) if len(some := terms(part)) > 1]
    return tuple(dict.fromkeys([whole, *parts[:MAX_SENTENCES]]))


@lru_cache(maxsize=65536)
def _stem(word: str) -> str:
    return str(_STEMMER.stemWord(word))
