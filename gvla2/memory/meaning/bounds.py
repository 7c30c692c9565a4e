"""Words around a number that make it a bound: "no faster than", "at most", "or less"."""

from __future__ import annotations

import re
from typing import NamedTuple

from gvla2.memory.meaning.english import word_set

_MORE = (
    "more greater higher larger bigger longer faster quicker harder heavier hotter warmer wider deeper thicker taller "
    "farther further stronger firmer later older tighter"
)
_LESS = (
    "less fewer lower smaller shorter slower softer lighter colder cooler narrower shallower thinner closer "
    "nearer weaker gentler earlier younger looser"
)
_AT_LEAST = """
at least|at the least|no less than|not less than|no fewer than|not fewer than|minimum|a minimum|at a minimum
at minimum|min|min.|above|not below|not under|over|exceed|exceeds|exceeding|exceeded|beyond|past|upwards of
greater than or equal to|starting at|starting from|>=|=>|≥|>
"""
_AT_MOST = """
at most|at the most|no more than|not more than|never more than|up to|maximum|a maximum|at a maximum|at maximum
max|max.|below|under|underneath|beneath|within|not above|not over|not exceeding|not exceed|without exceeding
less than or equal to|capped at|limited to|<=|≤|<
"""
_ABOUT = word_set("about around roughly approximately approx approx. circa ca. ca ~ ≈ some nearly almost")
_LINKS = word_set("of at to")


def _phrases() -> dict[str, int]:
    found: dict[str, int] = {}
    for text, sign in ((_AT_LEAST, 1), (_AT_MOST, -1)):
        found |= {phrase: sign for line in text.strip().split("\n") for phrase in line.split("|")}
    compared = [(f"{word} than", 1) for word in _MORE.split()]
    compared += [(f"{word} than", -1) for word in _LESS.split()]
    found |= dict(compared)
    return found | {
        f"{no} {phrase}": -sign for phrase, sign in compared for no in ("no", "not", "never", "any")
    }


_PHRASES = _phrases()
_LAST_WORDS = frozenset(phrase.split()[-1] for phrase in _PHRASES)
_LONGEST = 5
_MARKS = frozenset("<>=≤≥~≈")
_SYMBOL = re.compile(r"(?<![-=\w])(?:<=|>=|[<>≤≥~≈])\s*$")
_BETWEEN = frozenset(("between",))

_OR_MORE = "|".join(("above", "up", "over", *_MORE.split()))
_OR_LESS = "|".join(("below", "under", *_LESS.split()))
_END = r"(?=\s*(?:[.,;:)]|$))"
_BEHIND = re.compile(
    rf"\s*,?\s*(?:(?P<low>or (?:{_OR_MORE})\b|and (?:above|up|upwards?|over|more|higher){_END}|onwards\b"
    r"|at (?:the )?least\b(?!\s+\d)|min(?:imum)?\b\.?(?!\s+\w)|\+(?![\w.]))"
    rf"|(?P<high>or (?:{_OR_LESS})\b|and (?:below|under|less|lower){_END}|at (?:the )?most\b(?!\s+\d)|tops\b"
    r"|max(?:imum)?\b\.?(?!\s+\w)))"
)


class Before(NamedTuple):
    """What stands before a number: ``sign`` +1 for a lower bound, -1 for an upper one, 0 for none; where it begins."""

    sign: int
    about: bool
    between: bool
    start: int


def bound_before(text: str, last: int, at: int) -> Before:
    """The bound in front of a number at ``at``; what lies before ``last`` belongs to another number."""
    low = max(last, at - 48)
    start, about = at, False
    head = text[low:at]
    tail = head.rstrip()
    if tail[-1:] in _MARKS and (symbol := _SYMBOL.search(head)) is not None:
        mark = symbol.group().strip()
        sign = {"<": -1, "≤": -1, ">": 1, "≥": 1}.get(mark[0], 0)
        return Before(sign, sign == 0, False, low + symbol.start())
    words = head.split()
    if not words:
        return Before(0, False, False, at)
    if words[-1] in _ABOUT:
        about, start = True, low + head.rindex(words.pop())
    if words and words[-1] in _BETWEEN:
        return Before(0, about, True, low + head.rindex(words[-1]))
    for drop in (0, 1, 2):
        if drop and (len(words) <= drop or words[-drop] not in _LINKS):
            break
        known = words[: len(words) - drop]
        if not known or known[-1] not in _LAST_WORDS:
            continue
        for length in range(min(_LONGEST, len(known)), 0, -1):
            phrase = " ".join(known[-length:])
            sign = _PHRASES.get(phrase, 0)
            if sign:
                begin = head.rfind(phrase)
                return Before(sign, about, False, low + (begin if begin >= 0 else head.rfind(known[-length])))
    return Before(0, about, False, start)


def bound_behind(text: str, at: int) -> tuple[int, int]:
    """The sign of the bound behind a number that ends at ``at``, as of :class:`Before`, and where it ends."""
    match = _BEHIND.match(text, at)
    if match is None:
        return 0, at
    return (1 if match["low"] else -1), match.end()
