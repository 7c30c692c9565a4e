"""Which small words tell one lesson from another."""

import pytest

from gvla2.memory.meaning.conflicts import contradiction
from gvla2.memory.meaning.idle_words import telling
from gvla2.memory.meaning.statements import read
from gvla2.memory.meaning.word_sets import word_set


def test_what_only_stresses_is_idle_and_forms_are_one() -> None:
    assert not telling(word_set("the a please always must bitte immer toujours siempre 请"))
    assert telling(frozenset({"using", "used"})) == {"use"}
    assert telling(frozenset({"when"})) == telling(frozenset({"if"}))
    assert telling(frozenset({"im"})) == telling(frozenset({"in"}))
    small = word_set("on off in out under from to and or some all only too until while aus auf")
    assert telling(small) == small


def test_a_statement_keeps_its_small_words() -> None:
    assert {"with", "the", "or"} <= read("Wash the cup with water or soap.").soft
    assert "only" not in telling(read("Add oil only after the pan is hot.").soft)
    assert "only" in telling(read("Wash the dark shirts only.").soft)


@pytest.mark.parametrize(
    ("text", "side"),
    [
        ("Enter the cell while the laser is off.", "power-"),
        ("If the pumps are on, wait.", "power+"),
        ("Prüfe das Messer, wenn der Motor aus ist.", "power-"),
        ("Ouvre la vanne quand la pompe est allumée.", "power+"),
        ("Abre la tapa cuando la bomba está apagada.", "power-"),
    ],
)
def test_on_and_off_behind_a_verb_of_being_are_circumstances(text: str, side: str) -> None:
    assert any(side in clause.context for clause in read(text).clauses)


def test_on_and_off_behind_a_thing_are_how_it_is_done() -> None:
    assert (
        contradiction("Clean the blade with the motor off.", "Clean the blade with the motor on.") is not None
    )
    assert (
        contradiction("Clean the cup with the blue mark on the table.", "Clean the cup on the table.") is None
    )
    assert not any("power" in clause.sides for clause in read("The cup is on the table.").clauses)
