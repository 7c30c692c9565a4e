"""What a text says, taken apart: words, sides, figures, what is forbidden, what comes first, what is chosen."""

import pytest

from gvla2.memory.meaning.clauses import Clause, read


def only(text: str) -> Clause:
    (clause,) = read(text).clauses
    return clause


def test_a_clause_has_words_sides_and_figures() -> None:
    clause = only("Push the tray 20 cm to the left.")
    assert clause.words == {"tray"}
    assert set(clause.sides) == {("moving", 1), ("side", 1)}
    assert [(f.dimension, f.low) for f in clause.figures] == [("length", 0.2)]
    assert not clause.forbidden


@pytest.mark.parametrize(
    ("text", "forbidden"),
    [
        ("Never touch the lamp.", True),
        ("Do not touch the lamp.", True),
        ("Don't forget to touch the lamp.", False),
        ("Avoid touching the lamp.", True),
        ("Don't solder without flux.", False),
        ("Do not start before the lid is shut.", False),
        ("Don't push unless the tests pass.", False),
        ("It is not forbidden to use both arms.", False),
        ("Never exceed 5 N.", False),
    ],
)
def test_what_forbids(text: str, forbidden: bool) -> None:
    assert only(text).forbidden is forbidden


def test_a_forbidden_bound_is_the_other_bound() -> None:
    (figure,) = only("Never exceed 5 N.").figures
    assert figure.high == 5.0


def test_words_that_belong_together_stand_apart() -> None:
    assert ("power", -1) in only("Switch the ring light off.").sides
    assert ("power", 1) in only("Mapping works with the lights on.").sides
    assert ("turning", -1) in only("Turn it counter-clockwise.").sides


@pytest.mark.parametrize(
    "text",
    [
        "Dry the plate before stacking it.",
        "Stack it after drying the plate.",
        "Dry the plate, then stack it.",
        "Dry the plate first and stack it afterwards.",
        "Do not stack it before drying the plate.",
    ],
)
def test_what_comes_before_what(text: str) -> None:
    assert any("wetness-" in first and "stack" in then for first, then in read(text).orders), text


@pytest.mark.parametrize(
    "text",
    [
        "Use pip rather than conda.",
        "Use pip instead of conda.",
        "Use pip, not conda.",
        "Prefer pip over conda.",
        "Pip is better than conda.",
        "Instead of conda, use pip.",
        "Don't use conda, use pip.",
    ],
)
def test_what_is_taken_and_what_is_left(text: str) -> None:
    assert [("pip" in taken, "conda" in left) for taken, left in read(text).choices] == [(True, True)]


def test_numbered_things_are_words() -> None:
    assert "nr3" in only("Waypoint 3 was 4 mm off.").words
    assert "nr3_11" in only("On Python 3.11 pin it.").words


def test_a_long_text_is_read_to_an_end() -> None:
    assert read("lift the cup. " * 5000).clauses


@pytest.mark.parametrize("text", ["", "5 cm", "Never. 5 cm!", "before 5 s", "twice, then once"])
def test_a_text_of_figures_alone_is_read(text: str) -> None:
    assert all(not clause.sides for clause in read(text).clauses)
