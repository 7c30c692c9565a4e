"""Agent3d over real HTTP: scripted waypoints, from the answer to a plan that the checks pass, or to a refusal."""

import json
from dataclasses import replace

import numpy as np
import pytest

from gvla2.planning.calls import SkillCall
from gvla2.planning.contracts import Advice
from gvla2.planning.programs import adapted, relative_steps, waypoints_program
from gvla2.skills.carry_out import carry_out
from gvla2.testing import check_planner
from gvla2_plugins.agent3d import Agent3dConfig, gvla2_planners
from tests.local_model import LocalModel, said
from tests.plugins.scripted_planners import REQUEST, ScriptedPlanner, passes
from tests.skills.scenes import PATCH, POST, RING, TRAY, bowl, cube, make_object, request, sound

LIFT = '[["red_cube",0,0,100,1],["red_cube",0,0,-25,1],["red_cube",0,0,-25,0],["red_cube",0,0,150,0]]'
A = cube("a", (0.3, 0.1))
PUSH = '[["red_cube","blue_cube",-90,-20,0],["red_cube","blue_cube",60,-20,0]]'


SCRIPTED = ScriptedPlanner(gvla2_planners, Agent3dConfig)
planner, planned = SCRIPTED.at, SCRIPTED.planned


def test_it_is_a_planner_as_any_other():
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
        planner(model, programs=0).plan(replace(asked, rejections=("The red cube is too far.",)))
        with_memory, without = ("\n".join(m["content"] for m in r["messages"]) for r in model.requests[:2])
    assert with_memory.count("Task: raise the cube") == 2
    assert '["blue_cube", 0, 0, -23, 0]'.replace(" ", "") in with_memory
    assert "raise the cube" not in without
    assert without.endswith(
        "An earlier plan was rejected: The red_cube is too far.\n"
        "Objects (name, length x width x height in mm):\nred_cube 52x52x52\nblue_cube 47x47x47\n"
        "Task: lift the blue cube"
    )


def path_of_skill(call, asked):
    """The path of a call's plan, as memory stores it."""
    plan = sound(carry_out([call], asked), asked)
    steps = relative_steps(plan.trajectory, asked.scene, plan.roles)
    return waypoints_program(steps, asked.scene, roles=plan.roles, skill=plan.skill, instruction="do it")


def shown(asked, *programs):
    """How many of these remembered paths the prompt shows."""
    with LocalModel(lambda _: said(LIFT)) as model:
        planner(model, tries=1).plan(replace(asked, advice=Advice(programs=programs), instruction="go"))
        return "\n".join(m["content"] for m in model.requests[0]["messages"]).count("Task: do it")


@pytest.mark.parametrize(
    ("call", "objects"),
    [
        (SkillCall("place", "a", "tray", relation="in"), (A, TRAY)),
        (SkillCall("insert", "ring", "post"), (RING, POST)),
        (SkillCall("push", "a", "patch"), (A, PATCH)),
    ],
)
def test_the_path_of_a_skill_can_be_followed_where_it_was_taken(call, objects):
    asked = request(*objects)
    assert shown(asked, path_of_skill(call, asked)) == 1


@pytest.mark.parametrize("aside", [(0, 0), (45, 0), (0, 60)])
def test_an_object_held_by_its_wall_moves_as_the_hand_does(aside):
    asked = request(bowl(), make_object("patch", "region", (0.35, -0.28, 0.0005), (0.2, 0.2, 0.001)))
    by_skill = carry_out([SkillCall("place", "bowl", "patch")], asked).trajectory
    program = path_of_skill(SkillCall("place", "bowl", "patch"), asked)
    steps = adapted(program, asked.scene, {"bowl": "object_bowl", "patch": "object_patch"}, "")
    moved = [[s[0], s[1] + aside[0], s[2] + aside[1], *s[3:]] if s[0] == "object_patch" else s for s in steps]
    by_path = planned(json.dumps(moved), replace(asked, instruction="go")).trajectory
    hand, meant = (next(w.xyz for w in t if w.stage == "release") for t in (by_path, by_skill))
    centre, hold = bowl().centre, next(w.xyz for w in by_skill if w.stage == "close")
    assert np.hypot(*np.subtract(hold, centre)[:2]) > 0.03
    assert np.subtract(hand, meant)[:2] == pytest.approx(1e-3 * np.array(aside), abs=0.006)


def test_a_path_that_leads_nowhere_here_is_not_shown():
    asked = request(A, PATCH)
    path = path_of_skill(SkillCall("place", "a", "patch"), asked)
    aside = tuple((step[0], 300, *step[2:]) for step in path.steps)  # closes 30 cm beside the cube
    assert shown(asked, replace(path, steps=aside), path) == 1
    assert shown(asked, replace(path, steps=aside)) == 0
