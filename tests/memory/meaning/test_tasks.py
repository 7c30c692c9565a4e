"""What is right for one task may be wrong for another: whether two instructions are about different things."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gvla2.memory.meaning.conflicts import Said, conflict
from gvla2.memory.meaning.tasks import other_tasks, task_of


def found(first: str, second: str, tasks: tuple[str, str]) -> bool:
    one, two = (
        Said("procedural_hint", text, query=task) for text, task in zip((first, second), tasks, strict=True)
    )
    there, back = conflict(one, two), conflict(two, one)
    assert (there is None) == (back is None)
    return there is not None


@pytest.mark.parametrize(
    ("one", "two", "first", "second"),
    [
        # opposite acts
        ("open the hatch", "close the hatch", "Slide the bolt up.", "Slide the bolt down."),
        ("lock the gate", "unlock the gate", "Turn the key left.", "Turn the key right."),
        ("load the cart", "unload the cart", "Drive forwards.", "Drive backwards."),
        ("turn on the fan", "turn off the fan", "Rotate the dial by 25 degrees.", "Rotate the dial by 80 degrees."),
        ("die Klappe öffnen", "die Klappe schließen", "Den Hebel ziehen.", "Den Hebel drücken."),
        ("ouvrir le coffre", "fermer le coffre", "Tirer le levier.", "Pousser le levier."),
        ("abrir la caja", "cerrar la caja", "Empuja la palanca.", "Tira de la palanca."),
        ("打开柜子", "关闭柜子", "向左推。", "向右推。"),
        # other objects
        ("grasp the egg", "grasp the hammer", "Close the gripper with 2 N.", "Close the gripper with 25 N."),
        ("bake bread", "bake cookies", "Heat the oven to 230 °C.", "Heat the oven to 170 °C."),
        ("paint the wall", "paint the car", "Spray from 20 cm away.", "Spray from 60 cm away."),
        ("stack the small crates", "stack the large crates", "Release at 2 mm.", "Release at 8 mm."),
        ("das Ei greifen", "den Hammer greifen", "Mit 2 N drücken.", "Mit 25 N drücken."),
        # other circumstances
        ("deploy to staging", "deploy to production", "Use 1 replica.", "Use 6 replicas."),
        ("deploy the app to staging", "deploy the app to production", "Use 1 replica.", "Use 6 replicas."),
        ("carry the full jug", "carry the empty jug", "Drive at 0.1 m/s.", "Drive at 0.5 m/s."),
        ("speed up the build", "reduce memory during the build", "Run make with -j 16.", "Run make with -j 2."),
        ("run the linter on Python 3.9", "run the linter on Python 3.12", "Use 2 workers.", "Use 8 workers."),
    ],
)  # fmt: skip
def test_lessons_of_other_tasks_do_not_contradict_each_other(
    one: str, two: str, first: str, second: str
) -> None:
    assert not found(first, second, (one, two))
    assert found(first, second, ("", two))
    assert found(first, second, (two, two))


@pytest.mark.parametrize(
    ("one", "two", "first", "second"),
    [
        # the same in other words, more general, of several lines
        ("lift the toolbox", "raise the toolbox", "Lift it 15 cm.", "Lift it 40 cm."),
        ("open the drawer", "open the top drawer", "Pull the handle.", "Push the handle."),
        ("die Tasse heben", "bitte die Tasse vom Tisch heben", "Hebe 10 cm.", "Hebe 40 cm."),
        ("abre el armario", "abrir el armario de arriba", "Gira a la derecha.", "Gira a la izquierda."),
        ("lift the cup\nraise the mug", "raise the mug\nfetch it", "Lift it 10 cm.", "Lift it 40 cm."),
        ("cup", "lift the cup", "Lift it 10 cm.", "Lift it 40 cm."),
        # incidental: what lies about, distances
        ("pick up the cup next to the red box", "pick up the cup near the blue plate", "Lift it 10 cm.",
         "Lift it 40 cm."),
        ("move the plate 20 cm to the left", "move the plate 30 cm to the left", "Carry it slowly.",
         "Carry it quickly."),
        # the lessons themselves name what they are about
        ("set up the http client", "requests to the payment API hang", "Set the HTTP client's timeout to 30 s.",
         "Set the HTTP client's timeout to 500 ms."),
        ("open the cabinet", "get a plate out of the cabinet", "The cabinet door swings to the left.",
         "The cabinet door swings to the right."),
        ("unlock the door", "open the locked door", "Turn the key clockwise to unlock the door.",
         "Turn the key counterclockwise to unlock the door."),
        ("wipe the table", "clean the table", "Press the sponge on the table with 3 N.",
         "Press the sponge on the table with 15 N."),
        # other languages
        ("lift the cup", "hebe die Tasse", "Lift the cup 10 cm.", "Hebe die Tasse 40 cm."),
    ],
)  # fmt: skip
def test_lessons_of_one_task_do(one: str, two: str, first: str, second: str) -> None:
    assert found(first, second, (one, two))


def test_a_task_is_taken_apart() -> None:
    task = task_of("pick up the cup next to the box for Anna")
    assert (task.act, task.things, task.goal) == ({"pick"}, {"cup"}, {"anna"})
    assert "box" in task.scene
    assert not other_tasks("", "a", "lift the cup", "b")
    assert not other_tasks("lift it", "a", "lift it", "b")


WORDS = st.lists(
    st.sampled_from(
        [
            "open",
            "close",
            "the",
            "full",
            "empty",
            "red",
            "cup",
            "jug",
            "lift",
            "on",
            "to",
            "3",
            "V2",
            ",",
            "die",
            "Tasse",
            "öffnen",
            "杯子",
            "left",
            "no",
        ]
    ),
    max_size=7,
).map(" ".join)


@given(WORDS, WORDS, st.text(max_size=40), st.text(max_size=40))
@settings(max_examples=80, deadline=None)
def test_the_answer_does_not_depend_on_the_order(one: str, two: str, first: str, second: str) -> None:
    assert other_tasks(one, first, two, second) == other_tasks(two, second, one, first)
    assert other_tasks(first, one, second, two) == other_tasks(second, two, first, one)
    assert not other_tasks(one, first, one, second)
