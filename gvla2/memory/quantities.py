"""Numbers with units in a text, as intervals in base units: "at least 5 cm" is a length in [0.05, inf)."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass

_UNITS = """
length 1e-6 µm micron microns mikrometer 微米
length 0.001 mm millimeter millimeters millimetre millimetres millimètre millimètres milímetro milímetros 毫米
length 0.01 cm centimeter centimeters centimetre centimetres zentimeter
length 0.01 centimètre centimètres centímetro centímetros 厘米 公分
length 0.1 dm
length 1 m meter meters metre metres mètre mètres metro metros 米
length 1000 km kilometer kilometers kilometre kilometres
length 1000 kilomètre kilomètres kilómetro kilómetros 千米 公里
length 0.0254 inch inches zoll pouce pouces pulgada pulgadas 英寸 ″
length 0.3048 ft foot feet
angle 1 degree degrees deg ° grad degré degrés grado grados 度
angle 57.29577951308232 rad radian radians radiant radianten radianes 弧度
angle 360 revolution revolutions umdrehung umdrehungen 圈
temperature 1 °c ℃ celsius 摄氏度
time 1e-6 µs microseconds
time 0.001 ms millisecond milliseconds millisekunde millisekunden milliseconde millisecondes
time 0.001 milisegundo milisegundos 毫秒
time 1 s sec secs second seconds sek sekunde sekunden seconde secondes segundo segundos 秒 秒钟
time 60 min mins minute minutes minuten minuto minutos 分钟
time 3600 h hr hrs hour hours stunde stunden heure heures hora horas 小时
time 86400 day days tag tage tagen jour jours día días 天
time 604800 week weeks woche wochen semaine semaines semana semanas 周 星期
ratio 0.01 % percent prozent pourcent ％
mass 1e-6 mg milligram milligrams
mass 0.001 g gram grams gramm gramme grammes gramo gramos 克
mass 1 kg kilo kilos kilogram kilograms kilogramm kilogramme kilogrammes kilogramo kilogramos 千克 公斤
mass 0.45359237 lb lbs pound pounds
mass 0.028349523 oz ounce ounces
volume 0.001 ml milliliter milliliters millilitre millilitres mililitro mililitros 毫升
volume 0.01 cl
volume 1 l liter liters litre litres litro litros 升
speed 1 m/s 米/秒
speed 0.01 cm/s
speed 0.001 mm/s
speed 0.2777777777777778 km/h kph
speed 0.44704 mph
turning 1 °/s deg/s
turning 57.29577951308232 rad/s
turning 6 rpm
force 1 n newton newtons 牛
force 1000 kn
torque 1 nm newtonmeter
pressure 1 pa pascal
pressure 1000 kpa
pressure 100000 bar bars
voltage 0.001 mv
voltage 1 v volt volts 伏
current 0.001 ma
current 1 a amp amps ampere
power 1 w watt watts
power 1000 kw
frequency 1 hz hertz fps 赫兹
frequency 1000 khz
frequency 1000000 mhz
bytes 1 byte bytes
bytes 1024 kb kib
bytes 1048576 mb mib
bytes 1073741824 gb gib
bytes 1099511627776 tb tib
pixels 1 px pixel pixels
times 1 times mal fois veces 次 遍
"""

UNITS: dict[str, tuple[str, float]] = {
    word: (line.split()[0], float(line.split()[1]))
    for line in _UNITS.strip().split("\n")
    for word in line.split()[2:]
}
"""Unit -> dimension and factor to its base unit (metres, degrees, degrees Celsius, seconds, kilograms, ...)."""

_AT_LEAST = (
    r"at least|no less than|not less than|no fewer than|minimum(?: of)?|min\.?|more than|above|over|exceeding"
    r"|beyond"
    r"|from|>=|≥|>|mindestens|minimal|wenigstens|mehr als|über|oberhalb(?: von)?|ab"
    r"|au moins|plus de|au-dessus de|al menos|por lo menos|como mínimo|más de"
    r"|至少|最少|不少于|不低于|超过|大于|高于"
)
_AT_MOST = (
    r"at most|no more than|not more than|up to|maximum(?: of)?|max\.?|less than|fewer than|below|under|within"
    r"|not exceeding"
    r"|<=|≤|<|höchstens|maximal|nicht mehr als|weniger als|unter|unterhalb(?: von)?|bis zu"
    r"|au plus|moins de|jusqu'à|pas plus de|como máximo|a lo sumo|menos de|no más de|hasta"
    r"|至多|最多|不超过|不大于|不高于|少于|小于|低于"
)
_ABOUT = (
    r"about|around|roughly|approximately|approx\.?|circa|ca\.|~|≈|ungefähr|etwa|rund"
    r"|environ|aproximadamente|unos|大约|约"
)
_TO = "to|bis|à|hasta|a|–|—|-|到|至|and|und|et|y|和"
_EDGE = r"(?<![^\W\u3400-\u9fff])"
_NUMBER = r"[-−+]?\d+(?:[.,]\d+)*(?:e-?\d+)?"


def _pattern(choices: Callable[[str], str], flags: int) -> re.Pattern[str]:
    """The pattern of a quantity; ``choices`` may leave out alternatives that the texts cannot have."""
    units = choices(
        "|".join(
            re.escape(word) + (r"(?![\w/])" if word[-1].isascii() and word[-1].isalnum() else "")
            for word in sorted(UNITS, key=lambda word: (-len(word), word))
        )
    )
    low, high, about, to = map(choices, (_AT_LEAST, _AT_MOST, _ABOUT, _TO))
    return re.compile(
        rf"(?:{_EDGE}(?P<low>{low})|{_EDGE}(?P<high>{high}))?\s*(?:{_EDGE}(?:of|als|de|von|à|a)\s+)?"
        rf"(?:{_EDGE}(?P<about>{about})\s*)?(?P<between>{_EDGE}(?:between|zwischen|entre)\s+)?"
        rf"{_EDGE}(?<!\.)(?P<first>{_NUMBER})\s*(?P<unit1>{units})?"
        rf"(?:\s*(?P<to>{to})\s*(?P<second>{_NUMBER})\s*(?P<unit2>{units})?)?",
        flags,
    )


def _plain(alternatives: str) -> str:
    return "|".join(word for word in alternatives.split("|") if word.isascii())


_QUANTITY = _pattern(lambda alternatives: alternatives, re.IGNORECASE)
_PLAIN_QUANTITY = _pattern(_plain, re.ASCII)
"""For casefolded ASCII: the same, several times as fast."""
_DIGIT = re.compile(r"\d")
_JOINS = frozenset({"and", "und", "et", "y", "和", "a"})


@dataclass(frozen=True)
class Quantity:
    """What a text says about a number: it lies in [low, high] of the base unit of ``dimension``.

    ``about`` marks a rough figure; ``dimension`` is "" for a bare number.
    """

    dimension: str
    low: float
    high: float
    about: bool = False

    @property
    def one_sided(self) -> bool:
        """Whether it is a bound rather than a figure."""
        return math.isinf(self.low) or math.isinf(self.high)

    def inverted(self) -> Quantity:
        """The other side of a bound: what "never above 5" leaves."""
        if math.isinf(self.high):
            return Quantity(self.dimension, -math.inf, self.low, self.about)
        return Quantity(self.dimension, self.high, math.inf, self.about)

    def disagrees(self, other: Quantity, tolerance: float) -> bool:
        """Whether no number satisfies both, beyond ``tolerance`` (a share of the larger figure)."""
        gap = max(self.low, other.low) - min(self.high, other.high)
        if not gap > 0:
            return False
        scale = max(
            (abs(v) for v in (self.low, self.high, other.low, other.high) if math.isfinite(v)), default=0.0
        )
        # Who gives a bound or a range means it; single figures vary from one episode to the next.
        figures = self.low == self.high and other.low == other.high
        slack = tolerance * (2.0 if self.about or other.about else 1.0) if figures else 0.02
        return gap > slack * scale


@dataclass(frozen=True)
class Found:
    """A quantity and where it stands in the text, ``start`` to ``end``."""

    quantity: Quantity
    start: int
    end: int


def quantities(text: str) -> list[Found]:
    """All quantities of a casefolded text, in reading order."""
    found = []
    for match in _matches(text):
        first = _number(match["first"])
        if first is None:
            continue
        end = match.end()
        second = _number(match["second"]) if match["second"] else None
        if second is not None and match["to"] in _JOINS and not match["between"]:
            second, end = None, match.end("unit1") if match["unit1"] else match.end("first")
        unit = match["unit1"] or (match["unit2"] if second is not None else None) or ""
        dimension, factor = UNITS.get(unit.casefold(), ("", 1.0))
        if second is not None and match["unit2"]:
            high = second * UNITS[match["unit2"].casefold()][1]
        else:
            high = (first if second is None else second) * factor
        low = first * factor
        if second is None and match["low"]:
            high = math.inf
        elif second is None and match["high"]:
            low = -math.inf
        quantity = Quantity(dimension, min(low, high), max(low, high), bool(match["about"]))
        found.append(Found(quantity, match.start(), end))
    return found


def _matches(text: str) -> Iterator[re.Match[str]]:
    """Where the pattern matches; nothing is searched in which there is no digit."""
    pattern, at = _PLAIN_QUANTITY if text.isascii() and text == text.lower() else _QUANTITY, 0
    while _DIGIT.search(text, at) is not None:
        match = pattern.search(text, at)
        if match is None:
            return
        yield match
        at = match.end()


def _number(text: str) -> float | None:
    """``1.5``, ``1,5``, ``1,000``; None for what is no single number, such as ``3.11.2``."""
    plain = text.replace("−", "-")
    if re.fullmatch(r"[-+]?\d{1,3}(,\d{3})+", plain):
        plain = plain.replace(",", "")
    try:
        value = float(plain.replace(",", "."))
    except ValueError:
        return None
    return value if math.isfinite(value) else None
