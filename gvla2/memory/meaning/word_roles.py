"""What a word does where it stands in a clause: whether it is an act or a thing, a direction or part of a verb, of time
or of place, or says nothing.
"""

from __future__ import annotations

from collections.abc import Sequence

from gvla2.memory.meaning.concepts import stem_of
from gvla2.memory.meaning.function_words import FUNCTION_WORDS
from gvla2.memory.meaning.lexicon import (
    AFTER,
    BEFORE,
    BEFORE_VERBS,
    CONCEPTS,
    CONDITIONS,
    DETERMINERS,
    FIRST,
    NEGATORS,
    NOUNS,
    PARTICLE_VERBS,
    PLACES,
    POLES,
    SOFT,
)
from gvla2.memory.meaning.word_forms import Language
from gvla2.memory.meaning.word_sets import word_set

_STATE_ENDS = CONDITIONS | BEFORE | AFTER | {",", "and", "or", "then"}
_BEING = word_set("is are was were be been being")
_INDEFINITE = word_set("a an ein eine einen un una une")
_USING = word_set(
    "use take choose pick select with verwende nimm benutze mit utiliser utilise utilisez avec usa usar con"
)
_SOFT = SOFT | FUNCTION_WORDS | FIRST | {"erst", "only", "seulement", "solo", "sólo", "once", "才", "先"}
_ENGLISH = word_set("pour bin die van ton hat son pan fin par met dan mine sin con net mit dal col")
"""English words that say nothing in some other language."""


def ends_a_time(words: Sequence[str], index: int) -> bool:
    """Whether a Chinese "before" or "after" closes what comes before or after: an act follows."""
    if not 0 < index < len(words) - 1:
        return False
    if len(words[index]) > 1:
        return True
    return words[index - 1] not in ("向", "往", "从", "朝", ",") and words[index + 1] not in (
        "边",
        "面",
        "侧",
    )


def until_an_act(words: Sequence[str], index: int) -> bool:
    """Whether a word that may say "until" does: German "bis zur Kante" tells how far, Spanish "hasta" how many."""
    following = words[index + 1] if index + 1 < len(words) else ""
    if words[index] == "hasta":
        return following == "que"
    return bool(following) and following not in ("zu", "zum", "zur")


def is_soft(word: str, language: Language = "") -> bool:
    """Whether a word says nothing about who does what."""
    if language in ("en", "") and word in _ENGLISH:
        return False
    return word in _SOFT or (len(word) == 1 and word.isascii())


def is_ordinal(word: str, words: Sequence[str], index: int) -> bool:
    """Whether "first" tells which thing is meant ("the first layer") rather than when."""
    return word == "first" and 0 < index < len(words) - 1 and words[index - 1] in DETERMINERS


def is_noun(word: str, words: Sequence[str], index: int, language: Language) -> bool:
    """Whether an English act stands as a thing: "at the start", "the clamp"."""
    if not index or language not in ("en", "") or not (word in NOUNS or word.removesuffix("s") in NOUNS):
        return False
    before = words[index - 1]
    if before in DETERMINERS or index + 1 == len(words):
        return before not in BEFORE_VERBS
    return before not in BEFORE_VERBS and not before.endswith("ly") and words[index + 1] not in DETERMINERS


def is_particle(word: str, words: Sequence[str], index: int) -> bool:
    """Whether a word is none of direction or act: "up" in "pick up", "close" in "close to"."""
    if word in ("up", "down", "over", "back", "under"):
        if index and words[index - 1] in DETERMINERS:
            return False
        return any(
            w in PARTICLE_VERBS or stem_of(w) in PARTICLE_VERBS for w in words[max(0, index - 3) : index]
        )
    return (
        word in ("close", "more", "less", "mehr", "más", "moins", "menos")
        and index + 1 < len(words)
        and (words[index + 1] in ("to", "than", "als", "que", "de"))
    )


def is_temporal(word: str, words: Sequence[str], index: int) -> bool:
    """German "vor" and "nach", French "avant": of time before an act or a thing, of place before a side."""
    following = words[index + 1] if index + 1 < len(words) else ""
    return not (
        word in ("nach", "vor")
        and POLES.get(CONCEPTS.get(following, ""), ("",))[0] in ("side", "height", "depth")
    )


def names_a_thing(word: str, words: Sequence[str], index: int) -> bool:
    """Whether an opposing word tells which thing is meant ("the left drawer") rather than which way."""
    before = words[index - 1] if index else ""
    after = words[index + 1] if index + 1 < len(words) else ""
    if after in PLACES or before in PLACES:
        return False
    if before in _INDEFINITE and index > 1 and (words[0] in _USING or words[index - 2] in _USING):
        return False  # "use a wet sponge" tells what to choose
    if word in ("izquierdo", "derecho"):
        return True
    if word in ("gauche", "droite", "izquierda", "derecha"):
        return before not in ("la", "à", "a", "vers", "hacia")
    if word in ("左", "右", "上", "下", "前", "后"):
        return before not in ("向", "往", "从", "朝") and after not in ("边", "侧")
    is_last = not after or after in FUNCTION_WORDS or is_soft(after) or after in NEGATORS
    return before in DETERMINERS and not is_last


def is_state(words: Sequence[str], index: int) -> bool:
    """Whether "on" or "off" tells of a state, "while it is off", "with the motor on", and of no place."""
    if index + 1 < len(words) and words[index + 1] not in _STATE_ENDS:
        return False
    before = words[index - 1] if index else ""
    if before in _BEING:
        return True
    return "with" in words[max(0, index - 4) : index - 1] and before not in FUNCTION_WORDS
