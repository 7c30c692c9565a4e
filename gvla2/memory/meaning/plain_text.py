"""One way to write a text, whatever keyboard it came from, so that no two numbers or names become one by it."""

from __future__ import annotations

import re
import unicodedata
from functools import lru_cache

from gvla2.memory.meaning.names import name_things

_RAISED = re.compile(r"[⁺⁻]?[⁰¹²³⁴⁵⁶⁷⁸⁹]+")
_LOWERED = re.compile(r"(?<=\d)[₀₁₂₃₄₅₆₇₈₉]+")
_POWER_OF_TEN = re.compile(
    r"(?<![\w.,^])(?:(?P<times>\d+(?:[.,]\d+)?)\s?[x×·*]\s?)?10\^(?P<sign>[-−+]?)(?P<power>\d{1,2})(?!\w)"
)
_AMPERES = re.compile(r"(?<=\d)\s?A(?!\w)")  # in small letters it is an article
_MIXED_NUMBER = re.compile(r"(?<=\d)(?=[¼½¾⅐-⅞])")


def unified(text: str) -> str:
    """The text in Unicode's normal form NFKC, but "10⁵" as "10^5", which that form would make "105".

    Likewise "10₂" is "10_2" and "1½" is "1 1⁄2"; behind a letter a lowered digit is a plain one ("H₂O").
    """
    if text.isascii():
        return text
    text = _MIXED_NUMBER.sub(" ", _LOWERED.sub(r"_\g<0>", _RAISED.sub(r"^\g<0>", text)))
    return unicodedata.normalize("NFKC", text)


@lru_cache(maxsize=256)
def plain_text(text: str) -> str:
    """The casefolded text as it is taken apart: unified, "10^5" as "1e5", with names as words of their own."""
    text = unified(text)
    if "10^" in text:
        text = _POWER_OF_TEN.sub(_exponent, text)
    return name_things(_AMPERES.sub(" amps", text).casefold().replace("’", "'"))


def _exponent(found: re.Match[str]) -> str:
    return f"{found['times'] or '1'}e{found['sign'].replace('−', '-')}{found['power']}"
