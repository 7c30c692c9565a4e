"""Units of measure, alone and as rates: "cm/s", "metres per second", "N·m", "°C"."""

from __future__ import annotations

import re
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


class Unit(NamedTuple):
    """A unit in a text: a number x of it is ``x * factor`` of its base unit; it ends at ``end``."""

    dimension: str
    factor: float
    end: int


def unit_at(text: str, at: int) -> Unit | None:
    """The unit that stands in a casefolded text behind a number that ends at ``at``, None where there is none."""
    token = _TOKEN.match(text, at)
    if token is None or (found := _known(token["word"])) is None:
        return None
    (dimension, factor), end = found, token.end()
    if dimension == "force" and (metre := _METRE.match(text, end)):
        dimension, end = "torque", metre.end()
    elif dimension == "angle" and (scale := _DEGREES_OF.match(text, end)):
        dimension, end = "temperature", scale.end()
    if (rate := _RATE.match(text, end)) is not None and (under := _known(rate["under"])) is not None:
        dimension = _RATES.get((dimension, under[0]), f"{dimension}/{under[0]}")
        factor, end = factor / under[1], rate.end()
    return Unit(dimension, factor, end)


def _known(word: str) -> tuple[str, float] | None:
    plain = word.replace(" ", "").replace("^", "")
    return _KNOWN.get(plain) or (_KNOWN.get(plain[:-1]) if plain[-1:] == "s" and len(plain) > 3 else None)
