"""Search terms of texts: words of any language, without stop words, stemmed by Snowball."""

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
# Words that say nothing about a text's topic, in English, German, French, Spanish, Italian, Portuguese, Russian
# and Dutch; a language that is missing only loses some sharpness while the bank is small. Of English also the verbs
# that stand in any order ("put", "take") and number words: queries share them with lessons about anything.
_STOP_WORDS = """
a about above after all also an and any are as at be been before below but by can could did do does for from had
has have he her here him his how i if in into is it its just let like me more most my no not now of off on onto
or our out over please she should so some than that the their them then there these they this those to too under
s t d l m until up us very was we were what when where which while who whom why will with would you your
put puts get gets got take takes took give gives go goes come comes make makes made thing things
one two three four five six seven eight nine ten eleven twelve twenty thirty forty fifty sixty seventy eighty ninety
hundred thousand half
aber als am an auf aus bei bin bis bist bitte das dass dein dem den der des die dir doch du ein eine einem einen
einer eines er es für hat hier ich ihm ihn ihr im in ist ja kann man mein mich mir mit nach nicht noch nur oder
ohne sehr sein sich sie sind so über um und uns unter vom von vor war was wenn wer wie wird wir wo zu zum zur
au aux avec ce ces cet cette comme dans de des du elle en est et eux il ils je la le les leur lui ma mais mes moi
mon ne nos notre nous on ou où par pas plus pour qu que quel quelle qui sa sans se ses son sont sur ta te tes toi
ton tu un une vos votre vous y à été être
al algo como con cual cuando del desde donde él ella el en entre era es esa ese eso esta este esto fue ha hay la
las le les lo los más me mi muy no nos o para pero por porque que quien se si sin sobre son su sus te tu un una
unas uno unos y ya yo
ai alla allo che chi ci col come da dal dalla degli dei del della di e ed gli il io la le lo ma mi nel nella non
per però più quale quando questa questo se sei si sono su sul sulla tra un una uno vi
ao aos as com da das do dos e ela ele em essa esse esta este eu já lhe mas me meu minha na não nas no nos os ou
para pela pelo por quem se seu sua são também te tem uma umas uns você
и в во не что он на я с со как а то все она так его но да ты к у же вы за бы по только ее мне было вот от меня
еще нет о из ему де het een van en ik te dat die in je niet zijn is op aan met voor er maar om dan
"""

STOP_WORDS = frozenset(_STOP_WORDS.split()) | frozenset("0123456789")


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
def questions(query: str) -> tuple[frozenset[str], ...]:
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
