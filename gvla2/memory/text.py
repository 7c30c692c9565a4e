"""Search terms of texts: words of any language, stemmed, without those that say nothing about a topic."""

from __future__ import annotations

import re
import unicodedata
from functools import lru_cache

from Stemmer import Stemmer

MAX_TEXT = 8192
"""Characters read of a text: a query of a megabyte costs no more than one of a page."""
MAX_WORD = 64
"""Longer words (encoded data, mostly) count by their beginning."""
LONG = 6
"""Number of terms above which a query's sentences are also searched one by one."""
MAX_SENTENCES = 8
_SENTENCE = re.compile(r"[.;!?](?=\s|$)|[\n。；！？]")
_WORD = re.compile(r"\w+")
# Scripts that put no spaces between words: Thai, Lao, Khmer, Myanmar, kana, Han.
_UNSPACED = re.compile(
    r"([\u0e00-\u0eff\u1000-\u109f\u1780-\u17ff\u3040-\u30ff\u3400-\u4dbf\u4e00-\u9fff\uf900-\ufaff]+)"
)
_STEMMER = Stemmer("english", 0)
# English words that say nothing about a topic; also the verbs of any order ("put", "take") and number words, which
# queries share with lessons about anything. Other languages rely on the weights of rare words alone.
_STOP = """
a about above after all also an and any are as at be been before below but by can could did do does for from had
has have he her here him his how i if in into is it its just let like me more most my no not now of off on onto
or our out over please she should so some than that the their them then there these they this those to too under
s t d l m until up us very was we were what when where which while who whom why will with would you your
put puts get gets got take takes took give gives go goes come comes make makes made thing things
one two three four five six seven eight nine ten eleven twelve twenty thirty forty fifty sixty seventy eighty ninety
hundred thousand half
"""
STOP_WORDS = frozenset(_STOP.split()) | frozenset("0123456789")


@lru_cache(maxsize=16384)
def terms(text: str) -> frozenset[str]:
    """The distinct terms of a text, of its first ``MAX_TEXT`` characters."""
    return frozenset(stem(word) for word in words(text) if word not in STOP_WORDS)


def words(text: str) -> list[str]:
    """Casefolded words in reading order; scripts without spaces give their character pairs."""
    text = text[:MAX_TEXT]
    if text.isascii():
        return [word[:MAX_WORD] for word in _WORD.findall(text.lower())]
    found: list[str] = []
    for word in _WORD.findall(unicodedata.normalize("NFKC", text).casefold()):
        # Splitting by a group gives the text between the runs at even indices, and the runs at odd ones.
        for place, part in enumerate(_UNSPACED.split(word)):
            if place % 2:
                found += [part[i : i + 2] for i in range(max(len(part) - 1, 1))]
            elif part:
                found.append(part[:MAX_WORD])
    return found


@lru_cache(maxsize=16)
def subqueries(query: str) -> tuple[frozenset[str], ...]:
    """The terms of a query, then those of the sentences of a longer one that have two or more.

    Instructions mention circumstances too ("The guests come at seven; set the table."), which useful records do not
    share. () for a query without terms.
    """
    whole = terms(query)
    if len(whole) < LONG:
        return (whole,) if whole else ()
    parts = [some for part in _SENTENCE.split(query[:MAX_TEXT]) if len(some := terms(part)) > 1]
    return tuple(dict.fromkeys([whole, *parts[:MAX_SENTENCES]]))


@lru_cache(maxsize=65536)
def stem(word: str) -> str:
    """The stem of a casefolded word (Snowball's Porter2); names with figures in them stay as they are."""
    return str(_STEMMER.stemWord(word)) if word.isalpha() else word
