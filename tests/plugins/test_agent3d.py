"""Agent3d over real HTTP: scripted waypoints, from the answer to a plan that the checks pass, or to a refusal."""

import json
from dataclasses import replace

import pytest

from gvla2.planning.contracts import Advice
from gvla2.planning.programs import waypoints_program
from gvla2.testing import check_component, check_planner
from gvla2.testing.language import LocalModel, said
from gvla2_plugins.agent3d import Agent3dConfig, gvla2_planners
from tests.plugins.scripted_planners import REQUEST, ScriptedPlanner, passes

LIFT = '[["red_cube",0,0,100,1],["red_cube",0,0,-25,1],["red_cube",0,0,-25,0],["red_cube",0,0,150,0]]'
PUSH = '[["red_cube","blue_cube",-90,-20,0],["red_cube","blue_cube",60,-20,0]]'
BARE = "[[300,-80,150,1],[300,-80,25,1],[300,-80,25,0],[300,-80,200,0]]"


SCRIPTED = ScriptedPlanner(gvla2_planners, Agent3dConfig)
planner, planned = SCRIPTED.at, SCRIPTED.planned


def test_it_is_a_planner_as_any_other():
    (component,) = gvla2_planners()
    check_component(component)
    with LocalModel(lambda _: said(LIFT)) as model:
        check_planner(planner(model))


@pytest.mark.parametrize("answer", [LIFT, f'```json\n{{"path": {LIFT}}}\n```', f"The path:\n{LIFT}\nDone."])
def test_a_lift_takes_the_object_up(answer):
    plan = planned(answer)
    assert (plan.skill, plan.roles) == ("pick", {"theme": "red_cube"})
    passes(plan)
    assert plan.trajectory.waypoints[-1].carries == "red_cube"
    assert plan.program.language == "waypoints"
    assert plan.program.steps[2] == ("{theme}", 0, 0, "-0.48h", 0)


def test_a_closed_hand_pushes_towards_another_object():
    plan = planned(PUSH)
    assert (plan.skill, plan.roles["theme"]) == ("push", "red_cube"), plan.abstention
    passes(plan)


def test_bare_points_are_the_papers():
    plan = planned(BARE, waypoints="bare", points=4)
    assert plan.roles == {"theme": "red_cube"}
    passes(plan)
    assert plan.program is None
    with LocalModel(lambda _: said(BARE)) as model:
        planner(model, waypoints="bare", points=4).plan(REQUEST)
        words = model.requests[0]["messages"][-1]["content"]
    assert "red_cube 52x52x52 at 300,-80 (right) points" in words


def test_what_cannot_be_carried_out_goes_back_with_its_reason():
    nowhere = LIFT.replace("[", '[["red_cube",300,0,100,1],', 1).replace(
        '"red_cube",0,0,-25', '"red_cube",300,0,-25'
    )
    answers = iter([nowhere, LIFT])
    with LocalModel(lambda _: said(next(answers))) as model:
        plan = planner(model).plan(REQUEST)
        last = model.requests[-1]["messages"]
    assert "where there is nothing to hold" in last[-1]["content"]
    assert last[-2]["content"] == nowhere
    passes(plan)
    assert len(plan.transcript) == 2


@pytest.mark.parametrize(
    ("answer", "why"),
    [
        ("I would first grasp the cube.", "no JSON"),
        (LIFT[:-20], "broken"),
        ("[]", "not a list of waypoints"),
        ('[["ghost",0,0,100,1]]', "nothing called"),
        ('[["red_cube","red_cube",0,100,1]]', "on the way to itself"),
        ('[[["red_cube"],0,0,100,1]]', "nothing called"),
        ('[["red_cube",0,"x",100,1]]', "neither a name nor a number"),
        ('[["red_cube",0,0,1e999,1]]', "out of range"),
        ('[["red_cube",0,0,100,2]]', "out of range"),
        ('[["red_cube",0,0,100]]', "five elements"),
        (json.dumps([["red_cube", 0, 0, 100, 1]] * 17), "17 waypoints"),
    ],
)
def test_bad_answers_move_nothing(answer, why):
    plan = planned(answer, tries=2)
    assert plan.trajectory is None
    assert plan.abstention.kind == "other"
    assert why in plan.abstention.message
    assert len(plan.transcript) == 2


@pytest.mark.parametrize("answer", ['[["a","b","c","d"]]', "[[1,2,3]]"])
def test_bad_bare_answers_move_nothing(answer):
    plan = planned(answer, tries=1, waypoints="bare")
    assert plan.abstention.kind == "other"


@pytest.mark.parametrize(
    ("answer", "kind"),
    [
        ('[["red_cube",0,0,300,1]]', "other"),
        ('[["red_cube",0,0,100,1],["red_cube",0,0,300,0]]', "other"),
        (LIFT.replace("0,0,150", "1000,0,900"), "unreachable"),
        (LIFT[:-1] + ',["red_cube",0,200,20,1],["blue_cube",0,0,-20,0],["blue_cube",0,0,150,0]]', "other"),
    ],
)
def test_paths_that_cannot_be_carried_out_move_nothing(answer, kind):
    plan = planned(answer)
    assert plan.trajectory is None
    assert plan.abstention.kind == kind, plan.abstention
    assert len(plan.transcript) == 3


def test_remembered_paths_come_with_the_names_of_now():
    steps = [["red_cube", 0, 0, 100, 1], ["red_cube", 0, 0, -26, 0]]
    program = waypoints_program(
        steps, REQUEST.scene, roles={"theme": "red_cube"}, skill="pick", instruction="raise\nthe cube"
    )
    asked = replace(
        REQUEST, advice=Advice("", (), (program, program, program)), instruction="lift the blue cube"
    )
    with LocalModel(lambda _: said(LIFT)) as model:
        planner(model, programs=2).plan(asked)
        planner(model, programs=0).plan(asked)
        planner(model, waypoints="bare", tries=1).plan(asked)
        with_memory, without, bare = (
            "\n".join(m["content"] for m in r["messages"]) for r in model.requests[:3]
        )
    assert with_memory.count("Task: raise the cube") == 2
    assert '["blue_cube", 0, 0, -23, 0]'.replace(" ", "") in with_memory
    assert "raise the cube" not in without + bare
