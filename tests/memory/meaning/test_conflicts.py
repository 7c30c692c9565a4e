"""Contradictions: 169 hand-written pairs, half of them held out, and as many generated as one likes."""

import itertools
import json
import time
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gvla2.evaluation.memory_data.contradictions import pairs as written
from gvla2.evaluation.memory_data.generated_contradictions import generated
from gvla2.memory.meaning.conflicts import Said, conflict, contradiction, effects_conflict


def rates(pairs: list[tuple[str, str, bool]]) -> tuple[float, float]:
    """Shares of contradictions found, and of other pairs taken for one."""
    found = [contradiction(a, b) is not None for a, b, real in pairs if real]
    false = [contradiction(a, b) is not None for a, b, real in pairs if not real]
    return sum(found) / len(found), sum(false) / len(false)


@pytest.mark.parametrize("held_out", [False, True])
def test_hand_written_pairs(held_out: bool, record_property: Any) -> None:
    chosen = [p for p in written() if p.held_out is held_out]
    assert len(chosen) >= 80
    found, false = rates([(p.first, p.second, p.conflict) for p in chosen])
    record_property("found", found)
    record_property("false", false)
    print(
        f"{'held out' if held_out else 'tuning'}: {found:.1%} found, {false:.1%} false of {len(chosen)} pairs"
    )
    assert found >= 0.95
    assert false <= 0.05


def test_the_answer_does_not_depend_on_the_order() -> None:
    for pair in written():
        there, back = contradiction(pair.first, pair.second), contradiction(pair.second, pair.first)
        assert (there is None) == (back is None)


def test_generated_pairs() -> None:
    found, false = rates(generated(seed=7, count=600))
    print(f"generated: {found:.1%} found, {false:.1%} false")
    assert found >= 0.95
    assert false <= 0.05


def test_ten_thousand_comparisons_take_little_time() -> None:
    pairs = generated(seed=8, count=300)
    for a, b, _ in pairs:
        contradiction(a, b)  # reading is cached
    began = time.perf_counter()
    for a, b, _ in itertools.islice(itertools.cycle(pairs), 3000):
        contradiction(a, b)
    assert (time.perf_counter() - began) / 3000 < 1e-3


@given(st.text(max_size=300), st.text(max_size=300))
@settings(max_examples=60, deadline=None)
def test_any_text_gets_an_answer_and_agrees_with_itself(first: str, second: str) -> None:
    assert (contradiction(first, second) is None) == (contradiction(second, first) is None)
    assert contradiction(first, first) is None


def test_a_megabyte_is_read_in_part() -> None:
    began = time.perf_counter()
    contradiction("lift the cup 15 cm " * 60_000, "5 cm " * 200_000)
    assert time.perf_counter() - began < 2.0


def effect(kind: str, value: float = 0.0, **more: Any) -> dict[str, Any]:
    return {"kind": kind, "parameter": "grasp_depth", "value": value, "skill": "pick", **more}


@pytest.mark.parametrize(
    ("first", "second", "real"),
    [
        (effect("bound", 0.03, op=">="), effect("bound", 0.02, op="<="), True),
        (effect("bound", 0.02, op=">="), effect("bound", 0.03, op="<="), False),
        (effect("bound", 0.02, op=">="), effect("bound", 0.03, op=">="), False),
        (effect("prior", 0.02, sd=0.001, count=9), effect("prior", 0.04, sd=0.001, count=9), True),
        (effect("prior", 0.02, sd=0.02, count=9), effect("prior", 0.04, sd=0.02, count=9), False),
        (effect("prior", 0.020, count=1), effect("prior", 0.028, count=1), False),
        (effect("prior", 0.02, count=1), effect("prior", 0.09, count=1), True),
        (
            effect("forbid", parameter="approach:top"),
            effect("prior", parameter="approach:top", count=2),
            True,
        ),
        (
            effect("forbid", parameter="approach:top"),
            effect("prior", parameter="approach:side", count=2),
            False,
        ),
        (effect("bound", 0.03, op=">=", object="cup"), effect("bound", 0.02, op="<=", object="plate"), False),
        (effect("bound", 0.03, op=">="), effect("bound", 0.02, op="<=", skill="push"), False),
        (effect("bound", float("nan"), op=">="), effect("bound", 0.02, op="<="), False),
        (
            effect("bound", 0.03, op=">="),
            {"kind": "bound", "parameter": "grasp_depth", "op": "<=", "value": "x"},
            False,
        ),
    ],
)
def test_typed_effects(first: dict[str, Any], second: dict[str, Any], real: bool) -> None:
    assert (effects_conflict(first, second) is not None) is real
    assert (effects_conflict(second, first) is not None) is real
    json.dumps([first, second])


def test_lessons_of_two_skills_never_contradict_each_other() -> None:
    first = Said("procedural_hint", "Move the cup 15 cm.", "pick")
    assert conflict(first, Said("procedural_hint", "Move the cup 5 cm.", "pick")) is not None
    assert conflict(first, Said("procedural_hint", "Move the cup 5 cm.", "push")) is None


def test_a_failure_at_one_number_does_not_contradict_a_success_at_another() -> None:
    hint = Said("procedural_hint", "Lift the cup 15 cm.")
    assert conflict(hint, Said("failure_avoidance", "Lift the cup 5 cm: it hit the rim.")) is None
    found = conflict(hint, Said("failure_avoidance", "Never lift the cup 15 cm."))
    assert found is not None
    assert found.kind == "forbidden"
    first = Said("failure_avoidance", "Lift the cup 5 cm: failed because it hit the rim.")
    assert (
        conflict(first, Said("failure_avoidance", "Lift the cup 40 cm: failed because it slipped.")) is None
    )
