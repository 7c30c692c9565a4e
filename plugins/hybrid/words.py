"""Words of any language, and how well they match: tokens, coverage, BM25."""

from __future__ import annotations

import math
import re
import unicodedata
from collections import Counter
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

_WORD = re.compile(r"\w+")
# Scripts that put no spaces between words: Thai, Lao, Khmer, Myanmar, kana, Han.
_UNSPACED = re.compile(
    r"[\u0e00-\u0eff\u1000-\u109f\u1780-\u17ff\u3040-\u30ff\u3400-\u4dbf\u4e00-\u9fff\uf900-\ufaff]+"
)

FUNCTION_WORDS = frozenset(
    # Words that say nothing about the topic, in languages that robots are often spoken to in.
    "a about above after all also an and any are as at be been before below but by can could did do does for from had "
    "has have he her here him his how i if in into is it its just let like me more most my no not now of off on onto "
    "or our out over please she should so some than that the their them then there these they this those to too under "
    "until up us very was we were what when where which while who whom why will with would you your "
    "aber als am an auf aus bei bin bis bist bitte das dass dein dem den der des die dir doch du ein eine einem einen "
    "einer eines er es für hat hier ich ihm ihn ihr im in ist ja kann man mein mich mir mit nach nicht noch nur oder "
    "ohne sehr sein sich sie sind so über um und uns unter vom von vor war was wenn wer wie wird wir wo zu zum zur "
    "au aux avec ce ces cet cette comme dans de des du elle en est et eux il ils je la le les leur lui ma mais mes moi "
    "mon ne nos notre nous on ou où par pas plus pour qu que quel quelle qui sa sans se ses son sont sur ta te tes toi "
    "ton tu un une vos votre vous y à été être "
    "al algo como con cual cuando del desde donde él ella el en entre era es esa ese eso esta este esto fue ha hay la "
    "las le les lo los más me mi muy no nos o para pero por porque que quien se si sin sobre son su sus te tu un una "
    "unas uno unos y ya yo "
    "ai alla allo che chi ci col come da dal dalla degli dei del della di e ed gli il io la le lo ma mi nel nella non "
    "per però più quale quando questa questo se sei si sono su sul sulla tra un una uno vi "
    "ao aos as com da das do dos e ela ele em essa esse esta este eu já lhe mas me meu minha na não nas no nos os ou "
    "para pela pelo por quem se seu sua são também te tem uma umas uns você "
    "и в во не что он на я с со как а то все она так его но да ты к у же вы за бы по только ее мне было вот от меня "
    "еще нет о из ему де het een van en ik te dat die in je niet zijn is op aan met voor er maar om dan".split()
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
