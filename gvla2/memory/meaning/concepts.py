"""The words of a text and what they stand for: scripts without spaces are cut by the lexicon, endings taken off."""

from __future__ import annotations

import re
from functools import lru_cache

from gvla2.memory.meaning.inflections import pole_of
from gvla2.memory.meaning.lexicon import CONCEPTS, NEGATORS, SEGMENTS
from gvla2.memory.meaning.verb_forms import verb_of

WORD = re.compile(r"[^\W_]+(?:['’_][^\W_]+)*|,")
HAN = re.compile(r"[\u3400-\u9fff]+")
_SEGMENT_LENGTHS = sorted({len(word) for word in SEGMENTS}, reverse=True)
_TAPE = re.compile(r"[^aeiouy]*[aeiouy][^aeiouwxy]")
"""What is left of "taping" but not of "tapping" (which doubles) or "boxing"."""
_MUTE = re.compile(
    r"(?:.*[cvzu]|.*[^s]s|.*[^aeiou]at|.*[aeiou][bcdfgkptz]l|.*[bcdfgkptz]l|.*(?:[^aeo]|qu)ur|.*[dr]g)"
)
"""What is left of words that end in a silent "e": "slicing", "releasing", "rotating", "handling", "measuring"."""


def words_in(text: str) -> list[str]:
    """Words and commas of a casefolded text, in reading order."""
    found: list[str] = []
    spoken: list[str] = WORD.findall(text.replace("n't", "n't "))
    if "'" not in text and (text.isascii() or HAN.search(text) is None):
        return spoken
    for word in spoken:
        head, _, tail = word.partition("'")
        for part in [word] if word in NEGATORS else [p for p in (head, tail) if p]:
            last = 0
            for run in HAN.finditer(part):
                found += [part[last : run.start()]] if run.start() > last else []
                found += _cut(run.group())
                last = run.end()
            found += [part[last:]] if last < len(part) else []
    return found


def _cut(run: str) -> list[str]:
    """A run of Han characters, cut by the words that the lexicons know; what is left over stays whole."""
    words: list[str] = []
    start = rest = 0
    while start < len(run):
        length = next((n for n in _SEGMENT_LENGTHS if run[start : start + n] in SEGMENTS), 0)
        if length:
            words += [run[rest:start]] if start > rest else []
            words.append(run[start : start + length])
            rest = start + length
        start += length or 1
    return words + ([run[rest:]] if rest < len(run) else [])


@lru_cache(maxsize=32768)
def concept_of(word: str) -> str:
    """What a word stands for: its entry in the lexicon, or its stem."""
    if word in CONCEPTS:
        return CONCEPTS[word]
    stem = stem_of(word)
    known = CONCEPTS.get(stem) or pole_of(word)
    if known is None and (verb := verb_of(word)):
        return CONCEPTS.get(verb) or pole_of(verb) or verb
    return known or stem


def stem_of(word: str) -> str:
    """English endings off; other languages are compared by theirs (:func:`gvla2.memory.meaning.word_forms.alike`)."""
    for ending in ("ings", "ing", "ies", "ied", "ed", "es", "s"):
        least = 2 if ending in ("ies", "ied") else 3
        if word.endswith(ending) and len(word) - len(ending) >= least and not word.endswith("ss"):
            stem = word[: -len(ending)]
            if ending in ("ies", "ied"):
                return stem + "y"
            if ending == "es":
                return stem if stem.endswith(("ss", "x", "zz", "tz", "ch", "sh")) else stem + "e"
            return stem if ending == "s" else _verb(stem)
    return word


def _verb(stem: str) -> str:
    """The verb whose "-ing" and "-ed" leave the stem: "rotat" is of "rotate", "stirr" of "stir"."""
    if stem in CONCEPTS:
        return stem
    if len(stem) > 3 and stem[-1] == stem[-2] and stem[-1] not in "sl":
        return stem[:-1]
    if len(stem) > 3 and stem.endswith("ll") and stem[:-1] in CONCEPTS:
        return stem[:-1]
    if _TAPE.fullmatch(stem) or _MUTE.fullmatch(stem):
        return stem + "e"
    return stem
