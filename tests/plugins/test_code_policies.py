"""Code as policies over real HTTP: scripted programs, from the answer to a plan that the checks pass."""

from dataclasses import replace

import pytest

from gvla2.planning.contracts import Advice
from gvla2.planning.programs import calls_program
from gvla2.testing import check_planner
from gvla2_plugins.code_policies import CodePoliciesConfig, gvla2_planners
from tests.local_model import LocalModel, said
from tests.plugins.scripted_planners import REQUEST, ScriptedPlanner, passes

STACK = replace(REQUEST, instruction="put the red cube on the blue cube")
RED, BLUE = REQUEST.scene.objects


SCRIPTED = ScriptedPlanner(gvla2_planners, CodePoliciesConfig)
planner, planned = SCRIPTED.at, SCRIPTED.planned


def test_it_is_a_planner_as_any_other():
    with LocalModel(lambda _: said("pick(red_cube)")) as model:
        check_planner(planner(model))


def test_a_call_is_carried_out():
    plan = planned("pick(red_cube)")
    assert (plan.skill, plan.roles) == ("pick", {"theme": "red_cube"})
    passes(plan)
    assert plan.program.steps == ("pick({theme})",)
    assert plan.transcript[0]["answer"] == "pick(red_cube)"


def test_a_program_in_a_fence_is_read_and_kept_without_its_comments():
    answer = "Sure:\n```python\n# the red one\nplace(red_cube, goal=blue_cube, relation='on')\n```"
    plan = planned(answer, STACK)
    assert plan.roles == {"theme": "red_cube", "goal": "blue_cube"}
    passes(plan, STACK)
    assert plan.program.steps == ("place({theme}, {goal}, on)",)


def test_what_cannot_be_carried_out_goes_back_with_its_reason():
    answers = iter(["pull(red_cube)", "pick(red_cube)"])
    with LocalModel(lambda _: said(next(answers))) as model:
        plan = planner(model).plan(REQUEST)
        asked = model.requests[-1]["messages"][-1]["content"]
    assert "The red_cube has no visible handle" in asked
    assert plan.roles == {"theme": "red_cube"}
    passes(plan)


@pytest.mark.parametrize(
    "answer",
    [
        "First, I pick up the cube.", "pick(", "pick(ghost)", "import os", "height()", "pick(red_cube)\n" * 300,
        "[" * 300, "\x00pick(red_cube)", "while True:\n    pick(red_cube)",
    ],
)  # fmt: skip
def test_bad_answers_move_nothing(answer):
    plan = planned(answer, tries=2)
    assert plan.trajectory is None
    assert plan.abstention.kind == "other"
    assert len(plan.transcript) == 2
    assert all(entry["rejected"] for entry in plan.transcript)


def test_remembered_programs_come_with_the_names_of_now():
    program = calls_program(
        ["pick(red_cube)"], {"red_cube": "red_cube"}, REQUEST.scene, roles={"theme": "red_cube"},
        skill="pick", instruction="raise\nthe cube",
    )  # fmt: skip
    asked = replace(REQUEST, advice=Advice("", (), (program,) * 3), instruction="lift the blue cube")
    with LocalModel(lambda _: said("pick(blue_cube)")) as model:
        planner(model).plan(asked)
        planner(model, programs=0).plan(replace(asked, rejections=("The red cube is too far.",)))
        with_memory, without = (r["messages"][1]["content"] for r in model.requests)
    assert with_memory.count("- raise the cube: pick(blue_cube) succeeded") == 2
    assert "<memory>" not in without
    assert without.endswith(
        "\n\nAn earlier plan was rejected: The red_cube is too far.\n\nObjects:\n"
        "red_cube 52x52x52 at 300,-80 (right)\nblue_cube 47x47x47 at 340,120 (left)\n"
        "Task: lift the blue cube\nProgram:"
    )
