"""Words: splitting a sentence, undoing inflections, reading lengths."""

from __future__ import annotations

import re
from functools import cache
from math import prod

from gvla2_plugins.skill import lexicon

_TOKEN = re.compile(r"(?:\d*\.)?\d+|'s\b|[^\W\d_]+(?:'[^\W\d_]+)?|[,.;:!?]")
_LENGTH = re.compile(
    rf"(?:\b(?:by|for) )?(?P<sign>\b(?:minus|negative) )?"
    rf"(?:(?P<digits>(?:\d*\.)?\d+) |\b(?P<words>(?:(?:{'|'.join(lexicon.NUMBERS)}) )+))"
    rf"(?P<unit>{'|'.join(lexicon.UNITS)})s?\b"
)
_SINGULAR = {word: noun for noun, listed in lexicon.NOUNS.items() for word in listed}
_PLURAL = {w + ("es" if w.endswith(("s", "x", "sh", "ch")) else "s"): noun for w, noun in _SINGULAR.items()}
_NOUN_CLASSES = _PLURAL | _SINGULAR


def tokenise(sentence: str) -> list[str]:
    """Lower-case words, numbers and stops; ``lamp's`` becomes ``lamp`` and ``'s``, ``15cm`` two tokens."""
    text = sentence.lower().replace("’", "'").replace("_", " ")
    text = re.sub(r"\bcan't\b|\bcannot\b", "can not", text)
    text = re.sub(r"n't\b", " not", text)
    text = re.sub(r"(?<!\blet)(?<!\bit)'s\b", " 's", text)
    text = re.sub(r"(?<!\w)[-−–—]\s?(?=\.?\d)", " minus ", text)
    text = re.sub(r"\s-+\s|[–—]", " , ", text)  # a dash between words is a stop, a hyphen in one a space
    return _TOKEN.findall(text.replace("-", " "))


@cache
def _verb_forms() -> dict[str, frozenset[str]]:
    """Inflected form to the verbs it can be a form of."""
    bases = {phrase.split()[0] for listed in lexicon.VERBS.values() for phrase in listed}
    forms: dict[str, set[str]] = {}
    for base in bases:
        stem, doubled = base.removesuffix("e"), base + base[-1]
        inflected = {base, f"{base}s", f"{base}es", re.sub("y$", "ies", base), re.sub("y$", "ied", base)}
        inflected |= {each + ending for each in (stem, doubled) for ending in ("ed", "ing")}
        for form in inflected:  # and some that are no words
            forms.setdefault(form, set()).add(base)
    for form, base in lexicon.IRREGULAR.items():
        forms.setdefault(form, set()).add(base)
    for form in lexicon.STANDING:
        forms.pop(form, None)
    return {form: frozenset(found) for form, found in forms.items()}


def verbs_of(token: str) -> frozenset[str]:
    """The known verbs that ``token`` is a form of."""
    return _verb_forms().get(token, frozenset())


def noun_class(token: str) -> str:
    """The noun class of a word, singular or plural, or ""."""
    return _NOUN_CLASSES.get(token, "")


def take_length(tokens: list[str]) -> tuple[list[str], float | None]:
    """The tokens without the first length in them ("by 15 cm", "minus half a metre"), and it in metres, or None."""
    said = _LENGTH.search(text := " ".join(tokens))
    if said is None or (said["words"] and said["unit"] in ("m", "in")):
        return tokens, None
    counted = [lexicon.NUMBERS[word] for word in (said["words"] or "").split()]
    worded = prod(counted) if min(counted, default=1) < 1 else sum(counted)  # half a, twenty five
    value = float(said["digits"] or worded) * (-1.0 if said["sign"] else 1.0)
    return (text[: said.start()] + text[said.end() :]).split(), value * lexicon.UNITS[said["unit"]]
