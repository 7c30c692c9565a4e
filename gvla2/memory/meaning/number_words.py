"""English numbers in words: "twenty-five", "half a second", "a quarter turn", "two and a half", "twice", "a dozen".

Articles and "one" count only before a unit, where no other reading is left.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import NamedTuple

from gvla2.memory.meaning.english import word_set

_SMALL = (
    "zero one two three four five six seven eight nine ten eleven twelve thirteen fourteen fifteen sixteen seventeen "
    "eighteen nineteen"
)
_TENS = "twenty thirty forty fifty sixty seventy eighty ninety"
_VALUES = {word: float(i) for i, word in enumerate(_SMALL.split()) if word != "one"}
_VALUES |= {word: 10.0 * (i + 2) for i, word in enumerate(_TENS.split())}
_POWERS = {"hundred": 100.0, "thousand": 1000.0, "million": 1e6, "dozen": 12.0}
_WHOLE = {"once": (1.0, "times"), "twice": (2.0, "times"), "thrice": (3.0, "times"), "hourly": (3600.0, "time"),
          "daily": (86400.0, "time"), "weekly": (604800.0, "time"), "monthly": (2629800.0, "time"),
          "yearly": (31557600.0, "time")}  # fmt: skip
_PARTS = {"half": 0.5, "halves": 0.5, "quarter": 0.25, "quarters": 0.25, "third": 1 / 3, "thirds": 1 / 3,
          "fifth": 0.2, "fifths": 0.2, "tenth": 0.1, "tenths": 0.1}  # fmt: skip
_ARTICLES = frozenset(("a", "an", "one"))
_SHARED = word_set(
    "speed power pressure force throttle volume load strength width height length throughput full empty way the turn"
)
_ONCE_UNITS = word_set(
    """minute hour day week month metre meter kilometre kilometer centimetre centimeter millimetre millimeter litre
    liter kilo kilogram gram turn revolution newton degree volt percent"""
)
_HANDS = word_set("hand arm gripper finger")
_SECOND_ENDS = word_set("before after between and then or until in for at to with per") | {""}
_NOT_ONE = word_set("each every any this that which no the other another same once twice thrice times")
_ONCE_ENDS = word_set("per every before and then when daily a an for at or with until") | {""}
_STARTS = {*_VALUES, *_POWERS, *_WHOLE, *_PARTS, *_ONCE_UNITS, "one", "both", "second", "full"}
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


_Read = tuple[float, int, str, bool]
"""A value, the index of the word behind it, its dimension, and whether it is a share."""


def spelled_numbers(text: str) -> list[Spelled]:
    """All numbers in words of a casefolded text, in reading order."""
    spans = [(match.group(), match.start(), match.end()) for match in _WORD.finditer(text)]
    words = [word for word, _, _ in spans] + ["", "", "", ""]
    if _STARTS.isdisjoint(words):
        return []
    found: list[Spelled] = []
    i = 0
    while i < len(spans):
        read = _at(words, i)
        if read is None or (words[i] in _ARTICLES and text[: spans[i][1]].rstrip()[-1:].isdigit()):
            i += 1
            continue
        value, after, dimension, share = read
        if share and words[after] == "turn":
            value, after, dimension, share = 360.0 * value, after + 1, "angle", False
        found.append(Spelled(value, spans[i][1], spans[after - 1][2], dimension, share))
        i = after
    return found


def _at(words: Sequence[str], i: int) -> _Read | None:
    """The number that begins with word ``i``."""
    word, behind, before = words[i], words[i + 1], words[i - 1] if i else ""
    if word in _WHOLE:
        counts = word != "once" or (behind in _ONCE_ENDS and before not in _NOT_ONE | {"at"})
        return (_WHOLE[word][0], i + 1, _WHOLE[word][1], False) if counts else None
    if word == "full" and behind in _SHARED:
        return 1.0, i + 1, "", True
    if (fraction := _fraction(words, i)) is not None:
        return fraction
    if word in _ARTICLES:
        if before in _NOT_ONE:
            return None
        if behind in _POWERS:
            return _POWERS[behind], i + 2, "", False
        second = behind == "second" and (word == "one" or words[i + 2] in _SECOND_ENDS)
        hand = word == "one" and behind in _HANDS
        return (1.0, i + 1, "", False) if second or hand or behind in _ONCE_UNITS else None
    if word == "both":
        return (2.0, i + 1, "", False) if behind.removesuffix("s") in _HANDS else None
    return _cardinal(words, i) if before not in ("the", "these", "those") else None


def _cardinal(words: Sequence[str], i: int) -> _Read | None:
    value, after = _VALUES.get(words[i]), i + 1
    if value is None:
        return None
    if 20 <= value <= 90:
        ones = 1.0 if words[after] == "one" else _VALUES.get(words[after], 0.0)
        if 1 <= ones <= 9:
            value, after = value + ones, after + 1
    while words[after] in _POWERS:
        value, after = value * _POWERS[words[after]], after + 1
    if words[after : after + 3] == ["and", "a", "half"]:
        return value + 0.5, after + 3, "", False
    if words[after] in _PARTS and words[after].endswith("s"):  # "two thirds of a turn"
        value, after = value * _PARTS[words[after]], after + 1
        return value, after + 2 * (words[after] == "of" and words[after + 1] in _ARTICLES), "", True
    return value, after, "", False


def _fraction(words: Sequence[str], i: int) -> _Read | None:
    """The fraction "half a", "half the", "half full", "a quarter", "a third of the" that begins with word ``i``."""
    led = words[i] in _ARTICLES
    part = words[i + led]
    after = i + led + 1
    follows = words[after]
    if part not in _PARTS or part.endswith("s"):
        return None
    if part == "half" and (follows in _SHARED or (led and follows in _ONCE_UNITS | {"second", "dozen"})):
        pass
    elif follows == "of" or (part == "half" and follows in _ARTICLES):
        after += 1 + (follows == "of" and words[after + 1] in _ARTICLES)
    elif part == "half" or not (led or follows == "turn"):
        return None
    elif part != "quarter" and follows not in _SECOND_ENDS:
        return None  # an ordinal: "a third attempt"
    if words[after] in _POWERS:
        return _PARTS[part] * _POWERS[words[after]], after + 1, "", False
    return _PARTS[part], after, "", True
