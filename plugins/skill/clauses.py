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


def clauses(tokens: Sequence[str]) -> tuple[list[Clause], list[tuple[str, ...]]]:
    """Clauses, parted at stops, at "and", "then", "by pushing" and "to press"; and apart from them the words that say
    what is not to be done, or not to what.
    """
    tokens = _without_auxiliaries(tokens)
    found: list[Clause] = []
    words: list[str] = []
    joint: Joint = ""
    denials: list[tuple[str, ...]] = []
    skipping = False
    done = 0

    def cut(next_joint: Joint, *, denied: bool = False) -> None:
        nonlocal words, joint, skipping
        if skipping:
            denials.append(tuple(words))
        elif words and not _leaves_alone(words):
            found.append(Clause(tuple(words), joint if found else "", denied))
        words, joint, skipping = [], next_joint, denied

    for i, token in enumerate(tokens):
        if i < done:
            continue
        following = tokens[i + 1] if i + 1 < len(tokens) else ""
        if token in STOPS:
            if not (token == ":" and following == "on"):  # "lamp: on"
                cut("stop")
        elif said := _negation(tokens, i):
            cut("stop", denied=True)
            done = i + len(said.split())
        elif token in ("and", "then", "but", "while"):
            cut("and")
        elif (not skipping and (token in ("by", "through") and is_gerund(following))) or (
            not skipping
            and (token in ("to", "so") and verbs_of(following) and not noun_use(tokens, i + 1) and words)
        ):
            cut("verb")
        else:
            words.append(token)
    cut("")
    return found, [d for d in denials if d]


def _negation(tokens: Sequence[str], i: int) -> str:
    """The wording at ``i`` from which on it is said what is not meant: "without", "do not", "any cube but"."""
    if said := phrase_at(tokens, i, lexicon.NEGATIONS):
        return said
    among = lexicon.AMONG & set(tokens[:i])
    return "but" if tokens[i] == "but" and among and tokens[i + 1 : i + 2] != ["then"] else ""


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
