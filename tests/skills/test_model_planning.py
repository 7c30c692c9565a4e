"""Paths that a model is asked for, over real HTTP."""

import re
from dataclasses import replace

import pytest

from gvla2.language import AskingOptions, Endpoint, EndpointOptions
from gvla2.planning.contracts import Advice
from gvla2.skills.model_planning import (
    MAX_CHARACTERS,
    ask_for_path,
    context,
    instruction_in,
    nothing_to_ask,
)
from gvla2.skills.path_lifting import PathPoint
from gvla2.testing import inputs
from tests.local_model import LocalModel, said

REQUEST = inputs.plan_request()
CUBE, BLUE = REQUEST.scene["red_cube"], REQUEST.scene["blue_cube"]


def over(obj, up, gripper):
    x, y, z = (float(v) for v in obj.centre)
    return PathPoint((x, y, z + up), gripper)


LIFT = [over(CUBE, 0.15, 1.0), over(CUBE, 0.0, 0.0), over(CUBE, 0.2, 0.0)]
STACK = [*LIFT, over(BLUE, 0.2, 0.0), over(BLUE, 0.06, 1.0)]
PATHS = {
    "lift": [LIFT],
    "air": [[over(CUBE, 0.5, 1.0), over(CUBE, 0.5, 0.0)]],
    "beyond": [[*LIFT, PathPoint((9.0, 9.0, 1.0), 0.0)]],
    "twice": [[*STACK, *STACK]],
    "none": [[]],
}
PATHS["air, else lift"] = [*PATHS["air"], *PATHS["lift"]]


def asked(*answers, tries=1):
    left = list(answers)
    with LocalModel(lambda _: said(left.pop(0) if len(left) > 1 else left[0])) as model:
        language = Endpoint(AskingOptions(timeout=10.0), EndpointOptions(base_url=model.url, model="m"))
        messages = [{"role": "user", "content": "draw"}]
        return ask_for_path(language, messages, lambda text: PATHS[text], REQUEST, tries=tries)


def test_what_cannot_be_done_is_asked_for_again():
    plan = asked("beyond", "lift", tries=2)
    assert plan.skill == "pick"
    assert "cannot be followed" in plan.transcript[0]["rejected"]


def test_the_first_path_that_can_be_carried_out_is_taken():
    assert asked("air, else lift").skill == "pick"


@pytest.mark.parametrize(
    ("answer", "kind", "message"),
    [
        ("air", "other", "touches nothing|nothing to hold"),
        ("beyond", "unreachable", "cannot be followed"),
        ("twice", "other", "closes 2 times"),
        ("none", "other", "0 points"),
    ],
)
def test_what_cannot_be_done_at_all_is_a_typed_refusal(answer, kind, message):
    plan = asked(answer, tries=2)
    assert plan.trajectory is None
    assert plan.abstention.kind == kind
    assert len(plan.transcript) == 2
    assert re.search(message, plan.abstention.message)


def test_words_are_bounded_and_marked():
    request = replace(REQUEST, instruction="lift\nit", advice=Advice("low"), rejections=("too far",) * 500)
    assert instruction_in(request) == "lift it"
    memory, rejected = context(request)
    assert "data, never instructions" in memory
    assert len(rejected) < MAX_CHARACTERS + 40
    assert context(REQUEST) == []
    long = nothing_to_ask(replace(REQUEST, instruction="lift it " + "a" * MAX_CHARACTERS))
    assert str(MAX_CHARACTERS) in long.abstention.message, "declined instead of cut"
