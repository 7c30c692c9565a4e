"""Typed effects decide, texts are suspected, and what says the same may be merged."""

from dataclasses import replace
from typing import Any

import pytest

from gvla2.memory.curation.contesting import SUSPECT, compare, same_lesson
from gvla2.memory.records import Record, dump


def record(
    content: str, *, type: str = "procedural_hint", effect: dict[str, Any] | None = None, **more: Any
) -> Record:
    return Record(
        id=content, bank="b", query=more.pop("query", "lift the cup"), content=content, type=type, state="active",
        outcome="verified_success", confidence=0.9, quality=0.9, dedup_key=content, created=0.0, updated=0.0,
        effect=dump(effect) if effect else "", **more,
    )  # fmt: skip


def test_effects_decide_whatever_the_words_say() -> None:
    low = record("Lift it high.", effect={"kind": "bound", "parameter": "lift", "op": ">=", "value": 0.3})
    high = record("Lift it high!", effect={"kind": "bound", "parameter": "lift", "op": "<=", "value": 0.1})
    assert "at least 0.3" in compare(low, high).effect
    assert compare(low, replace(high, effect=low.effect)).effect == ""


def test_programs_never_contradict_one_another() -> None:
    one = record("Lift the cup 15 cm.", effect={"kind": "program", "skill": "pick", "steps": ["lift 15 cm"]})
    two = record("Lift the cup 5 cm.", effect={"kind": "program", "skill": "pick", "steps": ["lift 5 cm"]})
    found = compare(one, two)
    assert (found.effect, found.suspicion) == ("", 0.0)
    assert not same_lesson(one, replace(one, id="other"))


def test_texts_are_suspected_and_never_decided() -> None:
    found = compare(record("Lift the cup 15 cm."), record("Lift the cup 5 cm."))
    assert found.effect == ""
    assert found.suspicion is not None
    assert found.suspicion >= SUSPECT


def test_other_skills_languages_and_accounts_of_failures() -> None:
    one, two = record("Lift the cup 15 cm."), record("Lift the cup 5 cm.")
    assert compare(replace(one, skill="pick"), replace(two, skill="push")).suspicion == 0.0
    assert compare(record("Hebe die Tasse nicht an."), record("Hebe die Tasse an.")).suspicion is None
    slipped = [record(f"It slipped at {n} cm.", type="failure_avoidance") for n in (5, 30)]
    assert compare(*slipped).suspicion == 0.0


@pytest.mark.parametrize(
    ("first", "second"),
    [
        ("Lift the cup 15 cm.", "Lift the cup 150 mm!"),
        ("Always lift the cup.", "Lift a cup."),
        ("In the tunnel, slow down.", "Slow down in the tunnel."),
        ("Closing the lid carefully", "close the lid"),
        ("先打开夹爪。", "先打开夹爪"),
    ],
)
def test_the_same_in_the_same_words(first: str, second: str) -> None:
    assert same_lesson(record(first), record(second))


@pytest.mark.parametrize(
    ("first", "second"),
    [
        ("Put the cup on the plate.", "Put the plate on the cup."),
        ("Wrap the cup, then pack it.", "Then pack it, wrap the cup."),
        ("Wrap, then pack.", "Pack, then wrap."),
        ("Rinse the cup and dry the plate.", "Dry the plate and rinse the cup."),
        ("Milk before water.", "Water before milk."),
        ("Turn the light on.", "Turn the light off."),
        ("Lift the cup 15 cm.", "Lift the cup 16 cm."),
        ("Lift the cup.", "Lift the red cup."),
        ("Close the lid.", "Do not close the lid."),
        ("Salt and pepper.", "Salt or pepper."),
        ("Use rack A7.", "Use rack B3."),
        ("Hebe die Tasse.", "Hebe die Tassen."),
    ],
)
def test_where_there_is_no_telling_they_stay_apart(first: str, second: str) -> None:
    assert not same_lesson(record(first), record(second))


def test_a_hint_and_a_constraint_are_never_one() -> None:
    one = record("Lift the cup.")
    assert not same_lesson(one, replace(one, type="failure_avoidance"))
    assert not same_lesson(one, replace(one, skill="push"))
    bound = {"kind": "bound", "parameter": "lift", "op": ">=", "value": 0.1}
    assert not same_lesson(one, replace(one, effect=dump(bound)))
    assert same_lesson(replace(one, effect=dump(bound)), replace(one, effect=dump({**bound, "value": 0.2})))
    assert not same_lesson(replace(one, effect=dump(bound)), replace(one, effect=dump({**bound, "op": "<="})))
