"""Forms of verbs that no ending tells, and words that only look like one."""

import pytest

from gvla2.memory.meaning.concepts import concept_of
from gvla2.memory.meaning.conflicts import contradiction
from gvla2.memory.meaning.verb_forms import verb_of


@pytest.mark.parametrize(
    ("form", "verb"),
    [("fed", "feed"), ("swept", "sweep"), ("gestapelt", "stapeln"), ("ausgeschaltet", "ausschalten"),
     ("geschüttelt", "schütteln"), ("gelöscht", "löschen"), ("límpiala", "limpia"), ("colócalos", "coloca"),
     ("limpiándola", "limpiando")],
)  # fmt: skip
def test_a_form_gives_its_verb(form: str, verb: str) -> None:
    assert verb_of(form) == verb


@pytest.mark.parametrize("word", ["target", "budget", "geist", "led", "ground", "máquinas", "cámara", "feed"])
def test_what_only_looks_like_one_is_none(word: str) -> None:
    assert not verb_of(word)


def test_a_form_stands_for_what_its_verb_does() -> None:
    assert concept_of("gelöscht") == concept_of("löschen") == concept_of("deleted")
    assert concept_of("schliess") == concept_of("schliessen")
    assert concept_of("hint") == "hint"


@pytest.mark.parametrize(
    ("first", "second"),
    [
        ("Feed the cable in from the left end.", "The cable must be fed in from the right end."),
        ("Den Behälter beim Leeren schütteln.", "Der Behälter darf beim Leeren nicht geschüttelt werden."),
        ("Lösche die Datei vor dem Update.", "Die Datei darf vor dem Update nicht gelöscht werden."),
        ("Primero limpia la pieza y luego pésala.", "Primero pesa la pieza y luego límpiala."),
        ("Öffne den Greifer ganz.", "Schließ den Greifer ganz."),
    ],
)
def test_lessons_in_two_forms_contradict_each_other(first: str, second: str) -> None:
    assert contradiction(first, second) is not None
