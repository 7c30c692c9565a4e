"""How likely two texts contradict each other: English ones, whatever their order; of others there is no telling."""

import json
from pathlib import Path

import pytest
from examination_entries import entries
from hypothesis import given, settings
from hypothesis import strategies as st

from gvla2.memory.meaning import suspicion as module
from gvla2.memory.meaning.english import is_english
from gvla2.memory.meaning.suspicion import FEATURES, SIGNS, candidates, suspicion, threshold

AGAINST = """
Lift the cup 15 cm. | Lift the cup 50 mm.
Turn the lid clockwise. | Turn the lid counterclockwise.
Open the valve before starting the pump. | Start the pump before opening the valve.
Use rsync rather than scp for the logs. | Use scp rather than rsync for the logs.
Wipe the lens with alcohol. | Never wipe the lens with alcohol.
Wrap the glass first, then put it in the crate. | Put the glass in the crate first, then wrap it.
Push the tray to the left. | Push the tray to the right.
Hold the jar with at most 5 N. | The jar needs at least 20 N.
Keep the lights on while mapping the hall. | Keep the lights off while mapping the hall.
"""
FITTING = """
Lift the cup 15 cm. | Lift the cup 150 mm.
Lift the cup at least 5 cm. | Lift the cup 15 cm.
Do not forget to close the lid. | Close the lid.
Don't lift without closing the gripper. | Close the gripper, then lift.
Use rsync instead of scp. | Don't use scp, use rsync.
Bake at 230 °C. | Bake for 35 minutes.
Sand with the grain. | Sweep the hall at night.
Don't leave the door open. | Keep the door closed.
The fern gets 200 ml of water. | The vacuum robot docks behind the sofa.
Waypoint 3 was 4 mm off. | Waypoint 7 was 9 mm off.
"""


def pairs(text: str) -> list[tuple[str, ...]]:
    return [tuple(part.strip() for part in line.split("|")) for line in text.strip().splitlines()]


@pytest.mark.parametrize(("first", "second"), pairs(AGAINST))
def test_contradictions_in_one_task_are_suspected(first: str, second: str) -> None:
    found = suspicion(first, second, "do it", "do it")
    assert found is not None
    assert found >= threshold()


@pytest.mark.parametrize(("first", "second"), pairs(FITTING))
def test_what_fits_together_is_not(first: str, second: str) -> None:
    found = suspicion(first, second, "do it", "do it")
    assert found is not None
    assert found < threshold()


def test_another_task_may_have_another_answer() -> None:
    one = suspicion("Grip it with 4 N.", "Grip it with 25 N.", "grasp a ripe peach", "grasp a raw potato")
    same = suspicion("Grip it with 4 N.", "Grip it with 25 N.", "grasp a ripe peach", "grasp a ripe peach")
    assert one is not None
    assert same is not None
    assert one < threshold() <= same


@pytest.mark.parametrize(
    "text",
    [
        "Hebe die Tasse nicht höher als 5 cm.",
        "Ouvre la porte avant d'entrer.",
        "把杯子抬高5厘米。",
        "Abre la puerta.",
    ],
)
def test_of_other_languages_there_is_no_telling(text: str) -> None:
    assert not is_english(text)
    assert suspicion(text, "Lift the cup 5 cm.") is None
    assert suspicion("Lift the cup 5 cm.", text) is None


def test_most_of_what_examiners_wrote_in_english_is_known_as_english() -> None:
    texts = [text for kind in ("lesson", "honest") for entry in entries(kind, 1) for text in entry.texts]
    plain = [text for text in texts if " the " in f" {text.lower()} "]
    assert len(plain) > 100
    assert sum(map(is_english, plain)) >= 0.99 * len(plain)


TEXTS = st.text(alphabet="abc lift the cup not never before 5 cm left right,.;-'°é", max_size=60)


@given(TEXTS, TEXTS, TEXTS, TEXTS)
@settings(max_examples=150, deadline=None)
def test_any_two_texts_have_one_suspicion_either_way(a: str, b: str, task: str, other: str) -> None:
    found = suspicion(a, b, task, other)
    assert found == suspicion(b, a, other, task)
    assert found is None or 0.0 <= found <= 1.0


def test_the_weights_are_those_of_the_features() -> None:
    table = json.loads(Path(module.__file__).with_name("suspicion_weights.json").read_text("utf-8"))
    assert set(table["weights"]) == set(FEATURES)
    assert 0.5 < threshold() < 1.0
    assert candidates("Lift it 5 cm.", "Lift it 9 cm.").shape == (1, len(FEATURES))
    assert candidates("Lift it.", "Wash the floor.").shape == (0, len(FEATURES))
    assert set(SIGNS) < set(FEATURES)
