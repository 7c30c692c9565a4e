"""A normal form of text: one Unicode form, numbers in digits, and names with numbers as one word."""

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
    """The casefolded text in the form to be parsed: "10^5" is "1e5", "half an hour" "0.5 hour", "bin 3" "bin nr3"."""
    text = unified(text)
    if "10^" in text:
        text = _POWER_OF_TEN.sub(_exponent, text)
    text = _AMPERES.sub(" amps", text).casefold().replace("’", "'")
    return _NAMES.sub(_named, _COUNTED.sub(_counted, _HALVES.sub(_half, text)))


def _exponent(found: re.Match[str]) -> str:
    return f"{found['times'] or '1'}e{found['sign'].replace('−', '-')}{found['power']}"


# Numbers in words ---------------------------------------------------------------------------------------------------

_SMALL = (
    "zero one two three four five six seven eight nine ten eleven twelve thirteen fourteen fifteen sixteen seventeen "
    "eighteen nineteen"
)
_TENS = "twenty thirty forty fifty sixty seventy eighty ninety"
_VALUES = {word: i for i, word in enumerate(_SMALL.split())}
_VALUES |= {word: 10 * i for i, word in enumerate(_TENS.split(), 2)}
_POWERS = {"hundred": 100, "thousand": 1000, "million": 1_000_000, "dozen": 12}
_TIMES = {"twice": "2 times", "thrice": "3 times", "hourly": "1 h", "daily": "1 day", "weekly": "1 week"}
_SMALLS, _MANY = "|".join(w for w in _SMALL.split() if w != "one"), "|".join(_POWERS)
_UNITS = (
    r"(?:second|minute|hour|day|week|month|turn|revolution|degree|newton|volt|percent|lit(?:er|re)"
    r"|[a-z]*met(?:er|re))s?\b"
)
_ONE = rf"one(?= {_UNITS})|(?<!\d )an?(?= (?!second){_UNITS})"
_COUNTED = re.compile(
    rf"(?<!\bthe )(?<!\bthese )(?<!\bthose )\b(?:(?P<times>{'|'.join(_TIMES)})"
    rf"|(?:(?P<tens>{_TENS.replace(' ', '|')})(?:[- ](?P<ones>{'|'.join(_SMALL.split()[1:10])}))?|(?P<small>{_SMALLS})"
    rf"|(?:one|an?)(?= (?:{_MANY})\b)|(?<!each )(?<!every )(?<!any )(?:{_ONE}))"
    rf"(?: (?P<power>{_MANY}))?(?P<half> and a half)?)\b(?!-)"
)
_HALVES = re.compile(
    r"(?<!\band )(?<!\band a )\b(?:(?P<three>three |3 )|an? )?(?P<part>half|quarter)s?(?: of)?(?: an?)?"
    rf"(?: (?P<turn>turn)\b|(?= {_UNITS}))"
    r"|\b(?:an? )?(?P<share>half|quarter) (?:of (?:the|its)\b|(?=full|speed|power|pressure|force|load|volume))"
)


def _counted(found: re.Match[str]) -> str:
    if found["times"]:
        return _TIMES[found["times"]]
    value = _VALUES[found["tens"] or found["small"] or "one"] + _VALUES[found["ones"] or "zero"]
    return f"{value * _POWERS.get(found['power'], 1) + (0.5 if found['half'] else 0):g}"


def _half(found: re.Match[str]) -> str:
    value = (0.5 if "half" in (found["part"], found["share"]) else 0.25) * (3 if found["three"] else 1)
    if found["share"]:
        return f"{100 * value:g} % "
    return f"{360 * value:g} degrees" if found["turn"] else f"{value:g}"


# Names --------------------------------------------------------------------------------------------------------------

_NUMBERED = (
    "python|numpy|torch|cuda|driver|node|java|usb|http|version|release|firmware|room|bay|issue|gate|station|cell|slot|rack|aisle"
    "|floor|part|joint|axis|motor|sensor|camera|robot|arm|drawer|shelf|bin|tray|lane|zone|server|machine|line|row|column|step"
    "|waypoint|marker|page"
)
_NAMES = re.compile(
    r"(?<![\w.,])(?:v?\d+(?:[./-]\d+){2,}[\w.]*|v\d[\w.]*|#\d+)(?!\w)"  # dates, addresses, versions
    rf"|(?<!\w)(?P<thing>(?:{_NUMBERED})s? )(?P<which>(?>\d+(?:\.\d+)*[a-z]?))(?![\w.]*\d|\w)"
    r"(?!\s*(?:[%°]|or\b|[a-z]+/|mm|cm|m?s\b|[mn]\b|kg|times\b|met|cent|mill|sec|hour|minu|deg|newt))"
)
"""The dimension of names: if names differ, two texts are about different things."""


def _named(found: re.Match[str]) -> str:
    return (found["thing"] or "") + "nr" + re.sub(r"\W+", "_", found["which"] or found.group()).strip("_")
