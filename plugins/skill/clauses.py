"""Clauses: where a sentence is cut, and which of its parts ask for nothing."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from itertools import pairwise

from gvla2.planning.colours import FAMILIES
from gvla2_plugins.skill import lexicon
from gvla2_plugins.skill.words import noun_class, verbs_of

STOPS = frozenset(",.;:!?")
ANDS = ("and", "then", "but", "while")
LONGEST = 6

Clause = tuple[list[str], str, bool]
"""Words between two cuts; the cut before them ("", "and", "stop", or "verb" where another verb begins); and whether a
negation follows, so that what they only name ("the blue one must not be lifted") is nothing to act on."""


def clauses(tokens: Sequence[str]) -> tuple[list[Clause], list[tuple[str, ...]]]:
    """Clauses, parted at stops, "and", "by pushing", "to press"; and the words of what is not to be done or meant."""
    pieces: list[tuple[str, list[str]]] = [("", [])]
    for i, token in enumerate(tokens):
        joint, words = pieces[-1]
        cut = "stop" if token in STOPS else "not" if _negates(tokens, i) else "and" if token in ANDS else ""
        if cut or (joint != "not" and _verb_follows(tokens, i)):
            pieces.append((cut or "verb", []))
        else:
            words.append(token)
    found, denials = [], []
    for (joint, words), (following, _) in pairwise([*pieces, ("", [])]):
        denied = following == "not"
        if joint == "not":
            denials += [tuple(words)] if words or not denied else []
        elif words and not (denied and _ruled_out(words)):
            found.append((words, joint, denied))
    return found, denials


def _verb_follows(tokens: Sequence[str], i: int) -> bool:
    """Whether another verb begins after the word at ``i``: "by pushing", "to press"."""
    following = "".join(tokens[i + 1 : i + 2])
    joins = tokens[i] in ("to", "so") or (tokens[i] in ("by", "through") and following.endswith("ing"))
    return joins and bool(verbs_of(following)) and not noun_use(tokens, i + 1)


def _negates(tokens: Sequence[str], i: int) -> bool:
    """Whether from ``i`` on it is said what is not meant: "without", "do not", "any cube but"."""
    among = tokens[i] == "but" and lexicon.EACH & set(tokens[:i])
    return bool(among or phrase_at(tokens, i, lexicon.NEGATIONS))


def phrase_at(tokens: Sequence[str], i: int, phrases: Collection[str]) -> str:
    """The longest of ``phrases`` that stands at position ``i``, or ""; none has more than ``LONGEST`` words."""
    spans = (" ".join(tokens[i : i + n]) for n in range(LONGEST, 0, -1))
    return next((span for span in spans if span in phrases), "")


def noun_use(tokens: Sequence[str], i: int) -> bool:
    """Whether a word that can be verb or noun is a noun here: after an article, a colour or an adjective."""
    before = tokens[i - 1] if i else ""
    if before in ("this", "that", "another", "s", "single"):
        return bool(noun_class(tokens[i]))
    selects = any(before in words for words in lexicon.SELECTORS.values())
    return selects or before in lexicon.DETERMINERS or before in FAMILIES or before == "'s"


def _ruled_out(words: Sequence[str]) -> bool:
    """Whether what follows is denied of a thing ("the box is not ..."), not of which thing is meant ("that is not")."""
    return words[-1] in lexicon.BEING and words[-2:-1] not in (["that"], ["which"], ["who"])
