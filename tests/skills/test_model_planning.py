"""What goes into the prompts of planners that ask a model."""

from dataclasses import replace

from gvla2.skills.model_planning import MAX_CHARACTERS, Question, nothing_to_ask
from gvla2.testing import inputs

REQUEST = inputs.plan_request()


def test_words_are_bounded():
    question = Question(replace(REQUEST, instruction="lift\nit", rejections=("too far",) * 500))
    assert question.instruction == "lift it"
    assert len(question.rejection) < MAX_CHARACTERS + 40
    long = nothing_to_ask(replace(REQUEST, instruction="lift it " + "a" * MAX_CHARACTERS))
    assert str(MAX_CHARACTERS) in long.abstention.message, "declined instead of cut"
