"""Forms of opposing words that the table leaves out: "unheated", "öffne" of "öffnen", "visse" of "visser", 未密封."""

from __future__ import annotations

from collections.abc import Iterator

from gvla2.memory.meaning.function_words import FUNCTION_WORDS
from gvla2.memory.meaning.lexicon import CONCEPTS, POLES, SOFT
from gvla2.memory.meaning.word_sets import word_set

_OTHER = {"+": "-", "-": "+"}
_WORDS_OF_THEIR_OWN = word_set(
    "tire cache pare sale mince retire couple ate opt loose unit united union unique until hint wart"
)
"""English words that are forms of others by chance."""
_SPANISH = ("ados", "adas", "ando", "ado", "ada", "an", "en", "a", "e")
_FRENCH = ("ées", "ez", "ée", "és", "é", "es")


def pole_of(word: str) -> str | None:
    """The concept of a form of an opposing word, None for any other word."""
    if word in _WORDS_OF_THEIR_OWN or word in FUNCTION_WORDS or word in SOFT:
        return None
    for prefix, least in (("un", 6), ("未", 3)):
        if len(word) >= least and word.startswith(prefix):
            concept = CONCEPTS.get(word[len(prefix) :], "")
            return concept[:-1] + _OTHER[concept[-1]] if concept in POLES else None
    if len(word) < 4 or word >= "\u3400":
        return None
    for infinitive in _infinitives(word):
        concept = CONCEPTS.get(infinitive, "")
        if concept in POLES:
            return concept
    return None


def _infinitives(word: str) -> Iterator[str]:
    """The verbs that a word may be a form of: German "-en" ("ziehe", "zieht", "zieh"), French "-er", Spanish "-ar"."""
    if word[-1] == "e":
        yield word + "n"
        yield word + "r"
    elif word[-1] == "t" and len(word) > 4:
        yield word[:-1] + "en"
        yield word[:-2] + "en"
    elif word[-1].isalpha():
        yield word + "en"
    for ending in _FRENCH:
        if word.endswith(ending):
            yield word.removesuffix(ending) + "er"
    for ending in _SPANISH:
        if word.endswith(ending) and len(word) - len(ending) > 2:
            yield word.removesuffix(ending) + "ar"
