"""Instructions of simple form are read; for anything else the model is asked."""

import json

import pytest

from gvla2_plugins.robopoint.reading import PointingTask, form, question, read_answer, read_simply


@pytest.mark.parametrize(
    ("words", "task"),
    [
        ("pick up the red cube", PointingTask("pick", "red cube")),
        ("lift the green box off the table", PointingTask("pick", "green box")),
        ("put the pear on the plate", PointingTask("place", "pear", "plate", "on")),
        ("Place the lid of the jar onto the mat!", PointingTask("place", "lid of the jar", "mat", "on")),
        ("set the cup to the left of the box", PointingTask("place", "cup", "box", "left_of")),
        ("put the cup in front of the box", PointingTask("place", "cup", "box", "front_of")),
    ],
)
def test_what_is_read(words, task):
    assert read_simply(words) == task


@pytest.mark.parametrize(
    "words",
    [
        "",
        "do not pick up the red cube",
        "pick up any cube except the maroon one",
        "pick up the cube and put it on the plate",
        "put the cup on the tray on the box",
        "lift the cup by 10 cm",
        "pick up the cup. Then wave.",
        "open the drawer",
        "the red cube",
    ],
)
def test_what_is_left_to_the_model(words):
    assert read_simply(words) is None


class Skill:
    def __init__(self, name):
        self.name, self.description = name, f"does {name}"

    def signature(self):
        return f"{self.name}(theme)"


SKILLS = {name: Skill(name) for name in ("pick", "open")}


def test_the_question_and_its_form_name_the_skills():
    assert "open(theme): does open" in question("open  the\ndrawer", SKILLS)
    assert form(SKILLS)["properties"]["skill"] == {"enum": ["pick", "open", "none"]}


def test_the_answer_is_read():
    text = json.dumps({"skill": "open", "theme": "drawer ", "goal": "", "relation": ""})
    assert read_answer(f"Here: ```json\n{text}\n```", SKILLS) == PointingTask("open", "drawer")


@pytest.mark.parametrize(
    ("answer", "said"),
    [
        ("the drawer", "JSON"),
        ('{"skill": "juggle", "theme": "a"}', "no skill 'juggle'; there are pick, open and none"),
        ('{"skill": "open", "theme": ""}', "name the object"),
        ('{"skill": "open", "theme": "' + "a" * 90 + '"}', "short texts"),
        ('{"skill": "open", "theme": "a", "relation": "over"}', "no relation 'over'"),
        ('{"skill": "open", "theme": NaN}', "NaN, which is not a number"),
    ],
)
def test_other_answers_are_refused_with_their_reason(answer, said):
    with pytest.raises(ValueError, match=said):
        read_answer(answer, SKILLS)
