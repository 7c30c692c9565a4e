"""The planner ``skill_llm`` over real HTTP: a model says which object a phrase means that fits none."""

from dataclasses import replace

import pytest

from gvla2.language import Endpoint, EndpointOptions
from gvla2.testing import check_planner
from gvla2_plugins.skill import SkillLlmConfig
from gvla2_plugins.skill.phrases import AskingSkillPlanner
from tests.local_model import LocalModel, said
from tests.skills.scenes import TRAY, cube, request

CUP = replace(cube("a", (0.3, 0.1)), label="ranch creamy box", colour="white", named_by="text")
CAN = replace(cube("b", (0.3, -0.2)), label="gray cylinder", colour="gray")
SENTENCE = "pick up the salad dressing"


def answers(words, sure=None):
    """The letter of the line that holds the words; ``sure`` is its probability, and "unknown" has the rest."""

    def answer(body):
        text = body["messages"][0]["content"]
        lines = {line[3:]: line[0] for line in text.splitlines() if line[1:3] == ". "}
        (letter,) = (letter for line, letter in lines.items() if words in line)
        odds = {lines["unknown"]: 1 - (sure or 0), letter: sure} if sure else {}
        return said(letter, [(letter, odds)] if odds else [])

    return answer


def planned(model, sentence=SENTENCE, sure=0.5):
    config = SkillLlmConfig(sure=sure)
    planner = AskingSkillPlanner(config, Endpoint(EndpointOptions(base_url=model.url)))
    return planner.plan(replace(request(CUP, CAN, TRAY), instruction=sentence))


def test_it_passes_the_conformance_checks():
    with LocalModel(lambda _: said("Z")) as model:
        check_planner(AskingSkillPlanner(SkillLlmConfig(), Endpoint(EndpointOptions(base_url=model.url))))


def test_a_phrase_that_fits_nothing_is_the_object_that_the_model_is_sure_of():
    with LocalModel(answers("ranch creamy", 0.9)) as model:
        plan = planned(model)
    assert plan.trajectory is not None, plan.abstention
    assert plan.roles["theme"] == "a"
    assert any("salad dressing" in note and "90 %" in note for note in plan.notes)
    shown = model.requests[0]["messages"][0]["content"]
    assert 'with the text "ranch creamy"' in shown
    assert "gray cylinder" in shown


@pytest.mark.parametrize(("words", "sure"), [("ranch creamy", 0.4), ("unknown", 0.9), ("unknown", None)])
def test_what_the_model_is_not_sure_of_is_declined(words, sure):
    with LocalModel(answers(words, sure)) as model:
        plan = planned(model)
    assert plan.trajectory is None
    assert plan.abstention.kind == "nothing_matches"


def test_a_preference_for_a_letter_is_no_answer():
    """The list is shown from both ends: the first letter stands for two objects, neither of which is likely."""
    with LocalModel(lambda _: said("A", [("A", {"A": 0.99})])) as model:
        plan = planned(model, sure=0.6)
    assert plan.abstention.kind == "nothing_matches"


def test_a_server_without_probabilities_is_believed_at_half():
    with LocalModel(answers("ranch creamy")) as model:
        assert planned(model).roles["theme"] == "a"
        assert planned(model, sure=0.6).trajectory is None


def test_nothing_is_asked_where_the_words_fit_and_a_model_that_cannot_be_asked_declines():
    with LocalModel(answers("ranch creamy", 0.9)) as model:
        assert planned(model, "pick up the gray cylinder").roles["theme"] == "b"
        assert not model.requests
    plan = planned(model)
    assert plan.abstention.kind == "nothing_matches"
    assert any("could not be asked" in note for note in plan.notes)
