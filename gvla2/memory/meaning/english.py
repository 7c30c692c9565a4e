"""Words of English that the reader knows: those that say nothing, those that forbid, and how to tell the language."""

from __future__ import annotations

import re
from functools import lru_cache


def word_set(text: str) -> frozenset[str]:
    """The words of a text that spaces and line ends part."""
    return frozenset(text.split())


MAX_READ = 2000
"""Characters that are read of a text."""
WORD = re.compile(r"[^\W_](?:[\w]|['-](?=\w))*")

SOFT = word_set(
    """use make sure need needs keep leave get give take let please always best better good well work works ensure
    properly just simply really way thing things set go do be have has had will would can could may might must shall
    should ought want prefer preferably recommended enough fine okay ok about around roughly approximately almost
    exactly here there still again once very quite much many lot so too also only even it its they them this that these
    those any all each every some both one two who which what where why how than per least most of to in at by for from
    with within onto into upon toward towards via through during as a an the and or but nor if when while until i we you
    he she my our your his her us me were was is are been being am did does done got found find turned needed belong
    belongs come comes stand stands lie lies sit sits stay stays look looks suffice suffices plenty begin begins happen
    happens hang hangs fit fits"""
)
"""Words that change nothing about what is done to what."""
NEGATORS = word_set(
    """not never no don't dont doesn't mustn't shouldn't can't cannot won't isn't aren't avoid refrain skip omit nothing
    neither forbidden prohibited nobody none wrong unwise mistake"""
)
ENDING = word_set("stop quit cease")
"""Before a gerund these forbid as well: "stop stirring"."""
CONDITIONS = word_set("if when whenever while once unless during where")
DETERMINERS = word_set("the a an its their your each this that")
PREPOSITIONS = word_set(
    "of to in at by for from with into onto on under near inside through along against between"
)
PLACES = word_set("side height depth inside ends daytime")
"""Axes whose words may stand alone behind an article: "on the left"; others are nouns there ("the light")."""
IDIOMS = re.compile(
    r"\b(?:do not|don't|never) (?:forget|hesitate|fail|omit|neglect)\b(?: to)?|\bnot only\b|\bno doubt\b|\bnot just\b"
    r"|\bno (?:later|sooner|more|less|fewer|longer|lower|higher) than\b|\bnot (?:a )?(?:bad|wrong)(?: idea)?\b"
    r"|\bnot (?:forbidden|prohibited)\b|\bnothing wrong with\b|\bno matter\b"
)
"""Negations that forbid nothing."""
NEEDLESS = re.compile(
    r"\bno need\b|\bneed not\b|\bneedn't\b|\bnot (?:necessary|needed|required)\b|\bnot enough\b|\boptional\b"
    r"|\b(?:don't|do not|does not|doesn't) (?:need|have) to\b"
)

_TELLING = word_set(
    """the a of and to is it for with on at by from be are as or not this that before after when if then than into while
    until use do don't never always must should only keep"""
)
_FOREIGN = word_set(
    """der die das den dem des ein eine einen einem und nicht ist mit auf vor nach bei zu zum zur für von im wenn erst
    statt le la les des du une est pas avec pour dans sur avant après ne et au aux que qui en el los las una del con por
    antes después se hay para nunca siempre y o il gli della che non prima dopo di da em não depois het een van niet
    voor på och att ikke og jest nie się przed w z na"""
)
_LETTERS = re.compile(r"[^\W\d_]+(?:'[^\W\d_]+)?")


@lru_cache(maxsize=16384)
def is_english(text: str) -> bool:
    """Whether a text may be read here. Short texts that show no language count as English where they are ASCII."""
    words = _LETTERS.findall(text[:MAX_READ].casefold().replace("’", "'"))
    mine = sum(word in _TELLING for word in words)
    theirs = sum(word in _FOREIGN or not word.isascii() for word in words)
    return bool(words) and (theirs == 0 or mine > 2 * theirs)
