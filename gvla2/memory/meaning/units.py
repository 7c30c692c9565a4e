"""Units of measure in six languages, alone and as rates: "cm/s", "metres per second", "N·m", "°C"."""

from __future__ import annotations

import re
from typing import NamedTuple

_UNITS = """
length 1e-9 nanometer nanometers nanometre nanometres
length 1e-6 µm um micron microns micrometer micrometers micrometre micrometres mikrometer 微米
length 0.001 mm millimeter millimeters millimetre millimetres millimètre millimètres milímetro milímetros 毫米 мм
length 0.001 millimetro millimetri milimetro milimetros ミリ
length 0.01 cm centimeter centimeters centimetre centimetres zentimeter zentimetern см センチ
length 0.01 centimètre centimètres centímetro centímetros centimetro centimetri centimetros 厘米 公分
length 0.1 dm dezimeter 分米
length 1 m meter meters metre metres metern mètre mètres metro metros metri 米 м メートル
length 1000 km kilometer kilometers kilometre kilometres kilometern kilomètre kilomètres
length 1000 kilómetro kilómetros 千米 公里 км
length 0.0254 inch inches zoll pouce pouces pulgada pulgadas 英寸 ″
length 0.3048 ft foot feet 英尺
length 0.9144 yd yard yards
area 1 m2 sqm
area 0.0001 cm2
area 0.000001 mm2
angle 1 degree degrees deg ° grad degré degrés grado grados gradi grau graus 度 º
angle 0.001 mdeg
angle 57.29577951308232 rad radian radians radiant radianten radianes 弧度
angle 0.05729577951308232 mrad
angle 360 revolution revolutions umdrehung umdrehungen rotations rotation turns vuelta vueltas giros 圈 转
temperature 1 °c ℃ celsius 摄氏度
temperature-k 1 kelvin k
temperature-f 1 °f ℉ fahrenheit 华氏度
time 1e-9 ns nanoseconds
time 1e-6 µs microsecond microseconds mikrosekunden 微秒
time 0.001 ms millisecond milliseconds millis msec millisekunde millisekunden milliseconde millisecondes
time 0.001 milisegundo milisegundos 毫秒
time 1 s sec secs second seconds sek sekunde sekunden seconde secondes segundo segundos secondi 秒 秒钟 сек
time 60 min mins minute minutes minuten minuto minutos minuti 分钟 分 мин
time 3600 h hr hrs hour hours stunde stunden std heure heures hora horas 小时 个小时 钟头
time 86400 day days tag tage tagen jour jours día días dia dias 天
time 604800 week weeks woche wochen semaine semaines semana semanas 周 星期
time 2629800 month months monat monate monaten mois mes meses 个月
time 31557600 year years jahr jahre jahren ans année années año años 年
ratio 0.01 % percent prozent pourcent ％ pct
mass 1e-6 mg milligram milligrams milligramm
mass 0.001 g gram grams gramm gramme grammes gramo gramos 克 г
mass 1 kg kilo kilos kilogram kilograms kilogramm kilogramme kilogrammes kilogramo kilogramos 千克 公斤 кг
mass 0.45359237 lb lbs pound pounds 磅
mass 0.028349523 oz ounce ounces
mass 1000 tonne tonnes tonnen toneladas 吨
volume 0.001 ml milliliter milliliters millilitre millilitres mililitro mililitros 毫升 cm3 cc мл
volume 0.01 cl centilitre centilitres
volume 0.1 dl
volume 1 l liter liters litre litres litern litro litros 升 dm3 л
volume 1000 m3 立方米
speed 0.2777777777777778 kmh kph
speed 0.44704 mph
turning 6 rpm u/min tr/min 转/分
force 1 n newton newtons 牛 牛顿
force 0.001 mn millinewton
force 1000 kn
torque 1 nm newtonmeter newtonmetern newtonmetre newtonmetres 牛米 牛·米
torque 0.01 ncm
torque 0.001 mnm
pressure 1 pa pascal pascals 帕
pressure 100 hpa mbar millibar
pressure 1000 kpa 千帕
pressure 1000000 mpa 兆帕
pressure 100000 bar bars
pressure 6894.757 psi
voltage 0.001 mv
voltage 1 v volt volts voltios 伏 伏特
voltage 1000 kv
current 0.001 ma
current 1 a amp amps ampere amperes 安培 安
charge 1 mah
power 0.001 mw
power 1 w watt watts vatios 瓦
power 1000 kw
energy 1 j joule joules
energy 3600000 kwh
resistance 1 ohm ohms ω
resistance 1000 kω kohm
light 1 lux lx
light-flow 1 lumen lumens lm
loudness 1 db decibel decibels
frequency 1 hz hertz fps 赫兹 赫
frequency 1000 khz 千赫
frequency 1000000 mhz
frequency 1000000000 ghz
density 1 dpi ppi
bytes 1 byte bytes 字节
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
pixels 1 px pixel pixels píxeles 像素
times 1 times mal fois veces vez 次 遍 回 раз volte vezes
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
_PER = r"\s*(?:/|⁄|\bper\b|\bpro\b|\bpar\b|\bpor\b|\bje\b|每)\s*"
_WORD = r"(?:[°º](?:\s?[cfk](?![^\W\d_]))?|[%％℃℉″]|[^\W\d_]+(?:\^?[23](?!\w))?)"
_TOKEN = re.compile(rf"(?P<gap>[\s-]?\s*)(?P<word>{_WORD})")
_RATE = re.compile(rf"{_PER}(?P<under>{_WORD})")
_FURTHER = re.compile(
    r"\s*[·⋅*]?\s*(?P<metre>m|meters?|metres?|mètres?|metros?|米)(?![\w/])|-(?P<hyphen>met(?:er|re)s?)\b"
    r"|\s+(?P<scale>celsius|fahrenheit|c|f)(?!\w)"
)
_HAN_LENGTHS = (3, 2, 1)
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
    if word in ("m", "n", "rad") or word not in UNITS:
        known = _longest(text, token.start("word"))
        if known is not None:
            word, end = known
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
        under = UNITS.get(word) or UNITS.get(word[:1] if word >= "一" else "")
        if under is not None:
            dimension = _RATES.get((dimension, under[0]), f"{dimension}/{under[0]}")
            factor /= under[1]
            end = rate.end()
    return Unit(dimension, factor, 0.0, end)


def _longest(text: str, at: int) -> tuple[str, int] | None:
    """The longest unit that is written without a space behind it, as in Chinese."""
    if text[at] < "一" and "/" not in text[at : at + 5]:
        return None
    for length in (5, 4, *_HAN_LENGTHS):
        word = text[at : at + length]
        if len(word) == length and word in UNITS and ("/" in word or word[0] >= "一"):
            if "/" in word and text[at + length : at + length + 1].isalnum():
                continue
            return word, at + length
    return None


def _letter_counts(text: str, word: str, end: int, spelled: bool, spaced: bool) -> bool:
    """Whether a single letter is a unit: "5 a" is a current and "5 a day" is none, "300 K" is, "4k" is not."""
    if not word.isalpha() or word >= "一":
        return True
    if spelled:
        return False
    if word == "k":
        return spaced
    return not (word in _ARTICLES and re.match(r"\s+\w", text[end : end + 8]))
