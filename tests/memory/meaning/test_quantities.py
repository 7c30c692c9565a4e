"""Figures in digits and in words, their units and bounds; names with numbers are none."""

import math
import unicodedata

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gvla2.memory.meaning.plain_text import plain_text
from gvla2.memory.meaning.quantities import Quantity, quantities

INF = math.inf


def figures(text: str) -> list[tuple[str, float, float]]:
    """Dimension and bounds of each figure of a text, as it is read."""
    found = quantities(plain_text(text))
    return [(f.quantity.dimension, f.quantity.low, f.quantity.high) for f in found]


SAME = """
length | 0.2 | 20 cm ~ 0.2 m ~ 200 mm ~ twenty centimetres ~ 20 centimeters
length | 0.1 | 10cm ~ ten centimeters ~ a 10-cm ~ 10 cm
length | 0.5 | half a metre ~ 50 cm
time | 0.5 | half a second ~ 500 ms
time | 150 | two and a half minutes ~ 150 s ~ 2.5 min
time | 86400 | daily ~ 24 hours ~ 1 day
angle | 90 | a quarter turn ~ 90° ~ 90 degrees ~ ninety degrees
angle | 180 | half a turn ~ 180 deg
angle | 95 | ninety-five degrees
times | 2 | twice ~ 2 times ~ two times
 | 12 | a dozen eggs ~ 12 eggs ~ twelve eggs
 | 10000 | 10,000 parts ~ 10 000 parts ~ 10k parts ~ 1e4 parts ~ ten thousand parts
ratio | 0.5 | 50 % ~ 50 percent ~ half full ~ at half speed ~ half of the water
volume | 0.75 | three quarters of a litre ~ 750 ml
speed | 0.05 | 5 cm/s ~ 5cm/s ~ 50 mm/s ~ 5 centimetres per second
turning | 30 | 30 °/s ~ 30 degrees per second ~ 5 rpm ~ 30 deg/s
torque | 5 | 5 Nm ~ 5 N·m ~ 5 newton metres ~ 5 N m ~ 500 Ncm
pressure | 60000 | 60 kPa ~ 0.6 bar ~ 600 mbar
frequency | 16000 | 16 kHz ~ 16000 Hz ~ 16000 hertz
temperature | 20 | 20 °C ~ 20 degrees Celsius
acceleration | 0.5 | 0.5 m/s² ~ 0.5 m/s2 ~ 0.5 m/s^2
volume/time | 0.02 | 20 ml per second ~ 20 ml/s
"""
ONE = [
    (line.split(" | ")[0].strip(), float(line.split(" | ")[1]), text.strip())
    for line in SAME.strip("\n").split("\n")
    for text in line.split(" | ")[2].split("~")
]


@pytest.mark.parametrize(("dimension", "value", "text"), ONE)
def test_one_figure_however_it_is_written(dimension: str, value: float, text: str) -> None:
    found = figures(unicodedata.normalize("NFKC", text))
    assert [f[0] for f in found] == [dimension]
    assert found[0][1:] == pytest.approx((value, value))


BOUNDS = """
-inf 5 | at most 5 N ~ 5 N at most ~ no more than 5 N ~ not above 5 N ~ up to 5 N ~ 5 N max
-inf 5 | a maximum of 5 N ~ 5 N or less
-inf 5 | weaker than 5 N ~ no stronger than 5 N ~ under 5 N ~ <5 N ~ ≤ 5 N ~ not exceeding 5 N ~ at the most 5 N
-inf 5 | max. 5 N
5 inf | at least 5 N ~ 5 N at least ~ 5 N or more ~ no less than 5 N ~ a minimum of 5 N ~ min. 5 N ~ over 5 N ~ ≥5 N
5 inf | stronger than 5 N ~ no weaker than 5 N ~ 5 N and above ~ more than 5 N ~ 5 N minimum ~ exceeding 5 N
"""
BOUNDED = [
    (float(line.split()[0]), float(line.split()[1]), text.strip())
    for line in BOUNDS.strip().split("\n")
    for text in line.split("|")[1].split("~")
]


@pytest.mark.parametrize(("low", "high", "text"), BOUNDED)
def test_bounds_before_and_behind_a_number(low: float, high: float, text: str) -> None:
    assert figures(text) == [("force", low, high)]


@pytest.mark.parametrize(
    ("text", "low", "high"),
    [
        ("2-3 cm", 0.02, 0.03),
        ("2–3 cm", 0.02, 0.03),
        ("2 to 3 cm", 0.02, 0.03),
        ("20 mm to 3 cm", 0.02, 0.03),
        ("between 2 and 3 cm", 0.02, 0.03),
        ("two to three centimetres", 0.02, 0.03),
        ("2.5 ± 0.5 cm", 0.02, 0.03),
    ],
)
def test_ranges(text: str, low: float, high: float) -> None:
    assert [f[1:] for f in figures(text)] == [pytest.approx((low, high))]


NO_FIGURES = [
    text.strip()
    for text in """
the red one moves ~ one of them falls ~ one by one ~ once the water boils
take a second image ~ the second door ~ a hand ~ the left half ~ the 2nd door ~ the 3D printer
at once ~ the two bolts ~ Python 3.11 ~ numpy 1.26 ~ USB 3.0 ~ CUDA 11.8 ~ driver 520
v1.2.3 ~ 192.168.0.1 ~ cam0 ~ eth0 ~ M6x20 ~ 3fa9c1e ~ 7bd02aa ~ 2024-03-01 ~ room 12
joint 2 ~ line 40 ~ issue 311 ~ bin A3 ~ ABC-1042 ~ key A-17 ~ #44 ~ parser2.py
F5 ~ step 3 ~ version 1.8 ~ firmware 2.0.1rc1 ~ node17a
""".replace("\n", "~").split("~")
    if text.strip()
]


@pytest.mark.parametrize(
    "text",
    NO_FIGURES,
)
def test_names_articles_and_pronouns_are_no_figures(text: str) -> None:
    assert figures(text) == []


@pytest.mark.parametrize(
    ("text", "joined"),
    [
        ("on python 3.11 use it", "on python nr3_11 use it"),
        ("in room 12", "in room nr12"),
        ("call 192.168.0.1 now", "call nr192_168_0_1 now"),
        ("pin numpy below 2.0", "pin numpy below 2.0"),
        ("python 3.11 or newer", "python 3.11 or newer"),
        ("joint 2 at 90 degrees", "joint nr2 at 90 degrees"),
        ("row 5 mm apart", "row 5 mm apart"),
        ("5 cm of it", "5 cm of it"),
    ],
)
def test_names_become_one_word(text: str, joined: str) -> None:
    assert plain_text(text) == joined
    assert plain_text(joined) == joined


def test_what_goes_on_behind_a_figure_is_no_bound() -> None:
    assert figures("lift it 10 cm and lower it slowly") == [("length", 0.1, 0.1)]
    assert figures("10 cm above the table") == [("length", 0.1, 0.1)]
    assert figures("spray from 20 cm away") == [("length", 0.2, 0.2)]
    assert [f[0] for f in figures("5 a day")] == [""]


def test_bounds_on_one_side_disagree_when_far_apart() -> None:
    two, half, close = (Quantity("mass", -INF, high) for high in (2.0, 0.5, 1.8))
    assert two.disagrees(half)
    assert half.disagrees(two)
    assert not two.disagrees(close)
    assert not two.disagrees(Quantity("mass", 0.1, INF))


@given(st.text(alphabet="0123456789.,-x:/% cmhalftwon°e+", max_size=40))
@settings(max_examples=300, deadline=None)
def test_any_text_gives_figures_in_order_and_within_it(text: str) -> None:
    last = 0
    for found in quantities(plain_text(text)):
        assert 0 <= found.start <= found.end
        assert found.end >= last
        assert not math.isnan(found.quantity.low)
        last = found.end
