"""Clauses: where a sentence is cut, and which of its parts ask for nothing."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from gvla2_plugins.skill import lexicon
from gvla2_plugins.skill.words import is_gerund, noun_class, verbs_of

STOPS = frozenset(",.;:!?")

Joint = Literal["", "and", "stop", "verb"]


@dataclass(frozen=True)
class Clause:
    """Words between two cuts. ``joint`` is the cut before it: "" for the first, "and" for a conjunction, "stop" for a
    punctuation mark, "verb" where another verb begins. ``denied``: a negation follows, so that what it only names
    ("the blue one must not be lifted") is nothing to act on.
    """

    tokens: tuple[str, ...]
    joint: Joint = ""
    denied: bool = False


def clauses(tokens: Sequence[str]) -> list[Clause]:
    """Clauses: parted at stops, at "and", "then", "by pushing" and "to press"; what is not to be done is left out."""
    tokens = _without_auxiliaries(tokens)
    found: list[Clause] = []
    words: list[str] = []
    joint: Joint = ""
    skipping = False

    def cut(next_joint: Joint, *, denied: bool = False) -> None:
        nonlocal words, joint, skipping
        if words and not _leaves_alone(words):
            found.append(Clause(tuple(words), joint if found else "", denied))
        words, joint, skipping = [], next_joint, denied

    for i, token in enumerate(tokens):
        following = tokens[i + 1] if i + 1 < len(tokens) else ""
        if token in STOPS:
            if not (token == ":" and following == "on"):  # "lamp: on"
                cut("stop")
        elif token in ("and", "then", "but", "while"):
            cut("and")
        elif phrase_at(tokens, i, lexicon.NEGATIONS):
            cut("stop", denied=True)
        elif (token in ("by", "through") and is_gerund(following)) or (
            token in ("to", "so") and verbs_of(following) and not noun_use(tokens, i + 1) and words
        ):
            cut("verb")
        elif not skipping:
            words.append(token)
    cut("")
    return found


def phrase_at(tokens: Sequence[str], i: int, phrases: Sequence[str]) -> str:
    """The longest of ``phrases`` that stands at position ``i``, or ""."""
    found = [p for p in phrases if list(tokens[i : i + len(p.split())]) == p.split()]
    return max(found, key=len, default="")


def noun_use(tokens: Sequence[str], i: int) -> bool:
    """Whether a word that can be verb or noun is a noun here: after an article, a colour or an adjective."""
    if i == 0:
        return False
    before = tokens[i - 1]
    adjectives = {w for words in lexicon.SELECTORS.values() for w in words}
    if before in ("this", "that", "another", "s", "single"):
        return bool(noun_class(tokens[i]))
    return (
        before in lexicon.DETERMINERS
        or before in lexicon.COLOUR_WORDS
        or before in adjectives
        or before == "'s"
    )


def _without_auxiliaries(tokens: Sequence[str]) -> list[str]:
    """Without "start", "begin", "keep" where the verb that counts follows: "start by lifting", "keep pushing"."""
    kept = []
    for i, token in enumerate(tokens):
        after = [t for t in tokens[i + 1 : i + 3] if t not in ("by", "with", "on")][:1]
        if not (token in lexicon.AUXILIARIES and after and is_gerund(after[0])):
            kept.append(token)
    return kept


def _leaves_alone(words: Sequence[str]) -> bool:
    """Whether a clause says what is to stay as it is: "leave the others", "ignore the blue one", "it can stay".

    A verb before such a word makes it an action all the same: "lift it so that it stays in the air".
    """
    said = set(words)
    letting = (
        said & lexicon.LETTING
        if said & (lexicon.UNTOUCHED | lexicon.REMAINDER) or words[-1] == "be"
        else set()
    )
    marks = said & (lexicon.STAYING | lexicon.IGNORING) | letting
    if not marks:
        return False
    first = min(words.index(word) for word in marks)
    return not any(verbs_of(words[i]) and not noun_use(words, i) for i in range(first))
