"""One way to write a text, whatever keyboard it came from, so that no two numbers or names become one by it.

Names ("room 12", "python 3.11", "cam-0", "#42") measure nothing; where they differ, two texts speak of two things.
"""

from __future__ import annotations

import re
import unicodedata
from functools import lru_cache

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


_VERSIONED = (
    "python|numpy|torch|cuda|driver|node|java|ruby|rust|gcc|cmake|ros|django|react|postgres|mysql|redis|docker|kubernetes"
    "|nginx|ubuntu|debian|windows|android|ios|kernel|usb|tls|http|api|firmware|version|release|rev|build"
)
_NAMED = (
    "room|bay|issue|ticket|case|gate|platform|station|cell|slot|socket|rack|aisle|floor|unit|part|model|type|class|page"
    "|joint|axis|servo|motor|sensor|camera|robot|arm|drawer|shelf|bin|tray|lane|zone|site|server|host|machine|line|row"
    "|column|step|phase|round|trial|episode|scene|route"
)
_NO_BOUND = (
    r"(?!\s*(?:[%°]|or\b|and (?:above|up|later|newer)|[a-z]+/|mm|cm|m?s\b|[mn]\b|kg|\+"
    r"|(?:sec|min|hour|day|week|times|second)[a-z]*\b))"
)
_NO_MEASURE = (
    r"(?![\w%.,:]*\d)(?!\s*-?\s?(?:[%°]|(?:mm|cm|m|s|ms|n|nm|g|b|[kmg]b|hz|px|or|x|times|min|mins)\b"
    r"|kg|deg|met|cent|mill|sec|hour|minu|inch|grad|newt|volt|bolt|gram))"
)
_NAMES = re.compile(
    # 2024-03-01, 01.03.2024; addresses, and versions of three parts and more; v1.2, v2
    r"(?<![\w.])(?:\d{4}[-/.]\d{1,2}[-/.]\d{1,2}|\d{1,2}[./]\d{1,2}[./]\d{4})(?!\w)"
    r"|(?<![\w.,])v?\d+(?:\.\d+){2,}(?:[-.]?[a-z]+[\w.]*)?(?::\d+)?(?!\w)"
    r"|(?<![\w.])v\d+(?:\.\d+)*[a-z]*\d*(?!\w)"
    rf"|(?<!\w)(?P<product>(?:{_VERSIONED})[ -]?)(?P<version>(?>v?\d+(?:\.(?:\d+|x))*))(?!\w){_NO_BOUND}"
    rf"|(?<!\w)(?P<thing>(?:{_NAMED})s? (?:no\.? |nr\.? |number )?)"
    rf"(?P<which>(?>#?\d+(?:\.\d+)?[a-z]?)){_NO_MEASURE}"
    # abc-1042, a-17; not utf-8 and its like, which are chosen by their number
    r"|(?<![\w-])(?!(?:utf|sha|aes|md|rsa)-)(?:[a-z]{1,6}-\d+[a-z]?(?:-\w+)*|[a-z]\d+-\w+)(?!\w)"
    # #42; 7bd02aa, m6x20: digits and letters that are no figure and its unit
    r"|(?<!\w)#\d+(?!\w)"
    r"|(?<![\w.,/])(?P<mixed>\d+[a-z]+\d[\da-z]*|[a-z]+\d+[a-z]+\w*|[a-z]+\d+(?:[._-]\d+)+)(?!\w)"
)
_FIGURE = re.compile(r"\d+[x×]\d+(?:[x×]\d+)?(?:[mcµ]?m|px)?$|\d+(?:e-?\d+|[µmckd]?m[23])$")
_DIGIT = re.compile(r"\d")
_JOIN = re.compile(r"\W+")


def name_things(text: str) -> str:
    """A casefolded text in which each name with a number is one word: "python 3.11" becomes "python nr3_11".

    Words that begin with "nr" agree only where they are equal. A version with a bound ("2.1 or newer") stays a number.
    """
    return _NAMES.sub(_named, text) if _DIGIT.search(text) else text


def _named(match: re.Match[str]) -> str:
    if match["version"]:
        return f"{match['product'].rstrip(' -')} {_one_word(match['version'])}"
    if match["which"]:
        return f"{match['thing']}{_one_word(match['which'])}"
    if match["mixed"] and (match["mixed"].startswith("nr") or _FIGURE.match(match["mixed"])):
        return match.group()
    return _one_word(match.group())


def _one_word(name: str) -> str:
    return "nr" + _JOIN.sub("_", name).strip("_")
