"""Clauses: where a sentence is cut, and which of its parts ask for nothing."""

from __future__ import annotations

from collections.abc import Collection, Sequence

from gvla2.planning.colours import FAMILIES
from gvla2_plugins.skill import lexicon
from gvla2_plugins.skill.words import noun_class, verbs_of

STOPS = frozenset(",.;:!?")
LONGEST = 6

Clause = tuple[list[str], str, bool]
"""Words between two cuts; the cut before them ("", "and", "stop", or "verb" where another verb begins); and whether a
negation follows, so that what they only name ("the blue one must not be lifted") is nothing to act on."""


def clauses(tokens: Sequence[str]) -> tuple[list[Clause], list[tuple[str, ...]]]:
    """Clauses, parted at stops, "and", "by pushing", "to press"; and the words of what is not to be done or meant."""
    found: list[Clause] = []
    words: list[str] = []
    joint = ""
    denials: list[tuple[str, ...]] = []
    skipping = False

    def cut(next_joint: str, *, denied: bool = False) -> None:
        nonlocal words, joint, skipping
        if skipping and (words or not denied):
            denials.append(tuple(words))
        elif words and not _leaves_alone(words) and not (denied and _ruled_out(words)):
            found.append((words, joint if found else "", denied))
        words, joint, skipping = [], next_joint, denied

    for i, token in enumerate(tokens):
        following = tokens[i + 1] if i + 1 < len(tokens) else ""
        if token in STOPS:
            cut("stop")
        elif _negates(tokens, i):
            cut("stop", denied=True)
        elif token in ("and", "then", "but", "while"):
            cut("and")
        elif not skipping and (
            (token in ("by", "through") and following.endswith("ing") and verbs_of(following))
            or (token in ("to", "so") and words and verbs_of(following) and not noun_use(tokens, i + 1))
        ):
            cut("verb")
        else:
            words.append(token)
    cut("")
    return found, denials


def _negates(tokens: Sequence[str], i: int) -> bool:
    """Whether from ``i`` on it is said what is not meant: "without", "do not", "any cube but"."""
    among = tokens[i] == "but" and lexicon.EACH & set(tokens[:i]) and tokens[i + 1 : i + 2] != ["then"]
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


def _leaves_alone(words: Sequence[str]) -> bool:
    """Whether a clause says what is to stay as it is: "leave the others", "ignore the blue one", "it can stay".

    A verb before such a word makes it an action all the same: "lift it so that it stays in the air".
    """
    said = set(words)
    letting = said & (lexicon.UNTOUCHED | lexicon.REMAINDER) or words[-1] == "be"
    marks = said & lexicon.STAYING | (said & lexicon.LETTING if letting else set())
    first = min((words.index(word) for word in marks), default=0)
    acts = (i for i in range(first) if words[i] != "let" and verbs_of(words[i]) and not noun_use(words, i))
    return bool(marks) and next(acts, None) is None
