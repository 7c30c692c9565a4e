"""Numbers in words: "twenty-five", "half a second", "a quarter turn", "twice", "zwei", "trois", "dos veces", "两次".

Small and exact; articles ("eine", "un") and "one" count only before a unit or a hand, where no other reading is left.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import NamedTuple

from gvla2.memory.meaning.units import UNITS
from gvla2.memory.meaning.word_sets import word_set

_ONES = """
0 zero null zéro cero
1 eins
2 two zwei deux dos
3 three drei trois tres
4 four vier quatre cuatro
5 five fünf cinq cinco
6 six sechs seis
7 seven sieben sept siete
8 eight acht huit ocho
9 nine neun neuf nueve
10 ten zehn dix diez
11 eleven elf onze
12 twelve zwölf douze doce
13 thirteen dreizehn treize trece
14 fourteen vierzehn quatorze catorce
15 fifteen fünfzehn quinze quince
16 sixteen sechzehn seize dieciséis
17 seventeen siebzehn diecisiete
18 eighteen achtzehn dieciocho
19 nineteen neunzehn diecinueve
20 twenty zwanzig vingt veinte
25 veinticinco
30 thirty dreißig dreissig trente treinta
40 forty vierzig quarante cuarenta
50 fifty fünfzig cinquante cincuenta
60 sixty sechzig soixante sesenta
70 seventy siebzig setenta
80 eighty achtzig ochenta
90 ninety neunzig noventa
100 hundert einhundert cien cent
1000 tausend mil mille
"""
_VALUES: dict[str, float] = {
    word: float(line.split()[0]) for line in _ONES.strip().split("\n") for word in line.split()[1:]
}
_DIGITS = ("ein", "zwei", "drei", "vier", "fünf", "sechs", "sieben", "acht", "neun")
_TENS = ("zwanzig", "dreißig", "vierzig", "fünfzig", "sechzig", "siebzig", "achtzig", "neunzig")
_VALUES |= {
    f"{d}und{t}": i + 1.0 + (j + 2) * 10.0 for i, d in enumerate(_DIGITS) for j, t in enumerate(_TENS)
}
_VALUES |= {f"{d}hundert": (i + 1) * 100.0 for i, d in enumerate(_DIGITS)}
_VALUES |= {f"{d}einhalb": i + 1.5 for i, d in enumerate(_DIGITS)} | {"anderthalb": 1.5}
_VALUES |= {f"{d}tausend": (i + 1) * 1000.0 for i, d in enumerate(_DIGITS)}
_POWERS = {"hundred": 100.0, "cent": 100.0, "cents": 100.0, "cientos": 100.0, "thousand": 1000.0, "tausend": 1000.0,
           "mille": 1000.0, "mil": 1000.0, "million": 1e6, "dozen": 12.0, "dutzend": 12.0, "douzaine": 12.0,
           "docena": 12.0, "docenas": 12.0}  # fmt: skip
_TIMES = {"twice": 2.0, "thrice": 3.0} | {
    f"{d}mal": i + 1.0 for i, d in enumerate((*_DIGITS, "zehn")) if d not in ("ein",)
}
_PERIODS = {"hourly": 3600.0, "daily": 86400.0, "weekly": 604800.0, "monthly": 2629800.0, "yearly": 31557600.0,
            "stündlich": 3600.0, "täglich": 86400.0, "wöchentlich": 604800.0, "monatlich": 2629800.0,
            "quotidiennement": 86400.0, "mensuellement": 2629800.0, "diariamente": 86400.0,
            "semanalmente": 604800.0, "mensualmente": 2629800.0}  # fmt: skip
_HALVES = word_set("half halbe halben halber halbes halb demi demie media medio")
_PARTS = {"quarter": 0.25, "quarters": 0.25, "viertel": 0.25, "quart": 0.25, "quarts": 0.25, "cuarto": 0.25,
          "cuartos": 0.25, "third": 1 / 3, "thirds": 1 / 3, "drittel": 1 / 3, "tiers": 1 / 3, "tercio": 1 / 3,
          "tercios": 1 / 3, "half": 0.5, "halves": 0.5, "tenth": 0.1, "zehntel": 0.1, "fifth": 0.2, "fifths": 0.2,
          "hälfte": 0.5, "moitié": 0.5, "mitad": 0.5}  # fmt: skip
_ARTICLES = word_set("a an one ein eine einen einem einer un une una uno la der die")
_WHOLE = word_set("full whole volle vollen voller pleine plein toda completa")
_SHARED = word_set(
    "speed power pressure force throttle volume load strength width height length throughput full empty "
    "geschwindigkeit kraft leistung voll vitesse puissance plein pleine velocidad potencia fuerza lleno llena "
    "way"
)
_ONCE_UNITS = word_set(
    "minute hour week month metre meter kilometre kilometer centimetre centimeter millimetre millimeter litre "
    "liter kilo turn revolution newton sekunde stunde zentimeter millimeter umdrehung seconde heure semaine "
    "mètre centimètre millimètre tour segundo minuto hora metro centímetro milímetro vuelta vez fois hand arm "
    "gripper finger hände main bras doigt mano brazo dedo kilogramm gramm"
)
_SECOND_ENDS = word_set("before after between and then or until in for at to with per")
_HANDS = word_set(
    "hands arms grippers fingers hände arme händen armen greifer mains bras pinces manos brazos pinzas dedos"
)
_BOTH = word_set("both beide beiden ambas ambos")
_TURN_UNITS = word_set("turn tour vuelta drehung")
_DEFINITE = word_set("the these those die diese les ces los las estos estas")
_NOT_ONE = word_set(
    "each every any this that which no the other another same noch nicht auf otra cada alguna"
)
_ONE_MAY_FOLLOW = word_set(
    "with by at for in only just exactly use using put take add place keep need needs within after than least "
    "most to wait hold of mit nur"
)
_ONCE_ENDS = word_set("per every before and then when daily a an for at or with until")
_HAND = word_set("hand arm gripper finger main bras doigt mano brazo dedo")
_NO_THING = word_set(
    "of by at another should must can may needs has is was more that which who to and or the way"
)
_ALSO_WORDS = frozenset(("a", "an", "h", "m", "s", "second", "turns", "mal"))
_STEMS = frozenset(
    {*_VALUES, *_POWERS, *_TIMES, *_PERIODS, *_HALVES, *_PARTS, *_ONCE_UNITS, *_BOTH, "one", "once", "einmal",
     "second", "pi", "π", "full", "volle", "vierteldrehung", "viertelumdrehung", "hundred", "halfway"} - {"cents"}
)  # fmt: skip
_SPACED = str.maketrans(dict.fromkeys(".,;:!?()[]-'’/\"", " "))
_WORD = re.compile(r"[^\W\d_]+(?:['’][^\W\d_]+)?")
_HAN = re.compile(
    r"(?<![第下上每这那另同统任万])(?P<number>[一二两三四五六七八九十百千]+|半|双|单(?=[手臂]))"
    r"(?=半?(?:毫米|厘米|公分|分米|米|千米|公里|微米|度|圈|转|秒|分钟|小时|个小时|天|周|星期|个月|克|千克|公斤|吨"
    r"|毫升|升|牛|伏|安|瓦|赫"
    r"|次|遍|倍|个|只|颗|根|块|件|张|条|台|把|杯|步(?!骤)|层|滴|勺|手|臂|成))"
)
_HAN_DIGITS = {c: float(i) for i, c in enumerate("零一二三四五六七八九")} | {"两": 2.0}
_HAN_WORDS = {"半": 0.5, "双": 2.0, "单": 1.0}


class Spelled(NamedTuple):
    """A number in words from ``start`` to ``end``; ``dimension`` where the words give a unit as well.

    ``share`` marks a fraction, which is one of the whole where no unit follows.
    """

    value: float
    start: int
    end: int
    dimension: str = ""
    share: bool = False


def spelled_numbers(text: str) -> list[Spelled]:
    """All numbers in words of a casefolded text, in reading order."""
    found: list[Spelled] = []
    if not _STEMS.isdisjoint(text.translate(_SPACED).split()):
        spans = [(match.group(), match.start(), match.end()) for match in _WORD.finditer(text)]
        words = [word for word, _, _ in spans] + ["", "", "", "", ""]
        index = 0
        while index < len(spans):
            one = _at(words, index, spans, text)
            if one is None:
                index += 1
                continue
            spelled, index = one
            found.append(spelled)
    if not text.isascii():
        for match in _HAN.finditer(text):
            value = _han(match["number"])
            if value is not None:
                found.append(Spelled(value, match.start(), match.end("number")))
        found.sort(key=lambda spelled: spelled.start)
    return found


_Span = tuple[str, int, int]


def _at(words: Sequence[str], i: int, spans: Sequence[_Span], text: str) -> tuple[Spelled, int] | None:
    """The number that begins with word ``i``, and the index of the word behind it."""
    word, start = words[i], spans[i][1]

    def made(value: float, until: int, dimension: str = "", share: bool = False) -> tuple[Spelled, int]:
        return Spelled(value, start, spans[until - 1][2], dimension, share), until

    if word in _TIMES:
        return made(_TIMES[word], i + 1, "times")
    if word in _PERIODS:
        return made(_PERIODS[word], i + 1, "time")
    if word == "once" or word == "einmal":
        return made(1.0, i + 1, "times") if _once(words, i, spans, text) else None
    if word in ("pi", "π"):
        return made(3.141592653589793, i + 1) if words[i + 1].startswith("rad") else None
    if word in ("vierteldrehung", "viertelumdrehung"):
        return made(90.0, i + 1, "angle")
    if word in _BOTH:
        return made(2.0, i + 1) if words[i + 1] in _HANDS else None
    if word in _WHOLE and words[i + 1] in _SHARED | _TURN_UNITS:
        if words[i + 1] in _TURN_UNITS:
            return made(360.0, i + 2, "angle")
        return made(1.0, i + 1, share=True)
    fraction = _fraction(words, i)
    if fraction is not None:
        value, after = fraction
        if words[after] in _TURN_UNITS:
            return made(value * 360.0, after + 1, "angle")
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
        value, after = value + 0.5, after + 3
    elif words[after] in ("et", "y") and words[after + 1] in _HALVES:
        value, after = value + 0.5, after + 2
    if words[after] in _PARTS and words[after] != "half" and not words[after].endswith("r"):
        value, after = value * _PARTS[words[after]], after + 1
        if words[after] == "of" and words[after + 1] in _ARTICLES:
            after += 2
        if words[after] in _TURN_UNITS:
            return made(value * 360.0, after + 1, "angle")
        return made(value, after, "", True)
    return made(value, after)


def _cardinal(words: Sequence[str], i: int) -> tuple[float, int] | None:
    value = _VALUES.get(words[i])
    if value is None:
        return None
    after = i + 1
    if value == 4 and words[after] in ("vingt", "vingts"):
        value, after = 80.0, after + 1
    if 20 <= value <= 90 and value % 10 == 0:
        behind = after + 1 if words[after] in ("y", "et") else after
        ones = 1.0 if words[behind] in ("one", "un") else _VALUES.get(words[behind], 0.0)
        if 1 <= ones <= (19 if value in (60, 80) else 9) and ones == int(ones):
            value, after = value + ones, behind + 1
            if ones == 10 and 7 <= _VALUES.get(words[after], 0.0) <= 9:  # "quatre-vingt-dix-neuf"
                value, after = value + _VALUES[words[after]], after + 1
    while words[after] in _POWERS:
        value, after = value * _POWERS[words[after]], after + 1
    return value, after


def _fraction(words: Sequence[str], i: int) -> tuple[float, int] | None:
    """The fraction "half a", "half the", "half full", "a quarter", "eine halbe", "une demi", "media" at word ``i``."""
    first = i + 1 if words[i] in _ARTICLES else i
    word = words[first]
    if word in _HALVES:
        after = first + 1
        if words[after] in ("a", "an", "of"):
            after += 1
            return 0.5, after + (words[after] in _ARTICLES)
        if words[after] in ("the",) or words[after] in _SHARED:
            return 0.5, after
        if word != "half" or first > i:
            followed = words[after]
            if (
                followed in _ONCE_UNITS
                or followed in _TURN_UNITS
                or followed in ("second", "dozen", "docena", "vuelta")
            ):
                return 0.5, after
        return (0.5, after) if words[after] in _TURN_UNITS else None
    if word in _PARTS and (first > i or words[first + 1] in _TURN_UNITS):
        after = first + 1
        if words[after] in ("of", "de") and (
            words[after + 1] in _ARTICLES or words[after + 1] in _TURN_UNITS
        ):
            after += 1 + (words[after + 1] in _ARTICLES)
        elif (
            word in ("third", "fifth", "tenth") and words[after] and words[after] not in _SECOND_ENDS | {"of"}
        ):
            return None  # an ordinal: "a third attempt"
        return _PARTS[word], after
    return None


def _article(words: Sequence[str], i: int, spans: Sequence[_Span], text: str) -> int:
    """The index behind an article or "one" that counts, 0 where it does not."""
    before, behind = words[i - 1] if i else "", words[i + 1]
    if before in _NOT_ONE or before in _TIMES or (before in UNITS and before not in _ALSO_WORDS):
        return 0
    if before == "once" or text[: spans[i][1]].rstrip()[-1:].isdigit():
        return 0  # "three times a minute"
    if behind in _POWERS and behind not in ("mil", "mille", "cent", "cents"):
        return i + 2
    if behind in ("second", "segundo"):
        return i + 1 if words[i] == "one" or words[i + 2] in _SECOND_ENDS or _ends(spans, i + 1, text) else 0
    if behind in _ONCE_UNITS and not (words[i] in ("a", "an", "la", "der", "die") and behind in _HAND):
        return i + 1 if words[i] not in ("la", "der", "die") else 0
    if words[i] == "one" and (not before or before in _ONE_MAY_FOLLOW):
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


def _han(number: str) -> float | None:
    """The value of a Chinese number up to 9999, None for what is none, such as 百 alone."""
    if number in _HAN_WORDS:
        return _HAN_WORDS[number]
    total, digit = 0.0, None
    for character in number:
        if character in _HAN_DIGITS:
            if digit is not None:
                return None
            digit = _HAN_DIGITS[character]
        else:
            total += (1.0 if digit is None else digit) * {"十": 10.0, "百": 100.0, "千": 1000.0}[character]
            digit = None
    return total + (digit or 0.0)
