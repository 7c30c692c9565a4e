"""Forms of words: which concepts of two texts are the same. Only inflections of one word are: a word that merely
begins like another ("screw" and "screen", "rule" and "ruler") is another thing, and to take two things for one loses
what was known of one of them.
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Set
from functools import lru_cache
from typing import Literal

Language = Literal["en", "de", "fr", "es", ""]
"""A language whose inflections are known, "" where a text does not show it."""


def _marks(text: str) -> frozenset[str]:
    return frozenset(text.split())


_MARKS: dict[Language, frozenset[str]] = {
    "en": _marks(
        "the of and with to it is are be before from for by at this that then when after not its your if until while "
        "should must never always per up out off into onto do don't keep use make without only"
    ),
    "de": _marks(
        "der die das den dem des ein eine einen einem einer und nicht mit vor nach zu zum zur im am ist auf bevor "
        "nachdem sobald wenn nie immer dann erst ohne beim vom bis höchstens mindestens"
    ),
    "fr": _marks(
        "le les une du et à au aux avec avant après dans ne pas est jamais toujours puis vers par sur sans ce "
        "cette il faut quand plus moins"
    ),
    "es": _marks(
        "el los las y al con antes después nunca siempre hacia por para del lo cuando luego en sin hasta una "
        "más menos se"
    ),
}


def _endings(*groups: str) -> tuple[frozenset[str], ...]:
    return tuple(frozenset("" if ending == "-" else ending for ending in group.split()) for group in groups)


_ENDINGS: dict[Language, tuple[frozenset[str], ...]] = {
    # German "-er" is left out: it makes "Schrauber" of "Schraube" as often as "roter" of "rote".
    "de": _endings("- e en es em n s", "- e en t st te ten end"),
    "fr": _endings(
        "- s e es",
        "e es er ez ee ees ent ant ons",
        "ir is it i ie isse issez issent issant",
        "re s - ez ant u ue us ues",
        "al aux ale ales",
        "eau eaux",
    ),
    # Spanish "-o" and "-a" part "palo" from "pala"; they are forms of one word in adjectives and participles alone.
    "es": _endings(
        "- s es",
        "a ar as e en an ad ando ado ada ados adas",
        "e er ir es a an en ed id iendo ido ida idos idas",
        "z ces",
    ),
}
_ADJECTIVES = re.compile(
    r"(?:roj|blanc|negr|amarill|limpi|suci|nuev|viej|pesad|liger|metálic|plástic|llen|vací|sec|mojad|fin|grues|larg"
    r"|cort|rápid|lent|anch|estrech|plan|redond|cuadrad|rot|ambigu)(?:o|a|os|as)"
)
_EASES = re.compile(r"(?:[dt]|[^aeioulrhmn][mn])e?")
"""German stems that put an "e" before a "t": "arbeitet", "öffnet"."""
_SHORT = re.compile(r"[^aeiouy]*[aeiouy][^aeiouwxy]")
"""One vowel before one consonant: in English another word with an "e" behind it, "tub" and "tube"."""


def language_of(words: Set[str]) -> Language:
    """The language that most of the words mark, "" for a text in which none or two do alike."""
    best: Language = ""
    most = 0
    for language, marks in _MARKS.items():
        count = len(words & marks)
        if count > most:
            best, most = language, count
        elif count == most:
            best = ""
    return best


def common(first: Language, second: Language) -> Language:
    """The language by which words of two texts are compared: the one that is known, the stricter English of two."""
    if first == second or not second:
        return first
    return second if not first or second == "en" else "en" if first == "en" else ""


@lru_cache(maxsize=65536)
def alike(first: str, second: str, language: Language = "") -> bool:
    """Whether two concepts are the same or inflections of one word; where no ``language`` shows, of German, French or
    Spanish. English words come here as stems, and identifiers are never alike.
    """
    if first == second:
        return True
    if first[-1] in "+-" or second[-1] in "+-" or not (first.isalpha() and second.isalpha()):
        return False
    one, two = folded(first), folded(second)
    shared = 0
    for a, b in zip(one, two, strict=False):
        if a != b:
            break
        shared += 1
    if shared < 3:
        return False
    if one == two:
        return True
    if {one[shared:], two[shared:]} == {"", "e"} and shared >= 5 and not _SHORT.fullmatch(one[:shared]):
        return True  # what English "-ing" and "-ed" leave of "configure"
    if language == "en" or (
        not language and {one[shared:], two[shared:]} == {"", "e"} and _SHORT.fullmatch(one[:shared])
    ):
        return False
    if _ADJECTIVES.fullmatch(first) and _ADJECTIVES.fullmatch(second):
        return one.rstrip("s")[:-1] == two.rstrip("s")[:-1]
    return any(_inflected(one, two, shared, tongue) for tongue in _ENDINGS if language in ("", tongue))


def _inflected(one: str, two: str, shared: int, language: Language) -> bool:
    """Whether some stem, the longest shared beginning or a little less, takes both endings in the language."""
    for length in range(shared, max(shared - 4, 2), -1):
        ends = {one[length:], two[length:]}
        if any(ends <= group for group in _ENDINGS[language]) and (
            language != "de" or _german(one[:length], ends)
        ):
            return True
    return False


def _german(stem: str, ends: Set[str]) -> bool:
    if not ends & {"t", "st", "te", "ten"}:
        return True
    if stem.endswith("e"):
        return _EASES.fullmatch(stem[-3:].lstrip("aeiou")[-3:]) is not None
    return len(stem) >= 4 and not ends <= {"te", "ten"}


@lru_cache(maxsize=65536)
def folded(word: str) -> str:
    """The word without accents."""
    if word.isascii():
        return word
    return "".join(c for c in unicodedata.normalize("NFD", word) if not unicodedata.combining(c))


def starts_of(words: Set[str]) -> frozenset[str]:
    """How the words begin. Forms of one word begin alike: where the starts of some words are not all among those of
    others, one of the words is for certain no form of any of the others.
    """
    return frozenset([folded(word)[:3] for word in words])


def may_be_alike(first: str, second: str) -> bool:
    """Whether it is worth asking :func:`alike`: forms of one word begin with one letter, accents aside."""
    return first[0] == second[0] or not (first.isascii() and second.isascii())


def split_alike(
    first: Set[str], second: Set[str], language: Language = ""
) -> tuple[list[str], list[str], list[str]]:
    """What both have, what only the first has, and what only the second has, sorted; forms of a word are one."""
    both, left, right = set(first & second), first - second, second - first
    if left and right:
        fitting = {
            (word, other)
            for word in left
            for other in right
            if may_be_alike(word, other) and alike(word, other, language)
        }
        if fitting:
            both |= {word for word, _ in fitting}
            left = left - {word for word, _ in fitting}
            right = right - {other for _, other in fitting}
    return sorted(both), sorted(left), sorted(right)
