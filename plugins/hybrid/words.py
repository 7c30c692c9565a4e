"""Words of any language, and how well they match: tokens, coverage, BM25."""

from __future__ import annotations

import math
import re
import unicodedata
from collections import Counter
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from gvla2_plugins.hybrid.function_words import FUNCTION_WORDS

_WORD = re.compile(r"\w+")
# Scripts that put no spaces between words: Thai, Lao, Khmer, Myanmar, kana, Han.
_UNSPACED = re.compile(
    r"[\u0e00-\u0eff\u1000-\u109f\u1780-\u17ff\u3040-\u30ff\u3400-\u4dbf\u4e00-\u9fff\uf900-\ufaff]+"
)


def tokens(text: str) -> list[str]:
    """Casefolded words in reading order; scripts without spaces give their character pairs."""
    found: list[str] = []
    for word in _WORD.findall(unicodedata.normalize("NFKC", text).casefold()):
        rest = 0
        for run in _UNSPACED.finditer(word):
            found += [word[rest : run.start()]] if run.start() > rest else []
            letters = run.group()
            found += [letters[i : i + 2] for i in range(max(len(letters) - 1, 1))]
            rest = run.end()
        found += [word[rest:]] if rest < len(word) else []
    return found


def topic_words(text: str) -> list[str]:
    """The tokens that carry a topic: function words and single digits are left out."""
    return [
        token
        for token in tokens(text)
        if token not in FUNCTION_WORDS and not (len(token) == 1 and token.isdigit())
    ]


def coverage(query: Sequence[str], document: Sequence[str]) -> float:
    """The share of the query's distinct words that the document has, in [0, 1]."""
    wanted = set(query)
    return len(wanted & set(document)) / len(wanted) if wanted else 0.0


def bm25(
    query: Sequence[str], documents: Sequence[Sequence[str]], k1: float = 1.2, b: float = 0.75
) -> NDArray[np.float64]:
    """(N,) Okapi BM25 of each document for the query's distinct words; all idf are positive."""
    scores = np.zeros(len(documents))
    if not documents:
        return scores
    counts = [Counter(document) for document in documents]
    lengths = np.array([len(document) for document in documents], dtype=np.float64)
    scale = k1 * (1 - b + b * lengths / max(float(lengths.mean()), 1e-9))
    for word in sorted(set(query)):
        frequency = np.array([count[word] for count in counts], dtype=np.float64)
        holders = int((frequency > 0).sum())
        idf = math.log(1 + (len(documents) - holders + 0.5) / (holders + 0.5))
        scores += idf * frequency * (k1 + 1) / np.maximum(frequency + scale, 1e-9)
    return scores
