"""Numbers with units in a text, as intervals in base units: "at least 5 cm" is a length in [0.05, inf)."""

from __future__ import annotations

import math
import re
from collections import deque
from typing import NamedTuple

_UNITS = """
length 0.000001 µm um micron micrometer micrometre
length 0.001 mm millimeter millimetre
length 0.01 cm centimeter centimetre
length 1 m meter metre
length 1000 km kilometer kilometre
length 0.0254 inch inches ″
angle 1 degree deg ° º
angle 57.29577951308232 rad radian
angle 360 revolution rotation turns
temperature 1 °c ℃ celsius
time 0.000001 µs microsecond
time 0.001 ms millisecond msec
time 1 s sec second
time 60 min minute
time 3600 h hr hour
time 86400 day
time 604800 week
ratio 0.01 % percent ％
mass 0.001 g gram
mass 1 kg kilo kilogram
volume 0.001 ml milliliter millilitre cm3
volume 1 l liter litre
turning 6 rpm
force 1 n newton
torque 1 nm newtonmeter newtonmetre
torque 0.01 ncm
pressure 1 pa pascal
pressure 100 hpa mbar
pressure 1000 kpa
pressure 1000000 mpa
pressure 100000 bar
voltage 1 v volt
current 1 amp ampere
power 1 w watt
frequency 1 hz hertz fps
frequency 1000 khz
frequency 1000000 mhz
bytes 1 byte
bytes 1024 kb kib kilobyte
bytes 1048576 mb mib megabyte
bytes 1073741824 gb gib gigabyte
pixels 1 px pixel
times 1 times
time2 1 s2
"""
_KNOWN = {
    word: (line.split()[0], float(line.split()[1]))
    for line in _UNITS.strip().split("\n")
    for word in line.split()[2:]
}
_RATES = {
    ("length", "time"): "speed",
    ("angle", "time"): "turning",
    ("times", "time"): "frequency",
    ("length", "time2"): "acceleration",
}
_WORD = r"(?:[°º](?:\s?c(?![^\W\d_]))?|[%％℃″]|[^\W\d_]+(?:\^?[23](?!\w))?)"
_TOKEN = re.compile(rf"[\s-]?\s*(?P<word>{_WORD})")
_RATE = re.compile(rf"\s*(?:/|⁄|\bper\b)\s*(?P<under>{_WORD})")
_METRE = re.compile(r"(?:\s*[·⋅*]?\s*|-)m(?:et(?:er|re)s?)?(?![\w/])")
_DEGREES_OF = re.compile(r"\s+(?:celsius|c)(?!\w)")


class _Unit(NamedTuple):
    """A unit in a text: a number x of it is ``x * factor`` of its base unit; it ends at ``end``."""

    dimension: str
    factor: float
    end: int


def _unit_at(text: str, at: int) -> _Unit:
    """The unit in a casefolded text after a number that ends at ``at``; a dimensionless one if there is none."""
    token = _TOKEN.match(text, at)
    if token is None or (found := _known(token["word"])) is None:
        return _Unit("", 1.0, at)
    (dimension, factor), end = found, token.end()
    if dimension == "force" and (metre := _METRE.match(text, end)):
        dimension, end = "torque", metre.end()
    elif dimension == "angle" and (scale := _DEGREES_OF.match(text, end)):
        dimension, end = "temperature", scale.end()
    if (rate := _RATE.match(text, end)) is not None and (under := _known(rate["under"])) is not None:
        dimension = _RATES.get((dimension, under[0]), f"{dimension}/{under[0]}")
        factor, end = factor / under[1], rate.end()
    return _Unit(dimension, factor, end)


def _known(word: str) -> tuple[str, float] | None:
    plain = word.replace(" ", "").replace("^", "")
    return _KNOWN.get(plain) or (_KNOWN.get(plain[:-1]) if plain[-1:] == "s" and len(plain) > 3 else None)


_DIGITS = re.compile(r"\d(?:\d{0,2}(?:[ \u00a0]\d{3})+(?![\d.,])|\d*(?:[.,]\d+)*)(?:e[-+]?\d+(?!\w))?")
_THOUSANDS = re.compile(r"[-+]?\d{1,3}(,\d{3})+(\.\d+)?")
_TO = re.compile(r"\s*(?P<word>\bto\b|–|—|-|~|and\b|±|\+/-)\s*")
_FRACTION = re.compile(r"[/⁄](?P<under>\d+)(?![\d/.])")
_ATTACHED = re.compile(r"(?P<size>k)(?!\w)|(?P<share>x)(?!\w)|(?!x\d)[a-z]")
_MORE = "more|greater|higher|larger|longer|faster|harder|hotter|warmer|wider|deeper|stronger|later"
_LESS = "less|fewer|lower|smaller|shorter|slower|softer|colder|cooler|closer|weaker|earlier"
_BEFORE = re.compile(
    rf"(?:(?P<low>>=?|≥|\b(?:at (?:the )?least|(?:no|not|never) (?:{_LESS}) than|(?:{_MORE}) than|minimum|min"
    r"|not (?:below|under)|above|over|exceed(?:s|ing|ed)?|beyond)\b)"
    rf"|(?P<high><=?|≤|\b(?:at (?:the )?most|(?:no|not|never) (?:{_MORE}) than|(?:{_LESS}) than|maximum|max|up to"
    r"|not (?:above|over|exceed(?:ing)?)|below|under|within|limited to)\b)"
    r"|\b(?P<between>between)\b)\.?(?: (?:of|at|to|about))*\s*$"
)
_BEHIND = re.compile(
    rf"\s*,?\s*(?:(?P<low>or (?:above|over|{_MORE})\b|and (?:above|more)\b|at (?:the )?least\b(?!\s+\d)|minimum\b)"
    rf"|or (?:below|under|{_LESS})\b|at (?:the )?most\b(?!\s+\d)|max(?:imum)?\b)"
)
SAME_SIDE = 0.6
"""Two upper (or two lower) bounds disagree when they differ by more than this share of the larger one."""
TOLERANCE = 0.2
"""The largest difference of agreeing figures, as a share of the larger one."""


class Quantity(NamedTuple):
    """What a text says about a number: it lies in [low, high] of the base unit of ``dimension``, "" for a bare one."""

    dimension: str
    low: float
    high: float

    @property
    def one_sided(self) -> bool:
        """Whether it is a bound rather than a figure."""
        return math.isinf(self.low) or math.isinf(self.high)

    def inverted(self) -> Quantity:
        """The other side of a bound: what "never above 5" leaves."""
        if math.isinf(self.high):
            return Quantity(self.dimension, -math.inf, self.low)
        return Quantity(self.dimension, self.high, math.inf)

    def disagrees(self, other: Quantity) -> bool:
        """Whether no number satisfies both, or two bounds on one side lie far apart."""
        ends = ((self.low, other.low), (self.high, other.high))
        gap = max(ends[0]) - min(ends[1])
        if not gap > 0:
            both = [(a, b) for a, b in ends if math.isfinite(a) and math.isfinite(b)]
            far = any(abs(a - b) > SAME_SIDE * max(abs(a), abs(b)) for a, b in both)
            return self.one_sided and other.one_sided and far
        # Bounds and ranges are deliberate; single figures vary from one episode to the next.
        figures = self.low == self.high and other.low == other.high
        scale = max((abs(v) for pair in ends for v in pair if math.isfinite(v)), default=0.0)
        return gap > (TOLERANCE if figures else 0.02) * scale


class QuantityAt(NamedTuple):
    """A quantity and its position in the text, ``start`` to ``end``."""

    quantity: Quantity
    start: int
    end: int


def quantities(text: str) -> list[QuantityAt]:
    """All quantities of a :func:`~gvla2.memory.meaning.plain_text.plain_text`, in reading order."""
    atoms = deque[tuple[float, int, int]]()
    for match in _DIGITS.finditer(text):
        start = _start(text, match.start())
        value = _number(text[start : match.end()]) if start >= 0 else None
        if value is not None:
            atoms.append((value, start, match.end()))
    found: list[QuantityAt] = []
    last = 0
    while atoms:
        value, start, end = atoms.popleft()
        if start < last:
            continue
        if (over := _FRACTION.match(text, end)) is not None and float(over["under"]) > 0:
            value, end = value / float(over["under"]), over.end()
        unit = _unit_at(text, end)
        if not unit.dimension and (ending := _ATTACHED.match(text, end)):
            if ending["size"] is None and ending["share"] is None:
                continue  # "2nd", "3d"
            unit = _Unit("ratio" if ending["share"] else "", 1000.0 if ending["size"] else 1.0, ending.end())
        front, end, spread = _BEFORE.search(text, max(last, start - 48), start), unit.end, False
        between = front is not None and front["between"] is not None
        low = high = value * unit.factor
        to = _TO.match(text, end) if atoms else None
        if to is not None and to.end() == atoms[0][1] and (to["word"] != "and" or between):
            high, _, end = atoms.popleft()
            other = _unit_at(text, end)
            end, spread = other.end, to["word"] in ("±", "+/-")
            high *= other.factor if other.dimension else unit.factor
            if not unit.dimension:
                unit, low = other, low * other.factor
        if spread:
            low, high = low - high, low + high
        elif high == low and (bound := front if front and not between else _BEHIND.match(text, end)):
            low, high = (low, math.inf) if bound["low"] else (-math.inf, high)
            end = max(end, bound.end())
        last = end
        read = Quantity(unit.dimension, min(low, high), max(low, high))
        found.append(QuantityAt(read, front.start() if front else start, end))
    return found


def _start(text: str, at: int) -> int:
    """Where a number begins whose digits begin at ``at``, with its sign; -1 if the digits belong to a word."""
    before = text[at - 1] if at else " "
    if before in "-−+":
        if at < 2 or not _in_word(text[at - 2]):
            return at - 1
        return -1 if text[at - 2].isalpha() and before == "-" else at  # "abc-17"
    return -1 if _in_word(before) or (before == "." and at > 1 and _in_word(text[at - 2])) else at


def _in_word(character: str) -> bool:
    return character.isalnum() or character == "_"


def _number(text: str) -> float | None:
    """``1.5``, ``1,5``, ``1,000``, ``10 000``; None if it is not a single number, such as ``3.11.2``."""
    plain = text.replace("−", "-").replace(" ", "").replace("\u00a0", "")
    try:
        value = float(plain.replace(",", "") if _THOUSANDS.fullmatch(plain) else plain.replace(",", "."))
    except ValueError:
        return None
    return value if math.isfinite(value) else None
