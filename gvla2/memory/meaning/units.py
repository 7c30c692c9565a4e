"""English and international units of measure, alone and as rates: "cm/s", "metres per second", "N·m", "°C"."""

from __future__ import annotations

import re
from typing import NamedTuple

_UNITS = """
length 1e-9 nanometer nanometers nanometre nanometres
length 1e-6 µm um micron microns micrometer micrometers micrometre micrometres
length 0.001 mm millimeter millimeters millimetre millimetres
length 0.01 cm centimeter centimeters centimetre centimetres
length 0.1 dm
length 1 m meter meters metre metres
length 1000 km kilometer kilometers kilometre kilometres
length 0.0254 inch inches ″
length 0.3048 ft foot feet
length 0.9144 yd yard yards
area 1 m2 sqm
area 0.0001 cm2
area 0.000001 mm2
angle 1 degree degrees deg ° º
angle 0.001 mdeg
angle 57.29577951308232 rad radian radians
angle 0.05729577951308232 mrad
angle 360 revolution revolutions rotations rotation turns
temperature 1 °c ℃ celsius
temperature-k 1 kelvin k
temperature-f 1 °f ℉ fahrenheit
time 1e-9 ns nanoseconds
time 1e-6 µs microsecond microseconds
time 0.001 ms millisecond milliseconds millis msec
time 1 s sec secs second seconds
time 60 min mins minute minutes
time 3600 h hr hrs hour hours
time 86400 day days
time 604800 week weeks
time 2629800 month months
time 31557600 year years
ratio 0.01 % percent ％ pct
mass 1e-6 mg milligram milligrams
mass 0.001 g gram grams
mass 1 kg kilo kilos kilogram kilograms
mass 0.45359237 lb lbs pound pounds
mass 0.028349523 oz ounce ounces
mass 1000 tonne tonnes
volume 0.001 ml milliliter milliliters millilitre millilitres cm3 cc
volume 0.01 cl centilitre centilitres
volume 0.1 dl
volume 1 l liter liters litre litres dm3
volume 1000 m3
speed 0.2777777777777778 kmh kph
speed 0.44704 mph
turning 6 rpm
force 1 n newton newtons
force 0.001 mn millinewton
force 1000 kn
torque 1 nm newtonmeter newtonmetre newtonmetres
torque 0.01 ncm
torque 0.001 mnm
pressure 1 pa pascal pascals
pressure 100 hpa mbar millibar
pressure 1000 kpa
pressure 1000000 mpa
pressure 100000 bar bars
pressure 6894.757 psi
voltage 0.001 mv
voltage 1 v volt volts
voltage 1000 kv
current 0.001 ma
current 1 a amp amps ampere
charge 1 mah
power 0.001 mw
power 1 w watt watts
power 1000 kw
energy 1 j joule joules
energy 3600000 kwh
resistance 1 ohm ohms ω
resistance 1000 kω kohm
light 1 lux lx
light-flow 1 lumen lumens lm
loudness 1 db decibel decibels
frequency 1 hz hertz fps
frequency 1000 khz
frequency 1000000 mhz
frequency 1000000000 ghz
density 1 dpi ppi
bytes 1 byte bytes
bytes 1024 kb kib kilobyte kilobytes
bytes 1048576 mb mib megabyte megabytes
bytes 1073741824 gb gib gigabyte gigabytes
bytes 1099511627776 tb tib terabyte terabytes
bits 1 bit bits
bits 1000 kbit
bits 1000000 mbit
bits 1000000000 gbit
bits/time 1000 kbps
bits/time 1000000 mbps
bits/time 1000000000 gbps
pixels 1 px pixel pixels
times 1 times
time2 1 s2
"""

UNITS: dict[str, tuple[str, float]] = {
    word: (line.split()[0], float(line.split()[1]))
    for line in _UNITS.strip().split("\n")
    for word in line.split()[2:]
}
"""Unit -> dimension and factor to its base unit (metres, degrees, degrees Celsius, seconds, kilograms, ...)."""

_RATES = {
    ("length", "time"): "speed",
    ("angle", "time"): "turning",
    ("times", "time"): "frequency",
    ("length", "time2"): "acceleration",
}
_OFFSETS = {"temperature-k": (1.0, -273.15), "temperature-f": (5.0 / 9.0, -160.0 / 9.0)}
_PER = r"\s*(?:/|⁄|\bper\b)\s*"
_WORD = r"(?:[°º](?:\s?[cfk](?![^\W\d_]))?|[%％℃℉″]|[^\W\d_]+(?:\^?[23](?!\w))?)"
_TOKEN = re.compile(rf"(?P<gap>[\s-]?\s*)(?P<word>{_WORD})")
_RATE = re.compile(rf"{_PER}(?P<under>{_WORD})")
_FURTHER = re.compile(
    r"\s*[·⋅*]?\s*(?P<metre>m|meters?|metres?)(?![\w/])|-(?P<hyphen>met(?:er|re)s?)\b"
    r"|\s+(?P<scale>celsius|fahrenheit|c|f)(?!\w)"
)
_ARTICLES = frozenset({"a", "an"})


class Unit(NamedTuple):
    """A unit in a text: a number x of it is ``x * factor + offset`` of its base unit; it ends at ``end``."""

    dimension: str
    factor: float
    offset: float
    end: int


def unit_at(text: str, at: int, spelled: bool = False) -> Unit | None:
    """The unit that stands in a casefolded text behind a number that ends at ``at``, None where there is none.

    After a number in words (``spelled``), single letters are articles and no units.
    """
    token = _TOKEN.match(text, at)
    if token is None:
        return None
    word, end = token["word"], token.end()
    found = UNITS.get(word) or UNITS.get(word.replace(" ", "").replace("^", ""))
    if found is None:
        return None
    if len(word) == 1 and not _letter_counts(text, word, end, spelled, bool(token["gap"])):
        return None
    dimension, factor = found
    if word[0] in "°º" and (dimension, factor) == ("angle", 1.0) and word not in ("°", "º"):
        dimension = {"c": "temperature", "f": "temperature-f", "k": "temperature-k"}[word[-1]]
    if dimension in ("force", "angle") and (further := _FURTHER.match(text, end)):
        if further["scale"] and dimension == "angle":
            dimension = "temperature" if further["scale"][0] == "c" else "temperature-f"
            end = further.end()
        elif dimension == "force" and (further["metre"] or further["hyphen"]):
            dimension, end = "torque", further.end()
    if dimension in _OFFSETS:
        factor, offset = _OFFSETS[dimension]
        return Unit("temperature", factor, offset, end)
    if (rate := _RATE.match(text, end)) is not None:
        word = rate["under"].replace("^", "")
        under = UNITS.get(word)
        if under is not None:
            dimension = _RATES.get((dimension, under[0]), f"{dimension}/{under[0]}")
            factor /= under[1]
            end = rate.end()
    return Unit(dimension, factor, 0.0, end)


def _letter_counts(text: str, word: str, end: int, spelled: bool, spaced: bool) -> bool:
    """Whether a single letter is a unit: "5 a" is a current and "5 a day" is none, "300 K" is, "4k" is not."""
    if not word.isalpha():
        return True
    if spelled:
        return False
    if word == "k":
        return spaced
    return not (word in _ARTICLES and re.match(r"\s+\w", text[end : end + 8]))
