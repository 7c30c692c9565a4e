"""Words around a number that make it a bound: "no faster than", "at most", "or less"."""

from __future__ import annotations

import re
from typing import NamedTuple

_MORE = (
    "more greater higher larger bigger longer faster quicker harder heavier hotter warmer wider deeper thicker taller "
    "farther further stronger firmer later older tighter"
)
_LESS = (
    "less fewer lower smaller shorter slower softer lighter colder cooler narrower shallower thinner closer "
    "nearer weaker gentler earlier younger looser"
)
_AT_LEAST = (
    "at (?:the )?least|(?:no|not) (?:less|fewer) than|(?:an? |at (?:an? )?)?minimum|min|not (?:below|under)|above|over"
    "|exceed(?:s|ing|ed)?|beyond|past|upwards of|greater than or equal to|starting (?:at|from)"
)
_AT_MOST = (
    "at (?:the )?most|(?:no|not|never) more than|up to|(?:an? |at (?:an? )?)?maximum|max|not (?:above|over)|below"
    "|under(?:neath)?|beneath|within|(?:not|without) exceed(?:ing)?|less than or equal to|capped at|limited to"
)
_MORES, _LESSES = ("|".join(words.split()) for words in (_MORE, _LESS))
_BEFORE = re.compile(
    rf"(?:(?<![-=\w])(?:(?P<ge>>=?|≥)|(?P<le><=?|≤)|[~≈])"
    rf"|\b(?:(?P<high>{_AT_MOST}|(?:no|not|never|any) (?:{_MORES}) than|(?:{_LESSES}) than)"
    rf"|(?P<low>{_AT_LEAST}|(?:no|not|never|any) (?:{_LESSES}) than|(?:{_MORES}) than)"
    r"|(?P<between>between))\b\.?(?:\s+(?:of|at|to)){0,2})?"
    r"\s*(?:(?P<about>(?:\b(?:about|around|roughly|approximately|approx|circa|ca|some|nearly|almost)\b\.?)|[~≈])\s*)?$"
)
_END = r"(?=\s*(?:[.,;:)]|$))"
_BEHIND = re.compile(
    rf"\s*,?\s*(?:(?P<low>or (?:above|up|over|{_MORES})\b|and (?:above|up|upwards?|over|more|higher){_END}|onwards\b"
    r"|at (?:the )?least\b(?!\s+\d)|min(?:imum)?\b\.?(?!\s+\w)|\+(?![\w.]))"
    rf"|(?P<high>or (?:below|under|{_LESSES})\b|and (?:below|under|less|lower){_END}|at (?:the )?most\b(?!\s+\d)"
    r"|tops\b|max(?:imum)?\b\.?(?!\s+\w)))"
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
    found = _BEFORE.search(text[low:at])
    if found is None or not found.group().strip():
        return Before(0, False, False, at)
    said = found.groupdict()
    sign = 1 if said["ge"] or said["low"] else -1 if said["le"] or said["high"] else 0
    about = bool(said["about"]) or found.group()[0] in "~≈"
    return Before(sign, about, bool(said["between"]), low + found.start())


def bound_behind(text: str, at: int) -> tuple[int, int]:
    """The sign of the bound behind a number that ends at ``at``, as of :class:`Before`, and where it ends."""
    match = _BEHIND.match(text, at)
    if match is None:
        return 0, at
    return (1 if match["low"] else -1), match.end()
