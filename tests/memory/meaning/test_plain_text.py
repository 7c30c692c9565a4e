"""However a text is encoded, it reads the same; and what is written differently on purpose does not."""

import unicodedata

import pytest

from gvla2.memory.meaning.clauses import read
from gvla2.memory.meaning.plain_text import plain_text, unified


@pytest.mark.parametrize(
    ("text", "same"),
    [
        ("10⁵ Pa", "10^5 Pa"),
        ("10⁻³ Pa", "10^\u22123 Pa"),
        ("5 cm²", "5 cm^2"),
        ("H₂O", "H2O"),
        ("base 10₂", "base 10_2"),
        ("1½ l", "1 1\u20442 l"),
        ("½ l", "1\u20442 l"),
        ("Ａ１", "A1"),
        ("O\u0308ffne", "Öffne"),
        ("plain", "plain"),
    ],
)
def test_unified(text: str, same: str) -> None:
    assert unified(text) == same


@pytest.mark.parametrize(
    "text", ["Öffne den Kühlschrank.", "Nimm Öl in die Küche.", "Ferme le volet à côté d'Ève."]
)
def test_composed_and_decomposed_letters_read_the_same(text: str) -> None:
    apart = unicodedata.normalize("NFD", text)
    assert apart != text
    assert plain_text(apart) == plain_text(text)
    assert read(apart) == read(text)


def test_separators_of_names_stay() -> None:
    names = (
        "release/1.4",
        "release/14",
        "foo_1.0",
        "foo_10",
        "PR-1-2",
        "PR-12",
        "host-1.2.3.4",
        "host-12.34",
    )
    assert len({plain_text(f"use {name} now") for name in names}) == len(names)


@pytest.mark.parametrize(
    ("text", "value"),
    [("10⁵ Pa", 1e5), ("10^5 Pa", 1e5), ("10⁻³ Pa", 1e-3), ("2.5 × 10³ Pa", 2.5e3), ("105 Pa", 105.0)],
)
def test_powers_of_ten_are_one_figure(text: str, value: float) -> None:
    (clause,) = read(f"Pump down to {text} before venting.").clauses
    assert [(figure.dimension, figure.low) for figure in clause.figures] == [
        ("pressure", pytest.approx(value))
    ]
