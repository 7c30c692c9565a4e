"""English numbers in words: "twenty-five", "half a second", "a quarter turn", "two and a half", "twice", "a dozen".

Small and exact; articles and "one" count only before a unit, where no other reading is left.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import NamedTuple

from gvla2.memory.meaning.english import word_set
from gvla2.memory.meaning.units import UNITS

_SMALL = (
    "zero one two three four five six seven eight nine ten eleven twelve thirteen fourteen fifteen sixteen seventeen "
    "eighteen nineteen"
)
_TENS = "twenty thirty forty fifty sixty seventy eighty ninety"
_VALUES = {word: float(i) for i, word in enumerate(_SMALL.split()) if word != "one"}
_VALUES |= {word: 10.0 * (i + 2) for i, word in enumerate(_TENS.split())}
_POWERS = {"hundred": 100.0, "thousand": 1000.0, "million": 1e6, "dozen": 12.0}
_TIMES = {"twice": 2.0, "thrice": 3.0}
_PERIODS = {
    "hourly": 3600.0,
    "daily": 86400.0,
    "weekly": 604800.0,
    "monthly": 2629800.0,
    "yearly": 31557600.0,
}
_PARTS = {"half": 0.5, "halves": 0.5, "quarter": 0.25, "quarters": 0.25, "third": 1 / 3, "thirds": 1 / 3,
          "fifth": 0.2, "fifths": 0.2, "tenth": 0.1, "tenths": 0.1}  # fmt: skip
_ARTICLES = frozenset(("a", "an", "one"))
_SHARED = word_set(
    "speed power pressure force throttle volume load strength width height length throughput full empty way"
)
_ONCE_UNITS = word_set(
    """minute hour day week month metre meter kilometre kilometer centimetre centimeter millimetre millimeter litre
    liter kilo kilogram gram turn revolution newton degree volt percent"""
)
_SECOND_ENDS = word_set("before after between and then or until in for at to with per")
_HANDS = word_set("hands arms grippers fingers")
_HAND = word_set("hand arm gripper finger")
_DEFINITE = frozenset(("the", "these", "those"))
_NOT_ONE = word_set("each every any this that which no the other another same")
_BEFORE_ONE = word_set(
    """with by at for in only just exactly use using put take add place keep need needs within after than least most to
    wait hold of"""
)
_NO_THING = word_set(
    "of by at another should must can may needs has is was more that which who to and or the way"
)
_ONCE_ENDS = word_set("per every before and then when daily a an for at or with until")
_STEMS = frozenset(
    {
        *_VALUES,
        *_POWERS,
        *_TIMES,
        *_PERIODS,
        *_PARTS,
        *_ONCE_UNITS,
        "both",
        "one",
        "once",
        "second",
        "full",
        "pi",
    }
)
_SPACED = str.maketrans(dict.fromkeys(".,;:!?()[]-'’/\"", " "))
_WORD = re.compile(r"[^\W\d_]+(?:['’][^\W\d_]+)?")


class Spelled(NamedTuple):
    """A number in words from ``start`` to ``end``; ``dimension`` where the words give a unit as well.

    ``share`` marks a fraction, which is one of the whole where no unit follows.
    """

    value: float
    start: int
    end: int
    dimension: str = ""
    share: bool = False


_Span = tuple[str, int, int]


def spelled_numbers(text: str) -> list[Spelled]:
    """All numbers in words of a casefolded text, in reading order."""
    if _STEMS.isdisjoint(text.translate(_SPACED).split()):
        return []
    found: list[Spelled] = []
    spans = [(match.group(), match.start(), match.end()) for match in _WORD.finditer(text)]
    words = [word for word, _, _ in spans] + ["", "", "", "", ""]
    index = 0
    while index < len(spans):
        one = _at(words, index, spans, text)
        if one is None:
            index += 1
        else:
            found.append(one[0])
            index = one[1]
    return found


def _at(words: Sequence[str], i: int, spans: Sequence[_Span], text: str) -> tuple[Spelled, int] | None:
    """The number that begins with word ``i``, and the index of the word behind it."""
    word, start = words[i], spans[i][1]

    def made(value: float, until: int, dimension: str = "", share: bool = False) -> tuple[Spelled, int]:
        if words[until] == "turn" and share:
            value, until, dimension, share = value * 360.0, until + 1, "angle", False
        return Spelled(value, start, spans[until - 1][2], dimension, share), until

    if word in _TIMES:
        return made(_TIMES[word], i + 1, "times")
    if word in _PERIODS:
        return made(_PERIODS[word], i + 1, "time")
    if word == "once":
        return made(1.0, i + 1, "times") if _once(words, i, spans, text) else None
    if word == "pi":
        return made(3.141592653589793, i + 1) if words[i + 1].startswith("rad") else None
    if word == "both":
        return made(2.0, i + 1) if words[i + 1] in _HANDS else None
    if word == "full" and words[i + 1] in _SHARED | {"turn"}:
        return made(1.0, i + 1, share=True)
    fraction = _fraction(words, i)
    if fraction is not None:
        value, after = fraction
        if words[after] in _POWERS:
            return made(value * _POWERS[words[after]], after + 1)
        return made(value, after, "", True)
    if word in _ARTICLES:
        after = _article(words, i, spans, text)
        return made(_POWERS.get(words[i + 1], 1.0) if after > i + 1 else 1.0, after) if after else None
    cardinal = _cardinal(words, i)
    if cardinal is None or (i and words[i - 1] in _DEFINITE and words[cardinal[1]] not in _HANDS):
        return None
    value, after = cardinal
    if words[after : after + 3] == ["and", "a", "half"]:
        return made(value + 0.5, after + 3)
    if words[after] in _PARTS and words[after].endswith("s"):
        value, after = value * _PARTS[words[after]], after + 1
        if words[after] == "of" and words[after + 1] in _ARTICLES:
            after += 2
        return made(value, after, "", True)
    return made(value, after)


def _cardinal(words: Sequence[str], i: int) -> tuple[float, int] | None:
    value = _VALUES.get(words[i])
    if value is None:
        return None
    after = i + 1
    if 20 <= value <= 90:
        ones = 1.0 if words[after] == "one" else _VALUES.get(words[after], 0.0)
        if 1 <= ones <= 9:
            value, after = value + ones, after + 1
    while words[after] in _POWERS:
        value, after = value * _POWERS[words[after]], after + 1
    return value, after


def _fraction(words: Sequence[str], i: int) -> tuple[float, int] | None:
    """The fraction "half a", "half the", "half full", "a quarter", "half of the" at word ``i``."""
    first = i + 1 if words[i] in _ARTICLES else i
    word, after = words[first], first + 1
    follows = words[after]
    if word == "half":
        if follows in ("a", "an", "of"):
            return 0.5, after + 1 + (words[after + 1] in _ARTICLES)
        if follows == "the" or follows in _SHARED or follows == "turn":
            return 0.5, after
        return (
            (0.5, after) if first > i and (follows in _ONCE_UNITS or follows in ("second", "dozen")) else None
        )
    if word in _PARTS and (first > i or follows == "turn"):
        if follows == "of" and (words[after + 1] in _ARTICLES or words[after + 1] == "turn"):
            after += 1 + (words[after + 1] in _ARTICLES)
        elif word in ("third", "fifth", "tenth") and follows and follows not in _SECOND_ENDS | {"of"}:
            return None  # an ordinal: "a third attempt"
        return _PARTS[word], after
    return None


def _article(words: Sequence[str], i: int, spans: Sequence[_Span], text: str) -> int:
    """The index behind an article or "one" that counts, 0 where it does not."""
    before, behind = words[i - 1] if i else "", words[i + 1]
    if (
        before in _NOT_ONE
        or before in _TIMES
        or (before in UNITS and before not in ("a", "an", "h", "m", "s"))
    ):
        return 0
    if before == "once" or text[: spans[i][1]].rstrip()[-1:].isdigit():
        return 0  # "three times a minute"
    if behind in _POWERS:
        return i + 2
    if behind == "second":
        return i + 1 if words[i] == "one" or words[i + 2] in _SECOND_ENDS or _ends(spans, i + 1, text) else 0
    if behind in _ONCE_UNITS or (words[i] == "one" and behind in _HAND):
        return i + 1
    if words[i] == "one" and (not before or before in _BEFORE_ONE):
        return i + 1 if behind and behind not in _NO_THING and not _ends(spans, i, text) else 0
    return 0


def _once(words: Sequence[str], i: int, spans: Sequence[_Span], text: str) -> bool:
    """Whether "once" counts; before an act it is a condition: "once the water boils"."""
    if i and (words[i - 1] in _NOT_ONE or words[i - 1] == "at"):
        return False
    return not words[i + 1] or words[i + 1] in _ONCE_ENDS or _ends(spans, i, text)


def _ends(spans: Sequence[_Span], i: int, text: str) -> bool:
    """Whether a part of the sentence ends behind word ``i``."""
    return i + 1 >= len(spans) or text[spans[i][2] : spans[i + 1][1]].strip() != ""
