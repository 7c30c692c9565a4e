"""Words around a number that make it a bound: "no faster than", "at most", "or less", "höchstens", 以内."""

from __future__ import annotations

import re
from typing import NamedTuple

from gvla2.memory.meaning.word_sets import word_set

_MORE = (
    "more greater higher larger bigger longer faster quicker harder heavier hotter warmer wider deeper thicker taller "
    "farther further stronger firmer later older tighter"
)
_LESS = (
    "less fewer lower smaller shorter slower softer lighter colder cooler narrower shallower thinner closer "
    "nearer weaker gentler earlier younger looser"
)
_MEHR = (
    "mehr größer höher länger schneller stärker fester schwerer heißer wärmer weiter breiter tiefer dicker "
    "später"
)
_WENIGER = (
    "weniger kleiner niedriger kürzer langsamer schwächer sanfter leichter kälter kühler näher enger schmaler "
    "dünner früher"
)
_PLUS = "vite rapidement haut grand long fort lourd chaud large profond loin élevé longtemps"
_MOINS = "lent lentement bas petit court doucement froid léger près"
_MAS = "rápido alto grande largo fuerte pesado caliente ancho profundo lejos rápidamente tiempo"
_MENOS = "lento despacio bajo pequeño corto suave frío ligero cerca"

_AT_LEAST = """
at least|at the least|no less than|not less than|no fewer than|not fewer than|minimum|a minimum|at a minimum
at minimum|min|min.|above|not below|not under|over|exceed|exceeds|exceeding|exceeded|beyond|past|upwards of
greater than or equal to|starting at|starting from|>=|=>|≥|>|mindestens|minimal|wenigstens|oberhalb|über|ab
nicht unter|überschreite|überschreitet|überschreiten|au moins|plus de|au-dessus|au-delà|supérieur|supérieure
au minimum|pas moins de|dépasser|dépasse|dépassez|dépassant|excéder|al menos|por lo menos|como mínimo|mínimo
un mínimo|más de|por encima|superior|no menos de|superar|supera|supere|exceder|excede|almeno|pelo menos|минимум
более|больше|не менее
"""
_AT_MOST = """
at most|at the most|no more than|not more than|never more than|up to|maximum|a maximum|at a maximum|at maximum
max|max.|below|under|underneath|beneath|within|not above|not over|not exceeding|not exceed|without exceeding
less than or equal to|capped at|limited to|<=|≤|<|höchstens|maximal|unter|unterhalb|bis zu|nicht über
nicht mehr als|innerhalb|unterschreitet|au plus|tout au plus|moins de|jusqu'à|au-dessous|en dessous|au maximum
inférieur|inférieure|pas plus de|sans dépasser|ne pas dépasser|ne dépasser pas|como máximo|como mucho|máximo
un máximo|a lo sumo|menos de|no más de|hasta|por debajo|inferior|sin superar|sin exceder|no superar|no exceder
al massimo|no máximo|максимум|менее|меньше|не более
"""
_HAN_LOW = word_set("至少 最少 不少于 不低于 不小于 超过 大于 高于 多于 快于 最低")
_HAN_HIGH = word_set(
    "至多 最多 不超过 不大于 不高于 不多于 少于 小于 低于 慢于 最高 最大 "
    "不要超过 不得超过 不能超过 切勿超过 不可超过 勿超过 别超过 不快于"
)
_ABOUT = word_set(
    "about around roughly approximately approx approx. circa ca. ca ~ ≈ some nearly almost ungefähr etwa rund environ "
    "aproximadamente unos unas casi 大约 约 大概"
)
_LINKS = word_set("of als de von à a at to auf que zu d' dem le la des du del")


def _phrases() -> dict[str, int]:
    found: dict[str, int] = {}
    for text, sign in ((_AT_LEAST, 1), (_AT_MOST, -1)):
        found |= {phrase: sign for line in text.strip().split("\n") for phrase in line.split("|")}
    english = [(f"{word} than", 1) for word in _MORE.split()] + [
        (f"{word} than", -1) for word in _LESS.split()
    ]
    german = [(f"{word} als", 1) for word in _MEHR.split()] + [
        (f"{word} als", -1) for word in _WENIGER.split()
    ]
    french = [(f"plus {word} que", 1) for word in _PLUS.split()] + [
        (f"plus {word} que", -1) for word in _MOINS.split()
    ]
    french += [(f"moins {word} que", -1) for word in _PLUS.split()] + [("plus près de", -1)]
    spanish = [(f"más {word} {than}", 1) for word in _MAS.split() for than in ("que", "de")]
    spanish += [(f"más {word} {than}", -1) for word in _MENOS.split() for than in ("que", "de")]
    for pairs, noes in (
        (english, ("no", "not", "never", "any")),
        (german, ("nicht", "nie", "niemals", "keinesfalls")),
        (french, ("pas", "jamais")),
        (spanish, ("no", "nunca")),
    ):
        found |= dict(pairs)
        found |= {f"{no} {phrase}": -sign for phrase, sign in pairs for no in noes}
    return found


_PHRASES = _phrases()
_LAST_WORDS = frozenset(phrase.split()[-1] for phrase in _PHRASES)
_LONGEST = 5
_MARKS = frozenset("<>=≤≥~≈")
_SYMBOL = re.compile(r"(?<![-=\w])(?:<=|>=|[<>≤≥~≈])\s*$")
_BETWEEN = frozenset(("between", "zwischen", "entre"))

_OR_MORE = "|".join(("above", "up", "over", *_MORE.split()))
_OR_LESS = "|".join(("below", "under", *_LESS.split()))
_END = r"(?=\s*(?:[.,;:)]|$))"
_BEHIND = re.compile(
    rf"\s*,?\s*(?:(?P<low>or (?:{_OR_MORE})\b|and (?:above|up|upwards?|over|more|higher){_END}|onwards\b"
    r"|at (?:the )?least\b(?!\s+\d)|min(?:imum)?\b\.?(?!\s+\w)|oder (?:mehr|darüber|höher|größer|länger|schneller)\b"
    rf"|und (?:mehr|darüber){_END}|ou (?:plus|davantage|au-delà|au-dessus)\b|et plus{_END}|au (?:moins|minimum)\b"
    rf"|o (?:más|superior)\b|y más{_END}|como mínimo\b|al menos\b(?!\s+\d)|mindestens\b(?!\s+\d)|\+(?![\w.])"
    r"|或更多|或以上|及以上|以上)"
    rf"|(?P<high>or (?:{_OR_LESS})\b|and (?:below|under|less|lower){_END}|at (?:the )?most\b(?!\s+\d)|tops\b"
    r"|max(?:imum)?\b\.?(?!\s+\w)|oder (?:weniger|darunter|niedriger|kleiner|kürzer|langsamer)\b"
    rf"|und (?:weniger|darunter){_END}|höchstens\b(?!\s+\d)|maximal\b(?!\s+\d)"
    rf"|ou (?:moins|en dessous|au-dessous)\b|et moins{_END}|au (?:plus|maximum)\b|o (?:menos|inferior)\b"
    rf"|y menos{_END}|como (?:máximo|mucho)\b|a lo sumo\b|或更少|或以下|及以下|以下|以内|之内))"
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
    if tail[-1:] >= "一":
        return _han_before(tail, low, at)
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


def _han_before(head: str, low: int, at: int) -> Before:
    about = head.endswith(("大约", "约", "大概"))
    if about:
        head = head[: -1 if head.endswith("约") and not head.endswith("大约") else -2]
    for length in (4, 3, 2):
        for phrases, sign in ((_HAN_HIGH, -1), (_HAN_LOW, 1)):
            if len(head) >= length and head[-length:] in phrases:
                return Before(sign, about, False, low + len(head) - length)
    return Before(0, about, False, low + len(head) if about else at)


def bound_behind(text: str, at: int) -> tuple[int, int]:
    """The sign of the bound behind a number that ends at ``at``, as of :class:`Before`, and where it ends."""
    match = _BEHIND.match(text, at)
    if match is None:
        return 0, at
    return (1 if match["low"] else -1), match.end()
