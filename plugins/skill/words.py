"""Words: splitting a sentence, undoing inflections and misspellings, reading lengths."""

from __future__ import annotations

import re
from collections.abc import Iterable
from difflib import SequenceMatcher, get_close_matches
from functools import cache

from gvla2_plugins.skill import lexicon

_TOKEN = re.compile(r"\d+(?:\.\d+)?|[^\W\d_]+(?:'[^\W\d_]+)?|[,.;:!?]")
_DASH = re.compile(r"\s-+\s|[–—]")
"""A dash between words is a stop; a hyphen inside a word is a space."""
_DIGITS = re.compile(r"\d+(?:\.\d+)?")
VOWELS = "aeiou"


def tokenise(sentence: str) -> list[str]:
    """Lower-case words, numbers and stops; ``lamp's`` becomes ``lamp`` and ``'s``, ``15cm`` two tokens."""
    text = sentence.lower().replace("’", "'").replace("_", " ")
    text = re.sub(r"\bcan't\b|\bcannot\b", "can not", text)
    text = re.sub(r"n't\b", " not", text)
    text = _DASH.sub(" , ", text).replace("-", " ")
    tokens: list[str] = []
    for token in _TOKEN.findall(text):
        if token.endswith("'s") and token not in ("let's", "it's"):
            tokens += [token[:-2], "'s"]
        else:
            tokens.append(token)
    return tokens


@cache
def _verb_forms() -> dict[str, frozenset[str]]:
    """Inflected form to the verbs it can be a form of."""
    bases = {
        phrase.split()[0] for phrases in lexicon.VERBS.values() for phrase in phrases
    } | lexicon.UNSUPPORTED
    forms: dict[str, set[str]] = {}
    for base in bases:
        stem = base[:-1] if base.endswith("e") else base
        inflected = [base, base + "s", stem + "ed", stem + "ing"]
        if base.endswith(("s", "sh", "ch", "x", "z", "o")):
            inflected.append(base + "es")
        if len(base) > 2 and base[-1] not in VOWELS + "wxy" and base[-2] in VOWELS:
            inflected += [base + base[-1] + "ed", base + base[-1] + "ing"]
        if base.endswith("y") and base[-2] not in VOWELS:
            inflected += [base[:-1] + "ies", base[:-1] + "ied"]
        for form in inflected:
            forms.setdefault(form, set()).add(base)
    for form, base in lexicon.IRREGULAR.items():
        if base in bases:
            forms.setdefault(form, set()).add(base)
    forms.pop("left", None)  # a side far more often than a form of "leave"
    return {form: frozenset(found) for form, found in forms.items()}


def verbs_of(token: str) -> frozenset[str]:
    """The known verbs that ``token`` is a form of."""
    return _verb_forms().get(token, frozenset())


def is_gerund(token: str) -> bool:
    """Whether it is the -ing form of a known verb."""
    return token.endswith("ing") and bool(verbs_of(token))


@cache
def _noun_classes() -> dict[str, str]:
    classes: dict[str, str] = {}
    for noun, words in lexicon.NOUNS.items():
        for word in words:
            for form in (word, word + "s", word + "es" if word.endswith(("s", "x", "sh", "ch")) else word):
                classes.setdefault(form, noun)
    return classes


def noun_class(token: str) -> str:
    """The noun class of a word, singular or plural, or ""."""
    return _noun_classes().get(token, "")


@cache
def vocabulary() -> frozenset[str]:
    """Every word the grammar knows."""
    words = set(_verb_forms()) | set(_noun_classes()) | set(lexicon.COLOUR_WORDS) | set(lexicon.UNITS)
    words |= (
        lexicon.FILLERS | lexicon.DETERMINERS | lexicon.PRONOUNS | lexicon.TABLE_WORDS | set(lexicon.NUMBERS)
    )
    tables: list[Iterable[str]] = [
        *lexicon.SELECTORS.values(),
        *lexicon.RELATIONS.values(),
        *lexicon.VERBS.values(),
    ]
    tables += [lexicon.DIRECTIONS, lexicon.UNTIL, lexicon.NEGATIONS]
    words |= {word for table in tables for phrase in table for word in phrase.split()}
    words |= lexicon.WISHING | lexicon.SHINING | lexicon.HAND
    words |= lexicon.STAYING | lexicon.IGNORING | lexicon.LETTING | lexicon.UNTOUCHED | lexicon.REMAINDER
    words |= {word for pair in lexicon.SHADES for word in pair} | {unit + "s" for unit in lexicon.UNITS}
    return frozenset(words - {"*"})


def spell(
    tokens: Iterable[str], threshold: float, known: frozenset[str] = frozenset()
) -> tuple[list[str], list[str]]:
    """Tokens with misspelt words replaced, and one sentence a replacement.

    A word of five letters or more is read as the one known word of the same initial that is so much alike; shorter
    ones only where they have the same letters (``pcik``), since one other letter makes another word (``pack``).
    ``known`` are further words that are right (labels of the scene).
    """
    out, notes = [], []
    words = vocabulary() | known
    for token in tokens:
        meant = token if token in words or len(token) < 4 or not token.isalpha() else _guess(token, threshold)
        if meant != token:
            notes.append(f"'{token}' was read as '{meant}'.")
        out.append(meant)
    return out, notes


def _guess(token: str, threshold: float) -> str:
    negations = {word for phrase in lexicon.NEGATIONS for word in phrase.split()}
    telling = vocabulary() - lexicon.FILLERS - lexicon.DETERMINERS - lexicon.PRONOUNS - negations
    near = [w for w in telling if w[0] == token[0] and w.endswith("ed") <= token.endswith("d")]
    mixed = sorted(w for w in near if sorted(w) == sorted(token))
    if mixed and threshold < 1.0:
        return mixed[0]
    near = get_close_matches(token, near, n=4, cutoff=threshold) if len(token) > 4 and threshold < 1.0 else []
    best = near[0] if near else token
    rivals = [w for w in near if not (w.startswith(best) or best.startswith(w))]
    return (
        best if _alike(token, best) > max((_alike(token, w) for w in rivals), default=0.0) + 0.05 else token
    )


def _alike(one: str, other: str) -> float:
    return SequenceMatcher(None, other, one).ratio()


def take_length(tokens: list[str]) -> tuple[list[str], float | None]:
    """The tokens without the first length in them ("by 15 cm", "half a metre"), and it in metres, or None."""
    for i, token in enumerate(tokens):
        value = float(token) if _DIGITS.fullmatch(token) else lexicon.NUMBERS.get(token)
        if value is None:
            continue
        j = i + 1
        while j < len(tokens) and tokens[j] in lexicon.NUMBERS:  # "twenty five", "half a"
            word = lexicon.NUMBERS[tokens[j]]
            value = value * word if value < 1 else value + word
            j += 1
        unit = tokens[j] if j < len(tokens) else ""
        metres = lexicon.UNITS.get(unit) or lexicon.UNITS.get(unit.removesuffix("s"))
        if metres is None or (len(unit) < 3 and unit in ("m", "in") and not _DIGITS.fullmatch(token)):
            continue
        start = i - 1 if i and tokens[i - 1] in ("by", "for") else i
        return tokens[:start] + tokens[j + 1 :], value * metres
    return tokens, None
