"""What an English text says: its clauses, what comes before what, and what is taken rather than what.

Compact on purpose: it reads for the features of :mod:`gvla2.memory.meaning.features`, where a wrong guess costs a
little probability, not a decision.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import lru_cache

from gvla2.memory.meaning.clauses import Clause, Order, Words, clause_of, content
from gvla2.memory.meaning.english import IDIOMS, MAX_READ, WORD
from gvla2.memory.meaning.plain_text import plain_text

_SENTENCE = re.compile(r"[!?;\n]+|\.(?=\s|$)")
_DOES = (
    r"(?:goes|is|are|was|were|has|have|had|must|should|may|can|needs?|belongs?|takes?|gets?|stands?|hangs?|comes?|stays?"
    r"|works?|holds?|slips?|beats?|go|runs?|listens?|looks?|sits?)\b"
)
_NUMBERED = re.compile(
    r"(?P<name>(?:^|(?<=[.;,:] )|(?<=\bon )|(?<=\bat )|(?<=\bthe ))[a-z]{3,}) (?P<number>\d{1,4})"
    rf" (?={_DOES})"
)
"""A number behind a noun and before what it does names one of several: "waypoint 3 was reached"."""
_STEP = re.compile(
    r",?\s*\b(?:and )?then\b,?\s*|,\s+(?:and|but)\s+|\s+but\s+"
    r"|\s+and\s+(?=\w+\s+(?:the|a|an|it|them|its|each|every|all|to|by|for|at|in|into|on|with|from|after|before|lightly"
    r"|slowly|gently|only|until|afterwards?|later|next|last|first)\b)"
)
_ANY_AND = re.compile(r",?\s*\b(?:and )?then\b,?\s*|,?\s+and\s+|,\s+")
_FIRST = re.compile(r"\b(?:first|to begin with)\b")
_LATER = re.compile(r"\b(?:afterwards?|after that|later|last|next|finally|subsequently)\b")
_INSTEAD = re.compile(r"^\s*(?:rather than|instead of)\s+(?P<two>[^,]+),\s*(?P<one>.+)")
_CHOSEN = re.compile(
    r"(?P<one>.+?),?\s+(?:rather than|instead of|in place of|in preference to|and not)\s+(?P<two>.+)"
    r"|(?P<one4>.+?)\s+(?:(?:is|are|was|were|works?|worked|does|do) (?:\w+ )?better than|beats?)\s+(?P<two4>.+)"
    r"|(?:.*?\b)?(?:prefer|trust|choose|favou?r|pick)\w*\s+(?P<one2>.+?)\s+(?:over|to|before)\s+(?P<two2>.+)"
    r"|(?P<one3>.+?),\s+(?:and |but )?(?:not|never)\s+(?P<two3>.+)"
    r"|(?:do not|don't|never|avoid)\s+(?:use |take |using |taking )(?P<two5>[^,]+?)(?:,| but)\s+(?:but )?(?P<one5>.+)"
)
_NOT = re.compile(r"\b(?:not|never|don't|avoid)\b")
_CASE = re.compile(r"\s*(?:if|when|while|once|unless|after|before|until|with|without|for|in|on|at)\b")


@dataclass(frozen=True)
class Reading:
    """A text taken apart. ``orders`` are pairs of what comes before and what after; ``choices`` what is taken and
    what left; ``words`` all stems.
    """

    clauses: tuple[Clause, ...]
    orders: tuple[Order, ...]
    choices: tuple[Order, ...]
    words: Words


@lru_cache(maxsize=4096)
def read(text: str) -> Reading:
    """The reading of an English text; of any other, whatever it may give."""
    clauses: list[Clause] = []
    orders: list[Order] = []
    choices: list[Order] = []
    plain = _NUMBERED.sub(r"\g<name> nr\g<number> ", plain_text(text[:MAX_READ]))
    for sentence in _SENTENCE.split(IDIOMS.sub(_positive, plain)):
        parts: list[Words] = []
        first = last = -1
        for step in _steps(sentence):
            taken, left = _choice(step)
            if taken and left:
                choices.append((content(taken), content(left)))
            clause, order = clause_of(step, left)
            clauses.append(clause)
            orders += [order] if order else []
            first = len(parts) if _FIRST.search(step) else first
            last = len(parts) if _LATER.search(step) else last
            parts.append(order[0] | order[1] if order else clause.everything)
        if len(parts) == 2 and (first > 0 or last == 0):
            parts.reverse()
        if first >= 0 or last >= 0 or "then" in sentence:
            orders += [(parts[i], later) for i in range(len(parts)) for later in parts[i + 1 :]]
    words = {word for clause in clauses for word in clause.words | clause.when}
    words |= {word for taken_, left_ in choices for word in taken_ | left_}
    return Reading(tuple(clauses), tuple(orders), tuple(choices), frozenset(words))


def _positive(found: re.Match[str]) -> str:
    """What is left of a negation that forbids nothing: bounds stay."""
    return found.group() if found.group().endswith(" than") else " "


def _steps(sentence: str) -> list[str]:
    """The statements of a sentence."""
    cut = _ANY_AND if _FIRST.search(sentence) or _LATER.search(sentence) else _STEP
    found: list[str] = []
    for step in cut.split(sentence):
        head, comma, tail = step.partition(",")
        # "Don't pull it, push it" forbids one thing and asks for another.
        two = comma and _NOT.search(head) and len(tail.split()) > 1 and not _CASE.match(head)
        found += [head, tail] if two and not _choice(step)[1] else [step]
    return [step for step in found if WORD.search(step)]


def _choice(step: str) -> tuple[str, str]:
    """What a step takes, and what it leaves; ("", "") where it does not choose."""
    found = _INSTEAD.match(step) or _CHOSEN.fullmatch(step.strip())
    groups = found.groupdict(default="") if found is not None else {}
    taken, left = ("".join(groups[name] for name in groups if name.startswith(n)) for n in ("one", "two"))
    return taken, left
