"""Words: splitting a sentence, undoing inflections and misspellings, reading lengths."""

from __future__ import annotations

import re
from collections.abc import Iterable
from difflib import get_close_matches
from functools import cache

from gvla2.planning.colours import FAMILIES
from gvla2_plugins.skill import lexicon

_TOKEN = re.compile(r"\d+(?:\.\d+)?|'s\b|[^\W\d_]+(?:'[^\W\d_]+)?|[,.;:!?]")
_DIGITS = re.compile(r"\d+(?:\.\d+)?")


def tokenise(sentence: str) -> list[str]:
    """Lower-case words, numbers and stops; ``lamp's`` becomes ``lamp`` and ``'s``, ``15cm`` two tokens."""
    text = sentence.lower().replace("’", "'").replace("_", " ")
    text = re.sub(r"\bcan't\b|\bcannot\b", "can not", text)
    text = re.sub(r"n't\b", " not", text)
    text = re.sub(r"(?<!\blet)(?<!\bit)'s\b", " 's", text)
    text = re.sub(r"\s-+\s|[–—]", " , ", text)  # a dash between words is a stop, a hyphen in one a space
    return _TOKEN.findall(text.replace("-", " "))


@cache
def _verb_forms() -> dict[str, frozenset[str]]:
    """Inflected form to the verbs it can be a form of."""
    bases = {phrase.split()[0] for listed in lexicon.VERBS.values() for phrase in listed}
    forms: dict[str, set[str]] = {}
    for base in bases:
        stem = base[:-1] if base.endswith("e") else base
        inflected = [base, base + "s", stem + "ed", stem + "ing"]
        inflected += [base + "es"] * base.endswith(("s", "sh", "ch", "x", "z", "o"))
        if len(base) > 2 and base[-1] not in "aeiouwxy" and base[-2] in "aeiou":
            inflected += [base + base[-1] + "ed", base + base[-1] + "ing"]
        if base.endswith("y") and base[-2] not in "aeiou":
            inflected += [base[:-1] + "ies", base[:-1] + "ied"]
        for form in inflected:
            forms.setdefault(form, set()).add(base)
    for form, base in lexicon.IRREGULAR.items():
        if base in bases:
            forms.setdefault(form, set()).add(base)
    for form in lexicon.STANDING:
        forms.pop(form, None)
    return {form: frozenset(found) for form, found in forms.items()}


def verbs_of(token: str) -> frozenset[str]:
    """The known verbs that ``token`` is a form of."""
    return _verb_forms().get(token, frozenset())


@cache
def _noun_classes() -> dict[str, str]:
    words = [(word, noun) for noun, listed in lexicon.NOUNS.items() for word in listed]
    plurals = [(w + ("es" if w.endswith(("s", "x", "sh", "ch")) else "s"), noun) for w, noun in words]
    return dict([*plurals, *words])


def noun_class(token: str) -> str:
    """The noun class of a word, singular or plural, or ""."""
    return _noun_classes().get(token, "")


@cache
def vocabulary() -> frozenset[str]:
    """Every word the grammar knows."""
    tables = [t for name, t in vars(lexicon).items() if name.isupper() and isinstance(t, frozenset | dict)]
    plural = {f"{unit}s" for unit in lexicon.UNITS}
    return frozenset({*_verb_forms(), *_noun_classes(), *FAMILIES, *plural, *_words_of(tables), "grey"})


def _words_of(listed: object) -> set[str]:
    """All words of phrases in tables of any depth, keys and values."""
    if isinstance(listed, str):
        return set(re.findall(r"[a-z]+", listed))
    inner = (*listed, *listed.values()) if isinstance(listed, dict) else listed
    return {word for item in inner for word in _words_of(item)} if isinstance(inner, Iterable) else set()


def spell(
    tokens: Iterable[str], threshold: float, known: frozenset[str] = frozenset()
) -> tuple[list[str], list[str]]:
    """Tokens with misspelt words replaced, and one sentence a replacement; ``known`` are further words that are right.

    A word of five letters or more is read as the one known word of the same initial that is so much alike; shorter
    ones only where they have the same letters (``pcik``), since one other letter makes another word (``pack``).
    """
    out, notes = [], []
    words = vocabulary() | known
    for token in tokens:
        sound = token in words or len(token) < 4 or not token.isalpha() or threshold >= 1.0
        meant = token if sound else _guess(token, threshold)
        if meant != token:
            notes.append(f"'{token}' was read as '{meant}'.")
        out.append(meant)
    return out, notes


def _guess(token: str, threshold: float) -> str:
    small = lexicon.FILLERS | lexicon.DETERMINERS | lexicon.PRONOUNS | lexicon.TURNING | {*lexicon.CONTENTS}
    alike = [w for w in sorted(vocabulary() - small) if w[0] == token[0]]
    near = [w for w in alike if w.endswith("ed") <= token.endswith("d")]
    if mixed := [w for w in near if sorted(w) == sorted(token)]:
        return mixed[0]
    best, *rivals = (get_close_matches(token, near, 4, threshold) if len(token) > 4 else []) or [token]
    same = [w for w in rivals if not (w.startswith(best) or best.startswith(w))]  # no other form of it
    return token if same else best


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
