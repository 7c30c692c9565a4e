"""Whether things of two texts changed places: "put the cup on the plate", "put the plate on the cup"."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache

from gvla2.memory.meaning.concepts import concept_of, words_in
from gvla2.memory.meaning.idle_words import telling
from gvla2.memory.meaning.plain_text import plain_text
from gvla2.memory.meaning.statements import MAX_READ
from gvla2.memory.meaning.tasks import PREPOSITIONS
from gvla2.memory.meaning.word_roles import is_soft
from gvla2.memory.meaning.word_sets import word_set

_OF = frozenset(("of", "von", "de", "d", "du", "del"))
"""Behind other small words these tell nothing more: "all of the bolts"."""
_ONE_WAY = word_set(
    """from to into onto on in inside under above below over behind through
    von nach zu zum zur auf in unter über hinter durch
    de du des à au aux sur sous dans derrière vers
    desde del a al sobre bajo en detrás hacia"""
)
"""What these say of two things is another matter the other way round: not so "beside", "with", "and"."""


def swapped(first: str, second: str, *, one_way: bool = False) -> bool:
    """Whether things of two texts changed places; with ``one_way`` only where that makes another order of it."""
    # "a" is an article in English and "to" in Spanish, and short texts show no language.
    return any(_rotated(_places(first, article), _places(second, article), one_way) for article in ("a", ""))


def _rotated(one: Mapping[str, str], two: Mapping[str, str], one_way: bool) -> bool:
    """Whether some of the words took one another's places, two or more in turn."""
    moved = {
        word
        for word in one.keys() & two.keys()
        if one[word] != two[word] and not (one_way and _ONE_WAY.isdisjoint((one[word], two[word])))
    }
    while moved:
        left, entered = {one[word] for word in moved}, {two[word] for word in moved}
        # Only who takes a place that another left, and leaves one that another takes, is part of a round.
        turning = {word for word in moved if one[word] in entered and two[word] in left}
        if turning == moved:
            return True
        moved = turning
    return False


@lru_cache(maxsize=8192)
def _places(text: str, article: str) -> Mapping[str, str]:
    """The preposition or other small word that each word stands behind, "" for none; ``article`` is passed over."""
    found: dict[str, str] = {}
    place, fresh = "", False
    for word in words_in(plain_text(text[:MAX_READ])):
        if word == ",":
            place = ""
        elif word == article or (fresh and word in _OF):
            continue
        elif word in PREPOSITIONS:
            place, fresh = word, True
        elif not is_soft(word):
            found[concept_of(word)] = place
            fresh = False
        elif telling(frozenset((word,))):
            place, fresh = word, True
    return found
